"""Which software recorded: what a drive says of its maker."""

import platform
from importlib.metadata import PackageNotFoundError, version

_LIBRARIES = ("recorder", "numpy", "opencv-python-headless", "mcap", "protobuf", "pyserial", "pynmeagps")


def versions() -> dict[str, str]:
    """Versions of ourselves, the libraries on the recording path, Python and the kernel."""
    return {
        **{name: _version(name) for name in _LIBRARIES},
        "python": platform.python_version(),
        "kernel": platform.release(),
        "machine": platform.machine(),
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # installed as something else, such as another build of OpenCV
        return "unknown"
