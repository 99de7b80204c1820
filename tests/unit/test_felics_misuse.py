"""Arrays and buffers that a caller should not pass: an error or the right result, never a broken process."""

import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recorder import codec, kernels


def picture(height: int = 40, width: int = 50) -> NDArray[np.uint16]:
    return (np.arange(height * width).reshape(height, width) % 1024).astype(np.uint16)


def run(script: str) -> str:
    """A process of its own: a broken one must fail this test alone."""
    command = [sys.executable, "-c", textwrap.dedent(script)]
    result = subprocess.run(command, check=False, capture_output=True, text=True)
    assert result.returncode == 0, (result.returncode, result.stderr)
    return result.stdout


@pytest.mark.parametrize(
    ("model", "bits"), [("raw", 1), ("felics", 1), ("felics", 10), ("felics-ls", 1), ("felics-ls", 12)]
)
def test_an_image_changed_by_another_thread_breaks_nothing(model: str, bits: int) -> None:
    run(f"""
        import threading, time
        import numpy as np
        from recorder import codec

        image = np.zeros((256, 1024), np.uint16)
        noise = np.random.default_rng(1).integers(0, 65536, image.shape).astype(np.uint16)
        tables = codec.train(image, bit_depth={bits}, model={model!r})
        done = threading.Event()

        def disturb():
            while not done.is_set():
                image[:] = noise
                image[:] = 0

        other = threading.Thread(target=disturb)
        other.start()
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            for given in (None, tables):
                try:
                    codec.encode(image, bit_depth={bits}, model={model!r}, tables=given)
                except ValueError:
                    pass
        done.set()
        other.join()
    """)


def test_bytes_changed_by_another_thread_break_nothing() -> None:
    outcomes = run("""
        import threading, time
        import numpy as np
        from recorder import codec
        from recorder.errors import CodecError

        levels = np.cumsum(np.random.default_rng(1).integers(-3, 4, (200, 400)), 1) + 512
        image = levels.clip(0, 1023).astype(np.uint16)
        sound = np.frombuffer(codec.encode(image), np.uint8)
        data = sound.copy()
        done = threading.Event()

        def disturb():
            rng = np.random.default_rng(2)
            while not done.is_set():
                data[rng.integers(0, data.size, 8)] = rng.choice([0, 0xE9, 0xFF], 8)
                data[:] = sound

        other = threading.Thread(target=disturb)
        other.start()
        end = time.monotonic() + 1.5
        right = refused = 0
        while time.monotonic() < end:
            try:
                right += np.array_equal(codec.decode(data), image)
            except CodecError:
                refused += 1
        done.set()
        other.join()
        print(right > 0, refused > 0)
    """)
    assert outcomes.split() == ["True", "True"]


def test_an_output_may_overlap_the_image() -> None:
    memory = np.zeros(20_000, np.uint8)
    image = memory[:4000].view(np.uint16).reshape(40, 50)
    image[:] = picture()
    size = codec.encode_into(image, memory)
    assert memory[:size].tobytes() == codec.encode(picture())


def test_pixels_may_overlap_the_data() -> None:
    data = codec.encode(picture())
    memory = np.zeros(2000, np.uint16)
    octets = memory.view(np.uint8)
    octets[: len(data)] = np.frombuffer(data, np.uint8)
    kernels.felics_decode_into(octets[: len(data)], memory.reshape(40, 50))
    assert np.array_equal(memory.reshape(40, 50), picture())


def test_a_read_only_image_is_encoded() -> None:
    image = picture()
    image.flags.writeable = False
    assert np.array_equal(codec.decode(codec.encode(image)), image)


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((40, 50), np.int16),
        np.zeros((40, 50), ">u2"),
        np.zeros(2000, np.uint16),
        np.zeros((40, 100), np.uint16)[:, ::2],
        np.broadcast_to(np.zeros(1, np.uint16), (40, 50)),
        np.zeros((40, 49), np.uint16),
        np.zeros((0, 0), np.uint16),
    ],
)
def test_pixels_of_another_kind_are_refused(out: NDArray[np.uint16]) -> None:
    with pytest.raises((TypeError, ValueError)):
        kernels.felics_decode_into(codec.encode(picture()), out)
    assert not out.any()


def test_read_only_pixels_are_refused() -> None:
    out = np.zeros((40, 50), np.uint16)
    out.flags.writeable = False
    with pytest.raises(TypeError):
        kernels.felics_decode_into(codec.encode(picture()), out)
    with pytest.raises(TypeError):
        kernels.unpack_mono10p(bytes(2500), out)


@pytest.mark.parametrize(
    ("model", "tables"),
    [("raw", bytes(17)), ("felics", bytes(16)), ("felics", b"\x0f" * 17), ("felics-ls", b"\xff" * 224)],
)
def test_tables_that_do_not_fit_are_refused(model: codec.Model, tables: bytes) -> None:
    with pytest.raises(ValueError, match="table"):
        codec.encode(picture(), model=model, tables=tables)


@pytest.mark.parametrize("data", [memoryview(bytes(100))[::2], "text", None, 5])
def test_what_is_no_contiguous_buffer_is_refused(data: Any) -> None:
    for read in (codec.decode, codec.read_header, lambda data: list(codec.walk(data))):
        with pytest.raises((TypeError, BufferError)):
            read(data)


def test_a_stream_is_walked_by_bytes() -> None:
    data = codec.encode(picture())
    data += bytes(len(data) % 2)
    for view in (np.frombuffer(data, np.uint16), np.frombuffer(data, np.uint8).reshape(2, -1)):
        with pytest.raises(ValueError, match="single bytes"):
            list(codec.walk(view))
    views: list[Any] = [np.frombuffer(data, np.int8), memoryview(data).cast("c")]
    for bytewise in views:
        assert [where.start for where in codec.walk(bytewise)] == [0]


def test_a_stream_may_be_cut_while_it_is_walked() -> None:
    data = codec.encode(picture())
    stream = bytearray(3 * data)
    walk = codec.walk(stream)
    assert next(walk) == slice(0, len(data))
    del stream[len(data) + 9 :]
    assert list(walk) == []


@pytest.mark.parametrize(("width", "height"), [(0, 4), (4, 0), (65536, 1), (1, 65536), (65535, 65535)])
def test_only_images_have_a_largest_size(width: int, height: int) -> None:
    with pytest.raises(ValueError, match="65535 pixels"):
        codec.max_encoded_size(width, height)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_a_refused_giant_leaves_no_memory_behind() -> None:
    grown = run("""
        import resource
        import numpy as np
        from recorder import codec
        from recorder.errors import CodecError

        def resident():
            with open("/proc/self/statm") as file:
                return int(file.read().split()[1]) * resource.getpagesize() >> 20

        data = codec.encode(np.zeros((40, 50), np.uint16))
        giant = data[:-2] + bytes(200 << 20) + data[-2:]
        before = resident()
        try:
            codec.decode(giant)
        except CodecError:
            print(resident() - before)
    """)
    assert int(grown) < 70
