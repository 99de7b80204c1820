"""What every driver is."""

from collections.abc import Iterator, Mapping
from typing import Protocol

from recorder.samples import Sample


class Driver(Protocol):
    """One device: opens, configures, yields stamped samples, closes.

    A driver neither retries nor logs nor knows who listens; it raises one of
    `recorder.errors` on any fault. All calls come from one thread, in the order
    ``open``, ``samples``, ``close``; after ``close`` it may be opened again.
    """

    name: str
    """Stable name of the device: ``front``, ``tag``, ``gnss``."""
    live: bool
    """True for a device: what is not taken in time is lost. False for a file: it waits."""

    def open(self) -> None:
        """Find the device and set it up. Raises `DeviceError` or `SourceError`."""

    def samples(self) -> Iterator[Sample | None]:
        """Yield samples as they come, and None at least every 0.2 s when none does, so that the
        caller can look at its stop event. Ends when a file ends. Raises `DeviceError`."""

    def describe(self) -> Mapping[str, str]:
        """Vendor, model, serial, firmware and the like, valid while open."""

    def close(self) -> None:
        """Let go of everything; safe to call at any time and twice."""
