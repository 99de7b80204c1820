"""How fast calls are beside memcpy: passes over many pictures, taken in turns."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from codec_bench.codecs import Codec
from codec_bench.pictures import Picture


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to measure: so many passes, or as many as take ``seconds``, but at least ``least``."""

    passes: int
    least: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Speed:
    """Medians over passes."""

    fps: float
    of_memcpy: float
    """Share of memcpy's frames/s in the pass right before each."""
    n: int
    """Calls that were timed."""


@dataclass(frozen=True, slots=True)
class Result:
    """One codec on one list of pictures, each of which it gave back as it was."""

    encode: Speed
    decode: Speed
    sizes: tuple[int, ...]


def one_core() -> None:
    """Holds this process to one core for good."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def coded(codec: Codec, pictures: Sequence[Picture]) -> list[bytes]:
    """Every picture encoded; ends the run if one does not decode to the same pixels."""
    streams = []
    for picture in pictures:
        data = bytes(codec.encode(picture))
        if not np.array_equal(codec.decode(data), picture.pixels):
            raise SystemExit(f"{codec.name} is not lossless on {picture.name}")
        streams.append(data)
    return streams


def race(codecs: Sequence[Codec], pictures: Sequence[Picture], effort: Effort) -> dict[str, Result]:
    """All codecs on the same pictures, by name."""
    streams = {codec.name: coded(codec, pictures) for codec in codecs}
    calls: dict[str, Callable[[int], object]] = {}
    for codec in codecs:
        calls[f"encode {codec.name}"] = _encoding(codec, pictures)
        calls[f"decode {codec.name}"] = _decoding(codec, streams[codec.name])
    speeds = in_turns(calls, pictures, effort)
    return {
        name: Result(speeds[f"encode {name}"], speeds[f"decode {name}"], tuple(map(len, data)))
        for name, data in streams.items()
    }


def in_turns(
    calls: Mapping[str, Callable[[int], object]], pictures: Sequence[Picture], effort: Effort
) -> dict[str, Speed]:
    """The speed of each call, which is given the number of a picture.

    A pass takes every picture once, so each is cold again when its turn comes; before each pass
    memcpy does the same. What is slow has fewer passes, spread over the whole time.
    """
    copy = np.empty_like(pictures[0].pixels)
    times: dict[str, list[float]] = {name: [] for name in calls}
    copies: dict[str, list[float]] = {name: [] for name in calls}
    numbers = range(len(pictures))
    for turn in range(effort.passes):
        for name, call in calls.items():
            if turn and not _due(turn, times[name][0], effort):
                continue
            copies[name].append(_pass(lambda number: np.copyto(copy, pictures[number].pixels), numbers))
            times[name].append(_pass(call, numbers))
    return {
        name: Speed(
            len(pictures) / median(taken),
            median(copied / own for copied, own in zip(copies[name], taken, strict=True)),
            len(taken) * len(pictures),
        )
        for name, taken in times.items()
    }


def _due(turn: int, pass_s: float, effort: Effort) -> bool:
    passes = min(max(effort.least, int(effort.seconds / pass_s)), effort.passes)
    return turn * passes // effort.passes > (turn - 1) * passes // effort.passes


def _pass(call: Callable[[int], object], numbers: range) -> float:
    before = time.perf_counter()
    for number in numbers:
        call(number)
    return time.perf_counter() - before


def _encoding(codec: Codec, pictures: Sequence[Picture]) -> Callable[[int], object]:
    return lambda number: codec.encode(pictures[number])


def _decoding(codec: Codec, streams: Sequence[bytes]) -> Callable[[int], object]:
    return lambda number: codec.decode(streams[number])
