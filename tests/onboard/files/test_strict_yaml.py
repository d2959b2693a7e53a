"""Every value in a file has one meaning, or is refused in one line with line, key and value."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files import yaml_file
from onboard.files.obstacle_field import load_field
from onboard.files.strict_yaml import ALIASED_VALUES_MAX, DEPTH_MAX
from onboard.files.yaml_file import (
    FileError,
    dump_document,
    parse_document,
    parse_value,
    read_document,
    read_mapping,
)

VALUES = {
    "1e3": 1000.0,
    "1E3": 1000.0,
    "1.5e3": 1500.0,
    "-1e-3": -0.001,
    "+1e+3": 1000.0,
    "1.e2": 100.0,
    ".5e1": 5.0,
    ".5": 0.5,
    "-.5": -0.5,
    "+.5": 0.5,
    "5.": 5.0,
    "+5": 5,
    "-0": 0,
    "0": 0,
    "0.30": 0.3,
    "08.5": 8.5,
    ".inf": math.inf,
    "-.inf": -math.inf,
    "+.INF": math.inf,
    "~": None,
    "": None,
    "null": None,
    "true": True,
    "False": False,
    # Words in YAML 1.2; where a boolean or a number belongs, the model says so.
    "yes": "yes",
    "on": "on",
    "NO": "NO",
    "y": "y",
    "nan": "nan",
    "inf": "inf",
    "1,5": "1,5",
    "1.2.3": "1.2.3",
    "1e": "1e",
    "e3": "e3",
    "=": "=",
    "127.0.0.1:7447": "127.0.0.1:7447",
    "udpin://0.0.0.0:14540": "udpin://0.0.0.0:14540",
    "2.8 m/s": "2.8 m/s",
    "'014'": "014",
    '"1:30"': "1:30",
    "'2026-13-45'": "2026-13-45",
    "!!str 1e3": "1e3",
    "!!float 5": 5.0,
    "[0.2, 1e-1]": [0.2, 0.1],
}


@pytest.mark.parametrize("text", VALUES)
@pytest.mark.parametrize("read", [parse_document, parse_value])
def test_one_meaning(text: str, read: Any) -> None:
    value = read(text, source="here")
    assert value == VALUES[text]
    assert type(value) is type(VALUES[text])


def test_nan_is_a_number_that_models_refuse() -> None:
    assert math.isnan(parse_document(".nan", source="here"))


AMBIGUOUS = (
    "014",
    "00",
    "-07",
    "08",
    "0x1f",
    "-0x1F",
    "0o17",
    "0b1",
    "1_000",
    "1_000.5",
    "0_1",
    "1_0e3",
    "1:30",
    "-1:30",
    "1:30:00.5",
    "190:20:30",
    "2026-11-29",
    "2026-13-45",
    "2026-1-2",
    "2026-11-29T10:61:00Z",
    "2026-11-29 10:00:00 +1",
)


@pytest.mark.parametrize("text", AMBIGUOUS)
def test_what_versions_of_yaml_read_differently_is_refused(text: str) -> None:
    expected = f"here: line 3: a.b: {text} has more than one meaning in YAML"
    with pytest.raises(FileError) as refused:
        parse_document(f"# comment\na:\n  b: {text}\n", source="here")
    assert str(refused.value).startswith(expected)
    assert "quote it" in str(refused.value)
    with pytest.raises(FileError, match=r"line 1: a\.1: "):
        parse_document(f"a: [1, {text}]", source="here")
    with pytest.raises(FileError, match="line 1: "):
        parse_document(f"? {text}\n: 1", source="here")
    with pytest.raises(FileError) as refused:
        parse_value(text, source="--set a.b")
    assert str(refused.value).startswith(f"--set a.b: {text} has more than one meaning")


LAUGHS = "a: &a0 [1, 1]\n" + "".join(
    f"b{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 10)
)
MERGED_LAUGHS = "a: &a0 {k: 1}\n" + "".join(
    f"b{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}\n" for n in range(1, 10)
)

REFUSED = {
    "? [a, b]\n: 1": "line 1: a key must be a word, not a list",
    "a:\n  ? {b: 1}\n  : 1": "line 2: a: a key must be a word, not a mapping",
    "a: 1\na: 2": "line 2: key 'a' is given twice",
    "a: 1\n'a': 2": "line 2: key 'a' is given twice",
    "b: {a: 1, a: 1}": "line 1: b: key 'a' is given twice",
    "a: {<<: {b: 1}, <<: {c: 1}}": "key '<<' is given twice",
    "a: &a [*a]": "line 1: a.0: contains itself",
    "a: &a {b: *a}": "line 1: a.b: contains itself",
    LAUGHS: f"aliases repeat more than {ALIASED_VALUES_MAX:,} values",
    MERGED_LAUGHS: f"aliases repeat more than {ALIASED_VALUES_MAX:,} values",
    "[" * 10_000: f"nested more than {DEPTH_MAX} levels deep",
    "[" * 300 + "]" * 300: f"nested more than {DEPTH_MAX} levels deep",
    "- " * 300 + "1": f"nested more than {DEPTH_MAX} levels deep",
    "{a: " * 300 + "1" + "}" * 300: f"nested more than {DEPTH_MAX} levels deep",
    "a: 1e999": "a: 1e999 is too large a number",
    "a: " + "9" * 5000: "is too large a number",
    "a: !!int 0x1f": "a: 0x1f is not a number",
    "a: !!float abc": "a: abc is not a number",
    "<<: 1": "line 1: << takes a mapping, or a list of mappings",
    "a: [{<<: [{b: 1}, 2]}]": "line 1: a.0: << takes a mapping, or a list of mappings",
    "a: <<": "line 1: a: << outside a mapping is not used in these files",
    "a: *nowhere": "found undefined alias 'nowhere'",
    "a: !!python/object/apply:os.system [x]": "a: tag !!python/object/apply:os.system is not",
    "a: !!binary aGVsbG8=": "a: tag !!binary is not used",
    "a: !!timestamp 2026-11-29": "a: tag !!timestamp is not used",
    "a: 1\n---\na: 2": "expected a single document",
    "a:\n\tb: 1": "found character '\\t'",
    "a: b: c": "mapping values are not allowed here",
    "a: \x00": "special characters are not allowed",
    "vehicle: [unclosed": "is not valid YAML",
}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: repr(text[:30]))
def test_what_cannot_be_read_is_one_line(text: str) -> None:
    with pytest.raises(FileError) as refused:
        parse_document(text, source="here")
    message = str(refused.value)
    assert message.startswith("here: ")
    assert REFUSED[text] in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("- &t {a: 1, b: 2}\n- {<<: *t, b: 3}", [{"a": 1, "b": 2}, {"a": 1, "b": 3}]),
        ("- &t {a: 1}\n- {b: 3, <<: *t}", [{"a": 1}, {"a": 1, "b": 3}]),
        ("- &s {a: 1}\n- &t {a: 2}\n- <<: [*s, *t]", [{"a": 1}, {"a": 2}, {"a": 1}]),
        ("'<<': 1", {"<<": 1}),
        ("a: &a [1, 2]\nb: *a", {"a": [1, 2], "b": [1, 2]}),
    ],
)  # fmt: skip
def test_merges_and_aliases_work(text: str, value: Any) -> None:
    assert parse_document(text, source="here") == value


def test_a_field_of_merged_trees_is_read(tmp_path: Path) -> None:
    path = tmp_path / "field.yaml"
    path.write_text(
        "- &tree {id: a, center_ned_m: [20.0, 1.0], size_m: [1.0, 1.0]}\n"
        "- {<<: *tree, id: b, center_ned_m: [50.0, 1.0]}\n"
    )
    field = load_field(path)
    assert field.ids == ("a", "b")
    assert field.half_size_m.tolist() == [[0.5, 0.5], [0.5, 0.5]]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "expected keys and values, found nothing"),
        (b"# only a comment\n", "expected keys and values, found nothing"),
        (b"- 1\n", "expected keys and values, found [1]"),
        (b"just words", "expected keys and values, found 'just words'"),
        (b"\xff\xfea\x00", "is not UTF-8 text (byte 0)"),
        (b"a: \xe9", "is not UTF-8 text (byte 3)"),
        (b"\x89PNG\r\n\x1a\n", "is not UTF-8 text (byte 0)"),
        (b"\x7fELF\x02\x01\x01\x00", "special characters are not allowed"),
    ],
)
def test_what_is_no_file_of_ours_is_one_line(tmp_path: Path, data: bytes, reason: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_bytes(data)
    with pytest.raises(FileError) as refused:
        read_mapping(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("data", "value"),
    [
        (b"\xef\xbb\xbfa: 1", {"a": 1}),
        (b"a: 1\r\nb: 2\r\n", {"a": 1, "b": 2}),
        ("a: 3°\n".encode(), {"a": "3°"}),
    ],
)
def test_editors_marks_and_line_ends_are_accepted(tmp_path: Path, data: bytes, value: Any) -> None:
    path = tmp_path / "file.yaml"
    path.write_bytes(data)
    assert read_document(path) == value


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("missing.yaml", "No such file"),
        ("", "Is a directory"),
        ("x" * 300, "File name too long"),
        ("zero\0byte", "null byte"),
    ],
)
def test_what_cannot_be_opened_is_one_line(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(FileError, match=f"cannot be read: .*{reason}"):
        read_document(tmp_path / name)


def test_an_endless_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml_file, "FILE_BYTES_MAX", 1_000_000)
    with pytest.raises(FileError, match="/dev/zero: is larger than 1 MB"):
        read_document(Path("/dev/zero"))


WORDS = st.sampled_from([*VALUES, *AMBIGUOUS, "<<", "null", "- a", "a: b", "#", "*a"]) | st.text(
    st.characters(blacklist_categories=["Cs", "Cc"])
)
SCALARS = (
    WORDS | st.booleans() | st.none() | st.integers(-(10**15), 10**15) | st.floats(allow_nan=False)
)


@given(st.recursive(SCALARS, lambda x: st.lists(x) | st.dictionaries(WORDS, x), max_leaves=10))
def test_what_is_written_is_read_again(document: Any) -> None:
    again = parse_document(dump_document(document), source="here")
    assert again == document
    assert repr(again) == repr(document)


@given(st.text(st.sampled_from("ab01239.-+eExo_:~<>=&*!{}[],'\"|#%@?\n\t \x00é"), max_size=40))
def test_nothing_but_an_error_of_ours_comes_of_any_text(text: str) -> None:
    with contextlib.suppress(FileError):
        parse_document(text, source="here")
