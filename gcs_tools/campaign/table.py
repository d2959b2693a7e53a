"""The table of a campaign: one Parquet file with one row per flight, rewritten as it grows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa
from pyarrow import parquet

from gcs_tools.campaign.flight import FlightRow
from gcs_tools.console.errors import CommandError
from gcs_tools.console.parquet_file import schema_of, write_rows

SCHEMA: Final = schema_of(FlightRow)


def write_table(rows: Sequence[FlightRow], path: Path) -> None:
    """Write the rows in the order of their numbers; after a crash the previous table is left.

    Raises:
        CommandError: the file cannot be written.
    """
    ordered = sorted(rows, key=lambda row: (row.source, row.number))
    write_rows(ordered, SCHEMA, path)


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
