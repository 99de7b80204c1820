"""What a command reads and writes: targets whole or not at all, nothing overwritten unasked, ``-``."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from recorder.errors import UsageError
from recorder.storage.faults import storage_error

PIPE = Path("-")


def name(path: Path) -> str:
    """What to call an input."""
    return "standard input" if path == PIPE else str(path)


@contextmanager
def at_hand(path: Path) -> Iterator[Path]:
    """A file to read by position: ``path``, or standard input in one that is gone afterwards."""
    if path != PIPE:
        yield path
        return
    if sys.stdin is None:
        raise UsageError("is closed", where=name(path), todo="give a file or a pipe")
    with tempfile.NamedTemporaryFile(prefix="recorder-") as spool:
        shutil.copyfileobj(sys.stdin.buffer, spool)
        spool.flush()
        yield Path(spool.name)


@contextmanager
def new_file(path: Path, *, force: bool) -> Iterator[BinaryIO]:
    """A file that takes the place of ``path`` when the block is done, unless it is empty; or standard output.

    Raises `UsageError` if ``path`` exists and not ``force``, `StorageError` if it cannot be written.
    """
    if path == PIPE:
        yield sys.stdout.buffer
        return
    if path.exists() and not path.is_file():
        raise UsageError("exists and is not a file", where=str(path), todo="choose another name")
    if (path.exists() or path.is_symlink()) and not force:
        raise _exists(path)
    part = _beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("xb") as file:
            yield file
            empty = file.tell() == 0
        if not empty:
            part.replace(path)
    except OSError as error:
        raise storage_error(error, path) from error
    finally:
        with suppress(OSError):  # it may never have been
            part.unlink()


@contextmanager
def new_folder(path: Path, *, force: bool) -> Iterator[Path]:
    """A folder whose files move to ``path`` when the block is done; ``force``: also if others are there.

    Raises `UsageError` if ``path`` is a file, or holds anything and not ``force``, `StorageError` if it
    cannot be written.
    """
    if path.exists() and not path.is_dir():
        raise UsageError("exists and is not a folder", where=str(path), todo="choose another name")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise _exists(path)
    part = _beside(path)
    try:
        part.mkdir(parents=True)
        yield part
        path.mkdir(exist_ok=True)
        for file in part.iterdir():
            file.replace(path / file.name)
    except OSError as error:
        raise storage_error(error, path) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _beside(path: Path) -> Path:
    path = path.absolute()
    return path.with_name(f".{path.name}.{os.getpid()}.part")


def _exists(path: Path) -> UsageError:
    return UsageError("exists already", where=str(path), todo="choose another name, or --force to replace it")
