"""One topic of a drive in another format, without loss."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np

from recorder.errors import CodecError, UsageError
from recorder.storage.csv_export import write_csv
from recorder.storage.drive import FRAME_SCHEMA, Drive
from recorder.storage.faults import storage_error
from recorder.storage.frames import Frames, StoredFrame
from recorder.storage.video_export import write_mkv

Progress = Callable[[int, int], None]
"""Takes how many messages are done, and the total."""

IMAGE_FORMATS = ("felics", "png", "npy", "mkv")
FORMATS = (*IMAGE_FORMATS, "csv")
_FOLDERS = ("png", "npy")


def export(drive: Drive, topic: str, format: str, out: Path, progress: Progress | None = None) -> int:
    """Write one topic to ``out`` and return the number of its messages.

    ``felics`` is one file of images one after another, as their markers frame them; ``png`` and ``npy``
    fill a folder with one file for each frame, named by its id, the values as they are (a png has 8
    bits up to a depth of 8, else 16); ``mkv`` is FFV1 video, lossless too; ``csv`` the times and
    numbers of any topic.

    Raises `UsageError` for a topic, format or target that cannot be, `StorageError` if the target
    cannot be written, `DriveError` or `CodecError` at a damaged message: what was written until then
    stays.
    """
    out = Path(out)
    _check_request(drive, topic, format)
    _check_target(out, folder=format in _FOLDERS)
    report = progress or (lambda done, total: None)
    try:
        if format == "csv":
            return write_csv(drive, topic, out, report)
        frames = drive.frames(topic.split("/")[2])
        out.parent.mkdir(parents=True, exist_ok=True)
        if format == "felics":
            return _write_felics(frames, out, report)
        if format == "mkv":
            return write_mkv(frames, out, report)
        out.mkdir(exist_ok=True)
        return _write_folder(frames, format, out, report)
    except OSError as error:
        raise storage_error(error, out) from error


def _check_request(drive: Drive, topic: str, format: str) -> None:
    where = str(drive.path)
    if topic not in drive.topics:
        known = f"topics here: {', '.join(drive.topics) or 'none'}"
        raise UsageError(f"no topic {topic!r}", where=where, todo=known)
    if format not in FORMATS:
        raise UsageError(f"no format {format!r}", todo=f"choose one of {', '.join(FORMATS)}")
    if format in IMAGE_FORMATS and drive.topics[topic].schema != FRAME_SCHEMA:
        what = f"{topic} holds no frames, so it cannot be exported as {format}"
        raise UsageError(what, where=where, todo="use csv, or a /camera/NAME/image topic")


def _check_target(out: Path, *, folder: bool) -> None:
    try:
        if not out.exists():
            return
        if folder and not out.is_dir():
            raise UsageError("is not a folder", where=str(out), todo="choose another target")
        if not folder and out.is_dir():
            raise UsageError("is a folder", where=str(out), todo="give the name of a file")
        if folder and not any(out.iterdir()):
            return
        if not folder and out.is_file() and out.stat().st_size == 0:
            return
    except OSError as error:
        raise storage_error(error, out) from error
    todo = "nothing is overwritten: remove it or choose another target"
    raise UsageError("exists already", where=str(out), todo=todo)


def _write_felics(frames: Frames, out: Path, report: Progress) -> int:
    with _whole_or_nothing(out), out.open("wb") as file:
        for done, frame in enumerate(frames, 1):
            file.write(frame.data)
            report(done, len(frames))
    return len(frames)


@contextmanager
def _whole_or_nothing(path: Path) -> Iterator[None]:
    """Leave no file behind that was written in part."""
    try:
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def _write_folder(frames: Frames, format: str, out: Path, report: Progress) -> int:
    write = _write_png if format == "png" else _write_npy
    for done, frame in enumerate(frames, 1):
        path = out / f"{frame.id:09d}.{format}"
        with _whole_or_nothing(path):
            write(frame, path)
        report(done, len(frames))
    return len(frames)


def _write_png(frame: StoredFrame, path: Path) -> None:
    import cv2  # noqa: PLC0415 - only an export needs it

    pixels = frame.pixels
    image = pixels.astype(np.uint8) if frame.bit_depth <= 8 else pixels
    done, data = cv2.imencode(".png", image)
    if not done:
        raise CodecError(f"frame {frame.id} cannot be written as png")
    path.write_bytes(data.tobytes())


def _write_npy(frame: StoredFrame, path: Path) -> None:
    image = BytesIO()  # numpy turns a full disk into an error that does not say so
    np.save(image, frame.pixels, allow_pickle=False)
    path.write_bytes(image.getvalue())
