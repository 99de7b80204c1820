"""What is measured in a process of its own: the kernels choose their instructions when one starts."""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from codec_bench.codecs import JPEG_LS, Codec, felics, jpeg_ls, memcpy, peers
from codec_bench.pictures import CONTENTS, Picture, content, imaging
from codec_bench.race import Effort, Result, Speed, coded, in_turns, one_core, race
from figures import ROOT

from recorder import codec

SETS = ("scalar", "avx2", "avx512")
"""Instructions that the kernels know, in the order of their power."""

Told = TypeVar("Told")


def available() -> list[str]:
    """Those of ``SETS`` that this processor has."""
    command = [sys.executable, "-c", "import recorder.kernels"]
    return [
        name
        for name in SETS
        if not subprocess.run(command, env=_environment(name), capture_output=True, check=False).returncode
    ]


def run(kernels: str, task: Callable[..., Told], *args: Any, **kwargs: Any) -> Told:
    """Calls a function of this module in a new process with these kernels."""
    done = subprocess.run(
        [sys.executable, "-m", "codec_bench.worker"],
        input=pickle.dumps((task.__name__, args, kwargs)),
        stdout=subprocess.PIPE,
        env=_environment(kernels),
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"measuring with the {kernels} kernels failed")
    told: Told = pickle.loads(done.stdout)
    return told


def _environment(kernels: str) -> dict[str, str]:
    return os.environ | {"RECORDER_KERNELS": kernels, "PYTHONPATH": str(ROOT / "tools" / "bench")}


def camera(pictures: Sequence[Picture], effort: Effort, *, field: bool) -> dict[str, Result]:
    """Both models on camera frames, one core; with the ``field`` also all others, by name."""
    one_core()
    runners = [felics("felics"), felics("felics-ls")]
    if field:
        shape = pictures[0].pixels.shape
        runners += [felics("felics", fresh=True), felics("felics-ls", fresh=True)]
        runners += [*peers(*shape), memcpy(*shape)]
    return race(runners, pictures, effort)


def contents(count: int, height: int, width: int, effort: Effort) -> dict[str, dict[str, Result]]:
    """Both models on every content that is made to hurt, one core."""
    one_core()
    ours = [felics("felics"), felics("felics-ls")]
    return {kind: race(ours, content(kind, count, height, width), effort) for kind in CONTENTS}


def sizes_of_contents(height: int, width: int) -> dict[str, float]:
    """The largest size of packed that each of the field makes of any content."""
    pictures = list(chain.from_iterable(content(kind, 1, height, width) for kind in CONTENTS))
    return {peer.name: max(_sizes(peer, pictures).values()) for peer in peers(height, width)}


def sizes_of_imaging() -> dict[str, dict[str, float]]:
    """Size of packed of medical and depth images, by codec and name; felics-ls takes 12 bits at most."""
    pictures = list(imaging())
    narrow = [picture for picture in pictures if picture.bit_depth <= 12]
    return {
        "felics": _sizes(felics("felics"), pictures),
        "felics-ls": _sizes(felics("felics-ls"), narrow),
        JPEG_LS: _sizes(jpeg_ls(), pictures),
    }


def _sizes(runner: Codec, pictures: Sequence[Picture]) -> dict[str, float]:
    streams = coded(runner, pictures)
    return {
        picture.name: len(data) / picture.packed_bytes
        for data, picture in zip(streams, pictures, strict=True)
    }


def threads(pictures: Sequence[Picture], effort: Effort) -> dict[str, Speed]:
    """Encoding with one thread and with two, on all cores; and two frames at once, one thread each."""
    tables = [codec.train(picture.pixels, model="felics") for picture in pictures]
    height, width = pictures[0].pixels.shape
    outs = [np.empty(codec.max_encoded_size(width, height), np.uint8) for _ in range(2)]

    def encode(number: int, out: int = 0, **options: Any) -> None:
        codec.encode_into(
            pictures[number].pixels, outs[out], model="felics", tables=tables[number], **options
        )

    def every_second(start: int) -> None:
        for number in range(start, len(pictures), 2):
            encode(number, start)

    with ThreadPoolExecutor(2) as pool:

        def both(number: int) -> None:
            """The whole pass when it begins, and nothing after."""
            if number == 0:
                list(pool.map(every_second, (0, 1)))

        calls: dict[str, Callable[[int], object]] = {
            "one thread": encode,
            "two threads": lambda number: encode(number, threads=2),
            "two frames at once": both,
        }
        return in_turns(calls, pictures, effort)


def main() -> None:
    """Reads a function's name and arguments from standard input, writes its result to standard output."""
    task, args, kwargs = pickle.load(sys.stdin.buffer)
    told: Any = globals()[task](*args, **kwargs)
    sys.stdout.buffer.write(pickle.dumps(told))


if __name__ == "__main__":
    main()
