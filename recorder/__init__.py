"""A train-cab recorder: cameras, GNSS, lidar and CAN, lossless, with time that can be trusted."""

from importlib import metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recorder.storage import open_drive as open_drive

__all__ = ["__version__", "open_drive"]

try:
    __version__ = metadata.version("recorder")
except metadata.PackageNotFoundError:  # a checkout that is not installed
    __version__ = "0"


def __getattr__(name: str) -> Any:
    """``open_drive`` on first use, so that a kernel or a driver does not load the storage room."""
    if name == "open_drive":
        from recorder.storage import open_drive  # noqa: PLC0415

        return open_drive
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
