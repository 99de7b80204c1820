"""A machine whose clocks are slewed and set at will, and a camera with a clock of its own."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from random import Random


class SimulatedClock:
    """The clocks of an imagined machine (`recorder.clock.Clock`), driven by `advance`.

    Args:
        raw_ns: CLOCK_MONOTONIC_RAW at first.
        wall_ns: CLOCK_REALTIME minus raw at first.
        reading_ns: how long each reading of a clock takes.
    """

    def __init__(self, raw_ns: int = 10**12, wall_ns: int = 17 * 10**17, reading_ns: int = 40) -> None:
        self.now_ns = raw_ns
        self._reading_ns = reading_ns
        self._since_ns, self._ppb = raw_ns, 0
        self._monotonic_ns, self._wall_ns = raw_ns, raw_ns + wall_ns

    def advance(self, ns: int) -> None:
        """Let time go by."""
        self.now_ns += ns

    def set_wall(self, by_ns: int) -> None:
        """As ``clock_settime``: the wall clock jumps."""
        self._wall_ns += by_ns

    def slew(self, ppm: int) -> None:
        """As ``adjtimex``: monotonic and wall clock run faster than raw from now on."""
        ran_ns = self._ran_ns()
        self._monotonic_ns += ran_ns
        self._wall_ns += ran_ns
        self._since_ns, self._ppb = self.now_ns, 1000 * ppm

    def wall_at_now_ns(self) -> int:
        """What the kernel would stamp just now; costs no time."""
        return self._wall_ns + self._ran_ns()

    def monotonic_at_now_ns(self) -> int:
        """As `wall_at_now_ns`, for CLOCK_MONOTONIC."""
        return self._monotonic_ns + self._ran_ns()

    def raw_ns(self) -> int:
        return self._read(lambda: self.now_ns)

    def monotonic_ns(self) -> int:
        return self._read(self.monotonic_at_now_ns)

    def realtime_ns(self) -> int:
        return self._read(self.wall_at_now_ns)

    def boottime_ns(self) -> int:
        return self._read(self.monotonic_at_now_ns)

    def _ran_ns(self) -> int:
        elapsed_ns = self.now_ns - self._since_ns
        return elapsed_ns + elapsed_ns * self._ppb // 10**9

    def _read(self, clock: Callable[[], int]) -> int:
        """The clock is read in the middle of what the call takes."""
        before_ns = self._reading_ns // 2
        self.now_ns += before_ns
        told = clock()
        self.now_ns += self._reading_ns - before_ns
        return told


@dataclass(frozen=True, slots=True)
class SimulatedFrame:
    """One frame of a simulated camera, with the truth."""

    id: int
    ticks_ns: int
    """What the camera stamps."""
    exposure_ns: int
    arrival_ns: int
    """Raw, when the kernel sees it."""
    middle_ns: int
    """Raw, true middle of the exposure."""


@dataclass(frozen=True, slots=True)
class SimulatedCamera:
    """A camera that runs freely by a crystal of its own; frames arrive late by chance, never early."""

    rate_hz: int = 50
    drift_ppm: float = 23.0
    """Of its crystal against raw."""
    wander_ppm_per_minute: float = 0.0
    tick_ns: int = 100
    event: str = "exposure_end"
    """As `recorder.config.CameraSection.stamp_event`."""
    exposure_ns: int = 4_000_000
    transfer_ns: int = 1_000_000
    """The least from the end of the exposure to the arrival."""
    delay_ns: int = 6_000_000
    """What the arrival is late beyond that: uniform from 0."""
    transfer_jitter_ns: int = 0
    """What of the delay is already in a stamp of the end of the transfer: uniform from 0."""

    def frames(self, count: int, start_ns: int, seed: int = 0) -> Iterator[SimulatedFrame]:
        """So many frames, the first one exposed about ``start_ns`` raw."""
        random = Random(seed)
        period_ns = 10**9 // self.rate_hz
        for id in range(count):
            elapsed_ns = id * period_ns
            minutes = elapsed_ns / 60e9
            drift_ppm = self.drift_ppm + self.wander_ppm_per_minute * minutes / 2
            middle_ns = start_ns + elapsed_ns - round(elapsed_ns * drift_ppm * 1e-6)
            end_ns = middle_ns + self.exposure_ns // 2
            jitter_ns = random.randint(0, self.transfer_jitter_ns)
            since_middle_ns = {
                "exposure_start": -self.exposure_ns // 2,
                "exposure_end": self.exposure_ns // 2,
                "transfer_end": self.exposure_ns // 2 + self.transfer_ns + jitter_ns,
            }[self.event]
            ticks_ns = 5 * 10**9 + elapsed_ns + since_middle_ns
            yield SimulatedFrame(
                id=id,
                ticks_ns=ticks_ns // self.tick_ns * self.tick_ns,
                exposure_ns=self.exposure_ns,
                arrival_ns=end_ns + self.transfer_ns + jitter_ns + random.randint(0, self.delay_ns),
                middle_ns=middle_ns,
            )
