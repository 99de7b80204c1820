"""``recorder felics encode``, ``decode``, ``info`` and ``salvage``: images and marker-framed streams."""

import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recorder.cli.files import PIPE, at_hand, name, new_file
from recorder.cli.output import Json, print_json, print_table, progress, size
from recorder.errors import CodecError, UsageError

if TYPE_CHECKING:
    from recorder.cli.image_files import Picture
    from recorder.codec import FrameStream, Gap
    from recorder.drivers.image_source import DepthRule

_ROWS = 30
"""A terminal's worth of a table; ``--json`` tells all."""
_MCAP = b"\x89MCAP0\r\n"

Stream = Annotated[
    Path, typer.Argument(help="A .felics stream, an MCAP segment, or any file with images in it; - is stdin.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]


class Model(StrEnum):
    """How pixels are coded."""

    FELICS_LS = "felics-ls"
    FELICS = "felics"
    RAW = "raw"


class Format(StrEnum):
    """Image files that a stream can become."""

    PNG = "png"
    TIFF = "tiff"
    PGM = "pgm"
    NPY = "npy"


def register(app: typer.Typer) -> None:
    felics = typer.Typer(no_args_is_help=True, help="Images compressed without loss, and streams of them.")
    for command in (encode, decode, info, salvage):
        felics.command()(command)
    app.add_typer(felics, name="felics")


def encode(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Grey images of 8 or 16 bits: PNG, TIFF, PGM, or NPY of (H, W) or (N, H, W); - is stdin.",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The stream to write; - is stdout.")],
    bit_depth: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=16,
            help="Default: that of a PGM's maxval; 8 for 8-bit images; for 16-bit ones the smallest of"
            " 10, 12, 14, 16 that holds the first.",
        ),
    ] = None,
    model: Annotated[
        Model, typer.Option(help="felics-ls is the smallest, felics the fastest.")
    ] = Model.FELICS_LS,
    force: Force = False,
    json: Json = False,
) -> int:
    """Compress images into one stream, in the order given."""
    from recorder.drivers.image_source import DepthRule

    if json and out == PIPE:
        raise UsageError("--json needs standard output too", where="-o -", todo="leave one out")
    rule = DepthRule()
    images = packed_bits = written = 0
    with new_file(out, force=force) as sink, progress("encoding") as report:
        for where, picture in _pictures(files):
            depth = bit_depth or _depth(rule, where, picture)
            data = _encoded(where, picture, depth, model)
            sink.write(data)
            images, written = images + 1, written + len(data)
            packed_bits += picture.pixels.size * depth
            report(images, 0)
    ratio = 8 * written / packed_bits if packed_bits else 0.0
    if json:
        told = {"images": images, "bytes": written, "ratio": round(ratio, 6)}
        print_json({"out": str(out.absolute()), **told})
    elif out != PIPE:
        print(f"{out}: {_count(images)}, {size(written)}, {100 * ratio:.1f} % of the packed size")
    return 0


def decode(
    stream: Stream,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="An image file for one image, a folder for several, or one .npy for all. Default: by the"
            " stream's name, in the current folder.",
        ),
    ] = None,
    format: Annotated[Format | None, typer.Option(help="Default: by the name of OUT, else png.")] = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Write the images of a sound stream as files, one each, or as one NPY array."""
    from recorder.cli.decoded_files import target_of, write_decoded
    from recorder.codec import FrameStream

    with at_hand(stream) as path, FrameStream(path) as frames, progress("decoding") as report:
        _check_sound(frames, stream)
        target, kind = target_of(stream, out, format.value if format else None, len(frames))
        files = write_decoded(frames, stream, target, kind, force=force, report=report)
    if json:
        told = {"images": len(frames), "out": str(target.absolute()), "files": list(map(str, files))}
        print_json({"stream": name(stream), **told})
    else:
        print(f"{target}: {_count(len(frames))}")
    return 0


def info(stream: Stream, json: Json = False) -> int:
    """Say what a stream holds, by its headers."""
    from recorder.codec import FrameStream

    with at_hand(stream) as path, FrameStream(path) as frames:
        _check_any(frames, stream)
        images = [(frame.offset, len(frame.data), frame.header) for frame in frames]
        total, other = frames.size, frames.size - sum(frames.sizes)
    if json:
        keys = ("width", "height", "bit_depth", "model", "checksum")
        told = [
            {"offset": offset, "bytes": count, **{key: getattr(header, key) for key in keys}}
            for offset, count, header in images
        ]
        print_json({"stream": name(stream), "bytes": total, "other_bytes": other, "images": told})
        return 0
    kinds: dict[tuple[int, int, int, str], list[int]] = defaultdict(list)
    for _, count, header in images:
        kinds[header.width, header.height, header.bit_depth, header.model].append(count)
    rows = [(f"{kind[0]} x {kind[1]}", *kind[2:], *_sizes(kind, counts)) for kind, counts in kinds.items()]
    columns = ("width x height", "bits", "model", "images", "size", "mean", "of packed")
    print_table(f"{_title(stream)}: {_count(len(images))}, {size(total)}", columns, rows[:_ROWS])
    if len(rows) > _ROWS:
        print(f"and {len(rows) - _ROWS} kinds more: --json tells of every image")
    if other:
        print(f"{size(other)} belong to no image; recorder felics salvage tells whether any was lost")
    return 0


def salvage(
    stream: Stream,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The stream to write; - is stdout. Default: none.")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Keep every intact image of a damaged file and state every loss; exit code 1 if there is one."""
    from recorder.codec import StreamFrame
    from recorder.codec import salvage as pieces_of

    if json and out == PIPE:
        raise UsageError("--json needs standard output too", where="-o -", todo="leave one out")
    kept: list[int] = []
    gaps: list[Gap] = []
    with (
        at_hand(stream) as path,
        new_file(out, force=force) if out else nullcontext() as sink,
        progress("salvaging") as report,
    ):
        for piece in pieces_of(path):
            if isinstance(piece, StreamFrame):
                kept.append(len(piece.data))
                if sink:
                    sink.write(piece.data)
            else:
                gaps.append(piece)
            report(len(kept), 0)
        contained = _is_container(path)
    if not kept and not any(gap.error for gap in gaps):
        raise UsageError("holds no FELICS image", where=name(stream), todo="check the path")
    losses = [gap for gap in gaps if gap.error or not contained]
    others = sum(gap.size for gap in gaps if contained and not gap.error)
    lost_bytes = sum(gap.size for gap in losses)
    if json:
        written = str(out.absolute()) if out and kept else None
        told = [
            {"offset": gap.offset, "bytes": gap.size, "reason": str(gap.error) if gap.error else None}
            for gap in losses
        ]
        sums = {"images": len(kept), "bytes": sum(kept), "lost_bytes": lost_bytes, "other_bytes": others}
        print_json({"stream": name(stream), "out": written, "lost": bool(losses), **sums, "losses": told})
    elif out != PIPE:
        _print_losses(stream, losses)
        target = f", written to {out}" if out and kept else ""
        print(f"{_count(len(kept), 'intact image')}, {size(sum(kept))}{target}")
        if contained:
            print(f"{size(others)} are other records of a segment; recorder verify checks those")
    if losses:
        places = _count(len(losses), "place")
        print(f"recorder: {name(stream)}: {size(lost_bytes)} lost in {places}", file=sys.stderr)
    return 1 if losses else 0


def _pictures(files: Sequence[Path]) -> Iterator[tuple[str, "Picture"]]:
    """Every image of every file, and what to call it."""
    from recorder.cli.image_files import read_pictures

    for file in files:
        with at_hand(file) as path:
            for picture in read_pictures(path, name(file)):
                yield name(file), picture


def _depth(rule: "DepthRule", where: str, picture: "Picture") -> int:
    if picture.maxval is None:
        return rule.depth(picture.pixels)
    depth = picture.maxval.bit_length()
    largest = (1 << depth) - 1
    if picture.maxval != largest:
        todo = f"--bit-depth {depth} keeps the values and makes it {largest}"
        raise UsageError(f"maxval {picture.maxval} is not that of any bit depth", where=where, todo=todo)
    return depth


def _encoded(where: str, picture: "Picture", depth: int, model: Model) -> bytes:
    from recorder.codec import encode as encode_image

    try:
        return encode_image(picture.pixels, bit_depth=depth, model=model.value)
    except ValueError as error:
        largest = int(picture.pixels.max(initial=0))
        todo = (
            f"--bit-depth {largest.bit_length()} holds it" if largest >> depth else "cut it into smaller ones"
        )
        raise UsageError(str(error), where=where, todo=todo) from None


def _check_any(frames: "FrameStream", stream: Path) -> None:
    if not len(frames):
        todo = "check that it is a stream; recorder felics salvage looks for remains"
        raise UsageError("holds no FELICS image", where=name(stream), todo=todo)


def _check_sound(frames: "FrameStream", stream: Path) -> None:
    """Nothing is left out unsaid."""
    _check_any(frames, stream)
    other = frames.size - sum(frames.sizes)
    if other and not _is_container(frames.path):
        what = f"{name(stream)}: {other} bytes belong to no image"
        raise CodecError(f"{what}; recorder felics salvage keeps the intact ones")


def _is_container(path: Path) -> bool:
    """Whether bytes between the images are to be expected: those of an MCAP segment."""
    with path.open("rb") as file:
        return file.read(len(_MCAP)) == _MCAP


def _sizes(kind: tuple[int, int, int, str], counts: list[int]) -> tuple[Any, ...]:
    width, height, depth, _ = kind
    total, packed = sum(counts), len(counts) * width * height * depth / 8
    return len(counts), size(total), size(total / len(counts)), f"{100 * total / packed:.1f} %"


def _print_losses(stream: Path, losses: "list[Gap]") -> None:
    if not losses:
        return
    rows = [(gap.error or "no image to be seen", gap.offset, size(gap.size)) for gap in losses[:_ROWS]]
    print_table(f"{_title(stream)}: lost", ("what", "from byte", "size"), rows)
    if len(losses) > _ROWS:
        print(f"and {len(losses) - _ROWS} places more: --json tells of all")


def _title(stream: Path) -> str:
    """A table's title is no wider than the table."""
    return name(stream) if stream == PIPE else stream.name


def _count(number: int, what: str = "image") -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
