"""The codec's bench tells what it promised to tell, and measures only what is lossless."""

import json
from pathlib import Path

import codec as bench
import numpy as np
import pytest
from codec_bench.codecs import Codec, felics, peers
from codec_bench.pictures import CONTENTS, content
from codec_bench.race import Effort, coded
from figures import Measured, Table, as_json, as_markdown, with_headlines

README = Path(__file__).resolve().parents[2] / "README.md"
BRIEFLY = Effort(passes=1, least=1, seconds=0.0)
TINY = 64, 128
GOALS = {
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


def test_every_figure_is_told_with_its_goal_and_what_has_no_value_with_a_reason() -> None:
    pictures = content("ramps", 2, *TINY)
    told = as_json("codec", bench.told(bench.ran(pictures, 0, 2, BRIEFLY, field=False)))
    assert json.loads(json.dumps(told)) is not None
    figures = {figure["name"]: figure for figure in told["figures"]}
    assert {name: (figure["goal"], figure["better"]) for name, figure in figures.items()} == GOALS
    for figure in figures.values():
        assert (figure["value"] is None) == bool(figure["reason"]), figure
        assert figure["value"] is not None or not figure["meets"], figure
    assert figures["ls_size_of_jpegls10"]["reason"] == "no photographs"
    assert figures["worst_size_of_packed"]["value"] > 0.1
    assert figures["worst_size_of_packed"]["n"] == 2 * (2 * len(CONTENTS) + len(pictures))
    assert "| not measurable here: no photographs |" in as_markdown(told)


@pytest.mark.parametrize("spoilt", [0, -1])
def test_a_codec_that_changes_a_pixel_ends_the_bench(spoilt: int) -> None:
    sound = felics("felics")

    def decode(data: bytes) -> np.ndarray:
        pixels = sound.decode(data)
        pixels.flat[spoilt] ^= 1
        return pixels

    with pytest.raises(SystemExit, match="lossy is not lossless on noise 0"):
        coded(Codec("lossy", sound.encode, decode), content("noise", 1, *TINY))


@pytest.mark.parametrize("kind", ["noise", "zeros", "saturated"])
def test_every_peer_is_lossless(kind: str) -> None:
    pytest.importorskip("jpeg_ls", reason="the peers of the benches come with make bench")
    for peer in peers(*TINY):
        assert coded(peer, content(kind, 1, *TINY))


def test_the_readmes_table_is_measured_anew_and_nothing_else_is_touched() -> None:
    table = Table(
        "One core.", ("codec", "frames/s"), [("felics AVX2", 812.34), ("LERC", 5.0)], ("felics AVX2",)
    )
    aside = Table("Aside.", ("codec", "frames/s"), [("LERC", 5.0)])
    told = as_json("codec", Measured([], [table, aside]))
    readme = README.read_text(encoding="utf-8")
    once = with_headlines(readme, told)
    assert "| felics AVX2 | 812 |" in once
    assert "| LERC |" not in once
    assert "Aside." not in once
    assert with_headlines(once, told) == once
    begin, end = "<!-- codec: written by make bench -->", "<!-- codec: end -->"
    assert once.partition(begin)[0] == readme.partition(begin)[0]
    assert once.partition(end)[2] == readme.partition(end)[2]
    assert with_headlines("no marks", told) == "no marks"
