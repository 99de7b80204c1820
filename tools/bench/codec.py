"""The FELICS codec against its peers: frames a second as shares of memcpy, and sizes.

One core, to which the process is held. Frames are rendered ones (day and dark) and, where the
shared data is there, photographs and video with the noise of the camera; so many that each is
cold when its turn comes. memcpy is numpy's copy of the same frames into an array that is there
already, timed right before each pass of what is compared with it. Values are medians over passes.
All codecs but the two-thread figure run in one thread and give every picture back as it was, or the
bench ends. Tables are trained apart from encoding, as a recorder does, but for the rows that say so.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from codec_bench import worker
from codec_bench.codecs import JPEG_LS, JXL_E1
from codec_bench.pictures import DATA, Picture, photographs, rendered
from codec_bench.race import Effort, Result, Speed
from figures import Figure, Measured, Table, report

Better = Literal["higher", "lower"]
GOALS: dict[str, tuple[float, Better]] = {
    "felics_encode_avx2_of_memcpy": (0.13, "higher"),
    "felics_decode_avx2_of_memcpy": (0.11, "higher"),
    "felics_encode_avx512_of_memcpy": (0.20, "higher"),
    "felics_decode_avx512_of_memcpy": (0.18, "higher"),
    "ls_encode_avx2_of_memcpy": (0.09, "higher"),
    "ls_decode_avx2_of_memcpy": (0.08, "higher"),
    "ls_encode_avx512_of_memcpy": (0.14, "higher"),
    "ls_decode_avx512_of_memcpy": (0.125, "higher"),
    "ls_size_of_jpegls10": (0.985, "lower"),
    "felics_encode_over_scalar": (10, "higher"),
    "felics_encode_over_jxl_e1": (4, "higher"),
    "worst_content_of_memcpy": (0.07, "higher"),
    "worst_size_of_packed": (1.01, "lower"),
    "threads2_speedup": (1.9, "higher"),
}
MODELS = {"felics": "felics", "ls": "felics-ls"}
"""As figures call them, and by name."""
TITLES = {"scalar": "scalar", "avx2": "AVX2", "avx512": "AVX-512"}

HEADLINE = (
    *(f"{model} {TITLES[kernels]}" for kernels in ("avx2", "avx512") for model in MODELS.values()),
    *(JPEG_LS, JXL_E1, "HTJ2K", "FFV1", "memcpy"),
)
"""The rows that the README shows."""

ROTATION = 16
"""Pictures that take turns, at the least: 42 MB, more than a core finds in its caches."""
FULL = Effort(passes=30, least=3, seconds=6.0)
QUICK = Effort(passes=6, least=1, seconds=1.0)


@dataclass(frozen=True, slots=True)
class Run:
    """All that was measured."""

    pictures: Sequence[Picture]
    real: int
    """How many of them, the last ones, are photographs and video."""
    camera: Mapping[str, Mapping[str, Result]]
    """Instruction set, in the order of power, and codec; the last set ran with the whole field."""
    contents: Mapping[str, Mapping[str, Result]]
    """Content and model, on the set ``contents_on``."""
    contents_on: str
    field_on_contents: Mapping[str, float]
    """The largest size of packed that each peer makes of any content."""
    imaging: Mapping[str, Mapping[str, float]]
    """Size of packed by codec and picture, of medical and depth images."""
    threads: Mapping[str, Speed]
    """Empty on a machine of one core."""

    @property
    def widest(self) -> str:
        return list(self.camera)[-1]

    @property
    def field(self) -> dict[str, Result]:
        """The peers, by name."""
        ours = MODELS.values()
        return {name: result for name, result in self.camera[self.widest].items() if name not in ours}

    def size(self, codec: str, start: int = 0) -> float:
        """Size of packed over the pictures from ``start`` on."""
        sizes = self.camera[self.widest][codec].sizes[start:]
        return sum(sizes) / sum(picture.packed_bytes for picture in self.pictures[start:])


def measure(quick: bool) -> Measured:
    """Race FELICS against its peers; see the top of the file."""
    photos = photographs() if DATA.is_dir() else []
    if not photos:
        print(f"no photographs: {DATA} is not there; rendered frames only", file=sys.stderr)
    return told(ran([*rendered(ROTATION), *photos], len(photos), ROTATION, QUICK if quick else FULL))


def ran(pictures: Sequence[Picture], real: int, contents: int, effort: Effort, *, field: bool = True) -> Run:
    """Everything, one process after another; ``contents`` pictures of each content."""
    sets = worker.available()
    widest = sets[-1]
    contents_on = "avx2" if "avx2" in sets else widest
    shape = pictures[0].pixels.shape
    camera = {
        name: worker.run(name, worker.camera, pictures, effort, field=field and name == widest)
        for name in sets
    }
    return Run(
        pictures,
        real,
        camera,
        worker.run(contents_on, worker.contents, contents, *shape, effort),
        contents_on,
        worker.run(widest, worker.sizes_of_contents, *shape) if field else {},
        worker.run(widest, worker.sizes_of_imaging) if field and DATA.is_dir() else {},
        worker.run(widest, worker.threads, pictures, effort) if len(os.sched_getaffinity(0)) > 1 else {},
    )


def told(run: Run) -> Measured:
    """The figures, in the order of their goals, and the tables of all codecs."""
    figures = [*_shares(run), _size(run), *_ratios(run), *_worst(run), _threads(run)]
    figures.sort(key=lambda figure: list(GOALS).index(figure.name))
    return Measured(figures, [_speeds(run), *_imaging(run)])


def _figure(
    name: str, value: float | None, n: int, peers: Mapping[str, float] | None = None, *, reason: str = ""
) -> Figure:
    goal, better = GOALS[name]
    return Figure(name, value, "", goal, better, n, dict(peers or {}), "" if value is not None else reason)


def _shares(run: Run) -> list[Figure]:
    figures = []
    for short, model in MODELS.items():
        for kernels in ("avx2", "avx512"):
            lacking = f"no {TITLES[kernels]}"
            for way in ("encode", "decode"):
                name = f"{short}_{way}_{kernels}_of_memcpy"
                if kernels not in run.camera:
                    figures.append(_figure(name, None, 0, reason=lacking))
                    continue
                speed = _way(run.camera[kernels][model], way)
                field = {peer: _way(result, way).of_memcpy for peer, result in run.field.items()}
                figures.append(_figure(name, speed.of_memcpy, speed.n, field if short == "felics" else {}))
    return figures


def _way(result: Result, way: str) -> Speed:
    return result.encode if way == "encode" else result.decode


def _size(run: Run) -> Figure:
    name = "ls_size_of_jpegls10"
    if not run.real or JPEG_LS not in run.field:
        return _figure(name, None, 0, reason="no photographs")
    start = len(run.pictures) - run.real
    base = run.size(JPEG_LS, start)
    others = {peer: run.size(peer, start) / base for peer in ("felics", *run.field) if peer != JPEG_LS}
    return _figure(name, run.size("felics-ls", start) / base, run.real, others)


def _ratios(run: Run) -> list[Figure]:
    """Of shares of memcpy, for the load on a machine changes from one process to the next.

    Ours is with the widest kernels that there are, as JPEG XL chooses its own.
    """
    ours = run.camera[run.widest]["felics"].encode
    scalar = run.camera["scalar"]["felics"].encode.of_memcpy
    over_scalar = ours.of_memcpy / scalar if run.widest != "scalar" else None
    jxl = {name: run.field[name].encode.of_memcpy for name in (JXL_E1,) if name in run.field}
    over_jxl = ours.of_memcpy / jxl[JXL_E1] if jxl else None
    return [
        _figure(
            "felics_encode_over_scalar", over_scalar, ours.n, {"scalar of memcpy": scalar}, reason="no AVX2"
        ),
        _figure("felics_encode_over_jxl_e1", over_jxl, ours.n, jxl, reason="no JPEG XL"),
    ]


def _worst(run: Run) -> list[Figure]:
    speeds = {
        kind: [speed for result in results.values() for speed in (result.encode, result.decode)]
        for kind, results in run.contents.items()
    }
    slowest = {kind: min(speed.of_memcpy for speed in found) for kind, found in speeds.items()}
    packed = run.pictures[0].packed_bytes
    sizes = {
        model: [
            *(size / packed for results in run.contents.values() for size in results[model].sizes),
            *(size / packed for size in run.camera[run.widest][model].sizes),
            *run.imaging.get(model, {}).values(),
        ]
        for model in MODELS.values()
    }
    return [
        _figure(
            "worst_content_of_memcpy", min(slowest.values()) if run.contents_on == "avx2" else None,
            sum(speed.n for found in speeds.values() for speed in found), slowest, reason="no AVX2",
        ),
        _figure(
            "worst_size_of_packed", max(map(max, sizes.values())), sum(map(len, sizes.values())),
            run.field_on_contents,
        ),
    ]  # fmt: skip


def _threads(run: Run) -> Figure:
    if not run.threads:
        return _figure("threads2_speedup", None, 0, reason="one core")
    one, pair = run.threads["one thread"], run.threads["two frames at once"]
    return _figure(
        "threads2_speedup", run.threads["two threads"].fps / one.fps, one.n,
        {"two frames at once": pair.fps / one.fps},
    )  # fmt: skip


def _speeds(run: Run) -> Table:
    results = {
        f"{model} {TITLES[kernels]}": (found[model], run.size(model))
        for kernels, found in run.camera.items()
        for model in MODELS.values()
    } | {name: (result, run.size(name)) for name, result in run.field.items()}
    real = f"{run.real} of them photographs and video" if run.real else "all rendered: no photographs here"
    return Table(
        f"One core; means over {len(run.pictures)} pictures of 1280x1024 and 10 bits, {real}.",
        ("codec", "encode, frames/s", "of memcpy", "decode, frames/s", "of memcpy", "size of packed"),
        [
            (
                name,
                result.encode.fps,
                result.encode.of_memcpy,
                result.decode.fps,
                result.decode.of_memcpy,
                size,
            )
            for name, (result, size) in results.items()
        ],
        HEADLINE,
    )


def _imaging(run: Run) -> list[Table]:
    if not run.imaging:
        return []
    pictures = run.imaging[JPEG_LS]
    return [
        Table(
            "Medical and depth images, size of packed at their own depths; felics-ls takes up to 12 bits.",
            ("picture", *run.imaging),
            [(name, *(sizes.get(name, "") for sizes in run.imaging.values())) for name in pictures],
        )
    ]


if __name__ == "__main__":
    report("codec", measure)
