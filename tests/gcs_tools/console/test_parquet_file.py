"""Rows of a dataclass as a Parquet file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from gcs_tools.console.errors import CommandError
from gcs_tools.console.parquet_file import schema_of, write_rows


@dataclass(frozen=True)
class Row:
    name: str
    count: int
    good: bool
    speed_mps: float | None = None


def test_a_column_per_field() -> None:
    schema = schema_of(Row)
    assert schema.names == ["name", "count", "good", "speed_mps"]
    assert schema.types == [pa.string(), pa.int64(), pa.bool_(), pa.float64()]
    assert [field.nullable for field in schema] == [False, False, False, True]


def test_rows_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "rows.parquet"
    write_rows(
        [Row("a", 1, good=True), Row("b", 2, good=False, speed_mps=1.5)], schema_of(Row), path
    )
    assert parquet.read_table(path).to_pylist() == [
        {"name": "a", "count": 1, "good": True, "speed_mps": None},
        {"name": "b", "count": 2, "good": False, "speed_mps": 1.5},
    ]
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="cannot be written"):
        write_rows([], schema_of(Row), tmp_path / "missing" / "rows.parquet")
