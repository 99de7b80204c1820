"""recorder.toml: what is refused, and how it is told."""

from pathlib import Path
from typing import Any

import pytest

from recorder.config import Settings, load, parse
from recorder.errors import ConfigError

CAMERA = {"drivers": {"camera": {"front": {"source": "genicam://"}}}}


def problem(values: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as caught:
        parse(values, where="recorder.toml")
    return str(caught.value)


def test_three_lines_are_enough(tmp_path: Path) -> None:
    file = tmp_path / "recorder.toml"
    file.write_text('[drivers.camera.front]\nsource = "genicam://"\n')
    settings = load(file)
    assert settings.drivers.camera["front"].source == "genicam://"
    assert settings.storage.segment_seconds == 60


def test_an_unknown_key_is_told_with_its_path_and_the_known_ones() -> None:
    line = problem({**CAMERA, "storage": {"sync": 1}})
    assert line.startswith("recorder.toml: storage.sync: unknown key, known here: out, segment_seconds")


def test_an_unknown_key_of_a_camera_is_told() -> None:
    line = problem({"drivers": {"camera": {"front": {"source": "x", "exposure": 3}}}})
    assert "drivers.camera.front.exposure: unknown key" in line
    assert "exposure_us" in line


def test_a_bad_value_is_told_with_what_would_be_right() -> None:
    line = problem({"drivers": {"gnss": {"source": "x", "baud": 9601}}})
    assert "drivers.gnss.baud = 9601: input should be 'auto', 4800, 9600" in line


def test_both_alternatives_of_a_union_are_told_once() -> None:
    line = problem({**CAMERA, "codec": {"k": "best"}})
    assert line.count("codec.k") == 1
    assert "'trained' or 'context', or" in line


def test_a_missing_value_is_told() -> None:
    assert "drivers.gnss.source: missing" in problem({"drivers": {"gnss": {}}})


def test_an_unknown_camera_is_told() -> None:
    assert "camera 'back' is not one of front, tag" in problem(
        {"drivers": {"camera": {"back": {"source": "x"}}}}
    )


def test_nothing_to_record_is_told() -> None:
    assert "no device: add [drivers.camera.front]" in problem({})


def test_all_problems_are_told_in_one_line() -> None:
    line = problem({**CAMERA, "foo": 1, "storage": {"segment_seconds": 0}})
    assert "\n" not in line
    assert "foo: unknown key" in line
    assert "storage.segment_seconds = 0" in line


@pytest.mark.parametrize("text", ["= 3", "[drivers", "a = 1\na = 2"])
def test_what_is_not_toml_is_told_with_its_place(tmp_path: Path, text: str) -> None:
    file = tmp_path / "recorder.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match="not TOML"):
        load(file)


def test_a_missing_file_a_folder_and_bytes_are_told(tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "none.toml", tmp_path, tmp_path / "binary.toml"):
        with pytest.raises(ConfigError, match=str(path)):
            load(path)


def test_the_effective_configuration_reads_back_the_same() -> None:
    settings = parse(CAMERA, where="here")
    assert Settings.model_validate_json(settings.to_json()) == settings
