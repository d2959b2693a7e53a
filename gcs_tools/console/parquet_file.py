"""Tables of rows as Parquet files, one column for each field of a dataclass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args, get_type_hints

import pyarrow as pa
from pyarrow import parquet

from gcs_tools.console.errors import CommandError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_TYPES: Final[dict[Any, pa.DataType]] = {
    str: pa.string(),
    int: pa.int64(),
    float: pa.float64(),
    bool: pa.bool_(),
}


def schema_of(row: type[DataclassInstance]) -> pa.Schema:
    """Return the columns of a dataclass of str, int, float, bool; those that may be None, too."""
    hints = get_type_hints(row)
    columns = []
    for column in fields(row):
        hint = hints[column.name]
        plain = next((t for t in get_args(hint) if t is not type(None)), hint)
        columns.append(pa.field(column.name, _TYPES[plain], nullable=plain is not hint))
    return pa.schema(columns)


def write_rows(rows: Sequence[DataclassInstance], schema: pa.Schema, path: Path) -> None:
    """Write the rows in their order; after a crash the previous file is left.

    Raises:
        CommandError: the file cannot be written.
    """
    unfinished = path.with_suffix(f"{path.suffix}.part")
    try:
        table = pa.Table.from_pylist([asdict(row) for row in rows], schema=schema)
        parquet.write_table(table, unfinished)
        unfinished.replace(path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
