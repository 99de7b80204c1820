"""Fixtures that every tier uses."""

import gc
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
_SETTLE_S = 3.0
"""Threads of pools and of libraries need a moment to be gone after they were told to end."""


def _open_files() -> dict[str, str]:
    """What each file descriptor of this process points to."""
    found = {}
    for link in Path("/proc/self/fd").iterdir():
        try:
            found[link.name] = str(link.readlink())
        except OSError:
            continue  # the descriptor that lists the folder
    return {number: target for number, target in found.items() if not _harmless(target)}


def _harmless(target: str) -> bool:
    """Descriptors that belong to the process as such: opened once by a library or the test runner."""
    return target.startswith(
        ("/dev/null", "/dev/urandom", "anon_inode:", "/proc/", "/tmp/pytest-capture")
    ) or ("(deleted)" in target)


def _shared_memory() -> set[str]:
    return {entry.name for entry in Path("/dev/shm").iterdir()}


@pytest.fixture(autouse=True)
def no_leaks() -> Iterator[None]:
    """Fail a test that leaves a thread, a file, a socket or shared memory behind."""
    threads = set(threading.enumerate())
    files = set(_open_files().items())
    memory = _shared_memory()
    yield
    end = time.monotonic() + _SETTLE_S
    while True:
        gc.collect()
        left_threads = [thread.name for thread in threading.enumerate() if thread not in threads]
        left_files = sorted(target for number, target in set(_open_files().items()) - files)
        left_memory = sorted(_shared_memory() - memory)
        if not (left_threads or left_files or left_memory):
            return
        if time.monotonic() > end:
            break
        time.sleep(0.05)
    pytest.fail(f"left behind: threads {left_threads}, files {left_files}, shared memory {left_memory}")


@pytest.fixture
def shared_data() -> Path:
    """The folder of real data beside the project; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data is not there: {SHARED_DATA}")
    return SHARED_DATA
