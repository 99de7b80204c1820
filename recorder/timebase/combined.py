"""The report's combined time."""

from dataclasses import dataclass

from recorder.samples import Fix


@dataclass(frozen=True, slots=True)
class CombinedTime:
    """t_combi = T0 + t_SMR − offset (report 3.2.6.3): a reference fixed once, then raw time alone."""

    reference_ns: int
    """T0: the receiver's time, or the wall clock if there was no valid fix."""
    offset_ns: int
    """The raw instant of the reference."""

    @classmethod
    def at_first_frame(cls, raw_ns: int, realtime_ns: int, fix: Fix | None) -> "CombinedTime":
        """Fix the reference.

        Args:
            raw_ns, realtime_ns: of the first frame (offset_SMR and T0_SRT).
            fix: the last valid one by then: T0_GPS is its time, offset_GMR its arrival.
        """
        if (
            fix is not None
            and fix.valid
            and fix.stamp.gps_ns is not None
            and fix.stamp.gps_raw_ns is not None
        ):
            return cls(fix.stamp.gps_ns, fix.stamp.gps_raw_ns)
        return cls(realtime_ns, raw_ns)

    def at(self, raw_ns: int) -> int:
        """Unix-like nanoseconds of a raw instant."""
        return self.reference_ns + raw_ns - self.offset_ns
