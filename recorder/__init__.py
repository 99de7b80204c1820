"""A train-cab recorder: cameras, GNSS, lidar and CAN, lossless, with time that can be trusted."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recorder.storage import open_drive as open_drive

    __version__: str

__all__ = ["__version__", "open_drive"]


def __getattr__(name: str) -> Any:
    """Both on first use: a kernel or a driver does not load the storage room, and looking a version
    up costs more than most commands."""
    if name == "open_drive":
        from recorder.storage import open_drive  # noqa: PLC0415

        return open_drive
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415

        try:
            return metadata.version("recorder")
        except metadata.PackageNotFoundError:  # a checkout that is not installed
            return "0"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
