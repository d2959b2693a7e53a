"""The table of a campaign on disk."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.table import SCHEMA, read_table, write_table
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.campaign.rows import row


def test_rows_come_back_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    rows = [row(number=2), row(number=0, clearance_min_m=None), row(source="faults", number=1)]
    write_table(rows, tmp_path / "flights.parquet")
    assert read_table(tmp_path / "flights.parquet") == [rows[2], rows[1], rows[0]]
    assert list(tmp_path.iterdir()) == [tmp_path / "flights.parquet"]


def test_an_empty_table_is_a_table(tmp_path: Path) -> None:
    write_table([], tmp_path / "flights.parquet")
    assert read_table(tmp_path / "flights.parquet") == []


def test_a_column_per_field() -> None:
    assert SCHEMA.names == list(FlightRow.__dataclass_fields__)
    nullable = {field.name for field in SCHEMA if field.nullable}
    assert nullable == {"clearance_min_m", "rest_margin_min_m", "least_margin_m"}


def test_a_table_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flights.parquet"
    document = asdict(row())
    del document["csb_shape"]
    parquet.write_table(pa.Table.from_pylist([document]), path)
    with pytest.raises(CommandError) as refused:
        read_table(path)
    assert str(refused.value) == (
        f"{path}: was written by an incompatible Clearway version: use another --out"
    )


@pytest.mark.parametrize("content", [b"", b"PAR1", b"no table at all"])
def test_what_is_not_a_table_is_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flights.parquet"
    path.write_bytes(content)
    with pytest.raises(CommandError, match="cannot be read"):
        read_table(path)


def test_a_table_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "flights.parquet"
    write_table([row()], path)
    (tmp_path / "flights.parquet.part").mkdir()
    with pytest.raises(CommandError, match="cannot be written"):
        write_table([row(), row(number=1)], path)
    assert read_table(path) == [row()]
