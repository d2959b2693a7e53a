"""The table of a campaign: one Parquet file with one row per flight, rewritten as it grows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

import pyarrow as pa
from pyarrow import parquet

from gcs_tools.campaign.flight import FlightRow
from gcs_tools.console.errors import CommandError

_TYPES: Final[dict[Any, pa.DataType]] = {
    str: pa.string(),
    int: pa.int64(),
    float: pa.float64(),
    bool: pa.bool_(),
}


def _schema() -> pa.Schema:
    hints = get_type_hints(FlightRow)
    columns = []
    for column in fields(FlightRow):
        hint = hints[column.name]
        plain = next((t for t in get_args(hint) if t is not type(None)), hint)
        columns.append(pa.field(column.name, _TYPES[plain], nullable=plain is not hint))
    return pa.schema(columns)


SCHEMA: Final = _schema()


def write_table(rows: Sequence[FlightRow], path: Path) -> None:
    """Write the rows in the order of their numbers; after a crash the previous table is left.

    Raises:
        CommandError: the file cannot be written.
    """
    ordered = sorted(rows, key=lambda row: (row.source, row.number))
    unfinished = path.with_suffix(".parquet.part")
    try:
        table = pa.Table.from_pylist([asdict(row) for row in ordered], schema=SCHEMA)
        parquet.write_table(table, unfinished)
        unfinished.replace(path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error


def read_table(path: Path) -> list[FlightRow]:
    """Return the rows of a table.

    Raises:
        CommandError: the file cannot be read, or an incompatible version wrote it.
    """
    try:
        table = parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise CommandError(f"{path}: cannot be read: {error}") from error
    if table.schema.names != SCHEMA.names:
        raise CommandError(
            f"{path}: was written by an incompatible Clearway version: use another --out"
        )
    return [FlightRow(**row) for row in table.to_pylist()]
