"""Documents as tables, JSON and CSV."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, _flattened, _rendered, write_document, write_text

DOCUMENT: dict[str, Any] = {
    "verdict": "holds",
    "compliant": True,
    "nothing": None,
    "nested": {"depth_m": 1.5, "list": [1, 2]},
    "clauses": [{"name": "stop", "margin": 0.25}, {"margin": 1.0}],
    "unit": "m/s²",
}


def table(console: Console) -> None:
    console.print("the table")


def rendered(form: Format, *, ascii_only: bool = False) -> str:
    return _rendered(DOCUMENT, table, form, ascii_only=ascii_only)


def test_json_is_the_document() -> None:
    assert json.loads(rendered("json")) == DOCUMENT
    assert "m/s²" in rendered("json")
    assert rendered("json", ascii_only=True).isascii()
    assert json.loads(rendered("json", ascii_only=True)) == DOCUMENT


def test_csv_has_a_line_per_value_under_its_dotted_key() -> None:
    rows = list(csv.reader(rendered("csv").splitlines()))
    assert rows[0] == ["key", "value"]
    assert dict(rows[1:]) == {
        "verdict": "holds",
        "compliant": "true",
        "nothing": "null",
        "nested.depth_m": "1.5",
        "nested.list.0": "1",
        "nested.list.1": "2",
        "clauses.stop.name": "stop",
        "clauses.stop.margin": "0.25",
        "clauses.1.margin": "1.0",
        "unit": "m/s²",
    }


def test_a_table_is_for_people() -> None:
    assert rendered("table") == "the table\n"


@pytest.mark.parametrize("form", ["table", "json", "csv"])
def test_a_file_and_standard_output_are_alike(
    form: Format, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_document(DOCUMENT, table, form=form, path=tmp_path / "out")
    assert capsys.readouterr().out == ""
    write_document(DOCUMENT, table, form=form, path=None)
    assert capsys.readouterr().out == (tmp_path / "out").read_text(encoding="utf-8")


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"nowhere/out: cannot be written: No such file"):
        write_text("text", tmp_path / "nowhere" / "out")


def test_half_a_character_is_replaced(tmp_path: Path) -> None:
    write_text("a\ud800b", tmp_path / "out")
    assert (tmp_path / "out").read_text(encoding="utf-8") == "a?b"


scalars = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5)
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("de"), inner),
    max_leaves=8,
)
documents = st.dictionaries(st.sampled_from("abc"), values)


@given(documents)
def test_every_value_of_a_document_is_in_its_csv(document: dict[str, Any]) -> None:
    def leaves(value: Any) -> int:
        if isinstance(value, dict):
            return sum(map(leaves, value.values()))
        return sum(map(leaves, value)) if isinstance(value, list) else 1

    assert len(list(_flattened(document))) == leaves(document)
