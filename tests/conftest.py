"""Fixtures that every tier uses."""

import gc
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from hypothesis import settings

# other work on the machine must not make an example fail
settings.register_profile("project", deadline=None)
settings.load_profile("project")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
_SETTLE_S = 3.0
"""Threads of pools and of libraries need a moment to be gone after they were told to end."""


def _open_files() -> set[tuple[str, str]]:
    """Descriptors of this process and what each points to, but the one that lists them."""
    found = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except OSError:
            continue
        if not target.startswith("/proc/"):
            found.add((link.name, target))
    return found


def _shared_memory() -> set[str]:
    return {entry.name for entry in Path("/dev/shm").iterdir()}


def _handlers() -> dict[int, object]:
    return {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}


@pytest.fixture(autouse=True)
def no_leaks() -> Iterator[None]:
    """Fail a test that leaves a thread, process, file, socket, shared memory or signal handler behind."""
    threads = set(threading.enumerate())
    children = set(psutil.Process().children(recursive=True))
    files, memory, handlers = _open_files(), _shared_memory(), _handlers()
    yield
    end = time.monotonic() + _SETTLE_S
    while True:
        gc.collect()
        left = {
            "threads": [thread.name for thread in threading.enumerate() if thread not in threads],
            "processes": [child.pid for child in set(psutil.Process().children(recursive=True)) - children],
            "files": sorted(target for _, target in _open_files() - files),
            "shared memory": sorted(_shared_memory() - memory),
            "signal handlers": [
                number for number, handler in _handlers().items() if handler != handlers[number]
            ],
        }
        if not any(left.values()):
            return
        if time.monotonic() > end:
            break
        time.sleep(0.05)
    pytest.fail(f"left behind: { {what: found for what, found in left.items() if found} }")


@pytest.fixture
def shared_data() -> Path:
    """The folder of real data beside the project; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not there: {SHARED_DATA}")
    return SHARED_DATA
