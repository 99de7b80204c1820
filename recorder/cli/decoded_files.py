"""The images of a stream as files: where they go, and writing them."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorder.cli.files import PIPE, name, new_file, new_folder
from recorder.cli.image_files import SUFFIXES, array_head, array_item, picture_bytes
from recorder.codec import FrameStream
from recorder.errors import CodecError, UsageError

Report = Callable[[int, int], None]
Decoded = Iterator[tuple[NDArray[np.uint16], int]]
"""Pixels and bit depth."""


def target_of(stream: Path, out: Path | None, format: str | None, count: int) -> tuple[Path, str]:
    """The file or folder for ``count`` images, and the format. Raises `UsageError` if they do not fit."""
    told = SUFFIXES.get(out.suffix.lower()) if out else None
    if out == PIPE:
        raise UsageError(
            "images are not written to standard output", where="-o -", todo="give a file or folder"
        )
    if told and format and told != format:
        raise UsageError(f"a name for {told}, but --format {format}", where=str(out), todo="leave one out")
    kind = told or format or "png"
    if out is None:
        stem = "images" if stream == PIPE else stream.stem
        return Path(stem if count > 1 and kind != "npy" else f"{stem}.{kind}"), kind
    if told and kind != "npy" and count > 1:
        todo = f"give a folder, with --format {kind}"
        raise UsageError(f"{count} images do not fit one {kind} file", where=str(out), todo=todo)
    return out, kind


def write_decoded(
    frames: FrameStream, stream: Path, target: Path, kind: str, *, force: bool, report: Report
) -> list[Path]:
    """Write all images, or nothing; return the files.

    Raises `CodecError` for a damaged image, `UsageError` for images that do not fit one array or a target
    that exists, `StorageError` if it cannot be written.
    """
    images = _decoded(frames, stream, report)
    if kind == "npy":
        with new_file(target, force=force) as file:
            for data in _array(images, len(frames), stream):
                file.write(data)
        return [target.absolute()]
    if len(frames) == 1 and target.suffix.lower() in SUFFIXES:
        with new_file(target, force=force) as file:
            file.writelines(picture_bytes(*image, kind) for image in images)
        return [target.absolute()]
    names = [f"{number:06d}.{kind}" for number in range(len(frames))]
    with new_folder(target, force=force) as folder:
        for file_name, image in zip(names, images, strict=True):
            (folder / file_name).write_bytes(picture_bytes(*image, kind))
    return [target.absolute() / file_name for file_name in names]


def _decoded(frames: FrameStream, stream: Path, report: Report) -> Decoded:
    for number, offset in enumerate(frames.offsets):
        try:
            frame = frames[number]
            yield frame.pixels, frame.header.bit_depth
        except CodecError as error:
            what = f"{name(stream)}: image {number} at byte {offset}: {error}"
            raise CodecError(f"{what}; recorder felics salvage keeps the others") from None
        report(number + 1, len(frames))


def _array(images: Decoded, count: int, stream: Path) -> Iterator[bytes]:
    first: Any = None
    for pixels, depth in images:
        kind = (*pixels.shape, depth > 8)
        if first is None:
            first = kind
            yield array_head(count, pixels.shape, depth)
        if kind != first:
            raise UsageError("images of several shapes or depths", where=name(stream), todo="--format png")
        yield array_item(pixels, depth)
