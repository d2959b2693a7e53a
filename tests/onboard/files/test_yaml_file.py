"""Files are read strictly, and what is wrong with one is said in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, model_validator

from onboard.files import yaml_file
from onboard.files.yaml_file import (
    FileError,
    FileModel,
    dump_document,
    load_yaml,
    parse_document,
    parse_value,
    read_mapping,
    read_text,
    refuse_renamed_keys,
    unit_of,
    validate,
)


class Door(FileModel):
    """A part of a file."""

    width_m: float = Field(gt=0.0)

    @model_validator(mode="before")
    @classmethod
    def _refuse_renamed_keys(cls, data: Any) -> Any:
        return refuse_renamed_keys(data, {"breadth_m": "width_m"})


class Shed(FileModel):
    """A whole file."""

    height_m: float
    door: Door = Door(width_m=1.0)
    name: str = "shed"

    @model_validator(mode="before")
    @classmethod
    def _refuse_renamed_keys(cls, data: Any) -> Any:
        return refuse_renamed_keys(data, {"height": "height_m"})


def problem_of(document: Any) -> str:
    with pytest.raises(FileError) as caught:
        validate(document, Shed, source="shed.yaml")
    message = str(caught.value)
    assert message.startswith("shed.yaml: ")
    assert "\n" not in message
    return message.removeprefix("shed.yaml: ")


@given(st.floats(allow_nan=False, allow_infinity=False, width=32) | st.booleans())
def test_scalars_are_read_as_yaml_reads_them(value: float) -> None:
    assert parse_document(dump_document(value), source="here") == value


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("vehicle: {roll_max_deg: 1, roll_max_deg: 2}", "key 'roll_max_deg' is given twice"),
        ("vehicle: [", "is not valid YAML"),
        ("- 1\n- 2\n", "expected keys and values, found [1, 2]"),
        ("", "expected keys and values, found nothing"),
        ("a: !!python/object/apply:os.system ['true']", "os.system is not used in these files"),
        (b"\xff\xfe\x00", "is not UTF-8 text (byte 0)"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, text: str | bytes, problem: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FileError) as caught:
        read_mapping(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert problem in message
    assert "\n" not in message


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.yaml: cannot be read: No such file"):
        load_yaml(tmp_path / "none.yaml", Shed)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("cruise_speed_mps", "m/s"),
        ("jerk_mps3", "m/s³"),
        ("limit_mps2", "m/s²"),
        ("roll_max_deg", "°"),
        ("end_ned_m", "m"),
        ("reaction_time_s", "s"),
        ("thrust_to_weight", "times the weight"),
        ("stop", ""),
    ],
)
def test_the_suffix_is_the_unit(key: str, unit: str) -> None:
    assert unit_of(key) == unit


def test_a_file_becomes_a_model(tmp_path: Path) -> None:
    path = tmp_path / "shed.yaml"
    path.write_text("height_m: 2.5\ndoor: {width_m: 0.9}\n", encoding="utf-8")
    assert load_yaml(path, Shed) == Shed(height_m=2.5, door=Door(width_m=0.9))


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ({}, "height_m [m] is missing"),
        ({"height_m": 2.0, "colour": "red"}, "colour is not a known key (value 'red')"),
        ({"height_m": "2"}, "height_m [m] = '2': input should be a valid number"),
        (
            {"height_m": 2.0, "door": {"width_m": 0.0}},
            "door.width_m [m] = 0.0: input should be greater than 0",
        ),
        ([1.0], "(the whole file) = [1.0]: input should be a valid dictionary"),
        ({"height": 2.0}, "height is now called height_m"),
        (
            {"height_m": 2.0, "door": {"breadth_m": 1.0}},
            "door.breadth_m is now called door.width_m",
        ),
    ],
)
def test_a_problem_names_key_unit_value_and_what_is_expected(document: Any, problem: str) -> None:
    assert problem_of(document).startswith(problem)


def test_all_problems_are_in_one_line() -> None:
    assert problem_of({"door": {"width_m": -1.0}, "name": 3}).count("; ") == 2


def test_a_list_is_not_short_of_items_that_are_wrong_themselves() -> None:
    class Street(FileModel):
        sheds: tuple[Shed, ...] = Field(strict=False, min_length=2)

    def problem_with(*sheds: dict[str, float]) -> str:
        with pytest.raises(FileError) as caught:
            validate({"sheds": sheds}, Street, source="street.yaml")
        return str(caught.value)

    sound, wrong = {"height_m": 2.0}, {"height_m": float("nan")}
    assert "items" not in problem_with(wrong, wrong)
    assert "at least 2 items" in problem_with(sound)


def test_a_long_value_is_shortened() -> None:
    message = problem_of({"height_m": 2.0, "name": ["x" * 500]})
    assert len(message) < 150
    assert "..." in message


@pytest.mark.parametrize("data", [None, [], "text", 3, {}, {"new": 1}])
def test_what_has_no_old_key_passes_unchanged(data: Any) -> None:
    assert refuse_renamed_keys(data, {"old": "new"}) is data


@pytest.mark.parametrize(
    ("text", "value"), [("3", 3), ("2.5", 2.5), ("true", True), ("[1, a]", [1, "a"]), ("", None)]
)
def test_values_on_a_command_line(text: str, value: Any) -> None:
    assert parse_value(text, source="--set x") == value


@pytest.mark.parametrize("text", ["[1", "014", "a: b: c"])
def test_values_that_cannot_be_read_name_their_source(text: str) -> None:
    with pytest.raises(FileError, match=r"--set x: ") as caught:
        parse_value(text, source="--set x")
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "marked.yaml"
    path.write_bytes("a: ä\n".encode("utf-8-sig"))
    assert read_text(path) == "a: ä\n"
    assert read_mapping(path) == {"a": "ä"}


def test_a_file_beyond_the_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(yaml_file, "FILE_BYTES_MAX", 2_000_000)
    path = tmp_path / "large.yaml"
    path.write_bytes(b"#" * 2_000_000)
    assert len(read_text(path)) == 2_000_000
    path.write_bytes(b"#" * 2_000_001)
    with pytest.raises(FileError, match=r"large\.yaml: is larger than 2 MB"):
        read_text(path)
