"""Stem maps: CSV files of trees, one a row.

Columns ``x_m`` (metres north of the local origin), ``y_m`` (metres east of it) and ``dbh_cm`` (stem
diameter at breast height), in any order; others are ignored.  The local origin is that of the
mission and of the autopilot's LOCAL_POSITION_NED.  Cells are separated by commas, semicolons or
tabs; with the latter two, numbers may have a decimal comma.
"""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, Final, NamedTuple

from onboard.files.yaml_file import FileError, read_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

COLUMNS: Final = {"x_m": "metres north", "y_m": "metres east", "dbh_cm": "stem diameter in cm"}
# Flights stay within this distance of the origin; map coordinates such as UTM's lie beyond it.
DISTANCE_MAX_M: Final = 1e5
# The thickest known tree has a diameter of 12 m: larger numbers are in another unit.
DIAMETER_MAX_CM: Final = 2000.0
_HEADER_SHOWN: Final = 80
_FROM_ORIGIN: Final = ", from the mission's origin; clearway mission stems converts others"


class Stem(NamedTuple):
    """One tree.

    Attributes:
        name: number of its row in the file.
        north_m, east_m: centre, from the local origin.
        diameter_m: at breast height.
    """

    name: str
    north_m: float
    east_m: float
    diameter_m: float


class Row(NamedTuple):
    """The numbers of one row.

    Attributes:
        source: file and row, for messages.
        numbers: of the columns that were asked for, in their order.
    """

    source: str
    numbers: tuple[float, ...]


def read_stems(path: Path) -> list[Stem]:
    """Read a stem map.

    Raises:
        FileError: names the file, the row, the column with its unit, and the value.
    """
    return [_stem(row) for row in read_columns(path, COLUMNS, expected_suffix=_FROM_ORIGIN)]


def read_columns(
    path: Path,
    columns: Mapping[str, str],
    delimiter: str | None = None,
    *,
    expected_suffix: str = "",
) -> list[Row]:
    """Read some columns of a CSV file as numbers; empty rows are passed over.

    Args:
        path: the file.
        columns: their names in its header, and what each means.
        delimiter: between cells; None takes a semicolon or tab that the header has, else a comma.
            Where it is not a comma, numbers may have a decimal comma.
        expected_suffix: added to the message on a header that lacks a column.

    Raises:
        FileError: names the file, the row, the column and the value.
    """
    text = read_text(path)
    header, _, _ = text.partition("\n")
    if delimiter is None:
        delimiter = next((each for each in ";\t" if each in header), ",")
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        names = [name.strip() for name in next(rows, [])]
        if (problem := _header_problem(names, columns)) is not None:
            raise FileError(
                f"{path}: header is {_shown(names)!r}, which {problem}{expected_suffix}"
            )
        found = [
            _row(row, names, columns, f"{path}: row {rows.line_num}", delimiter)
            for row in rows
            if any(cell.strip() for cell in row)  # spreadsheets leave empty rows behind
        ]
    except csv.Error as error:
        raise FileError(f"{path}: row {rows.line_num}: is not CSV: {error}") from error
    if not found:
        raise FileError(f"{path}: a field needs at least one obstacle")
    return found


def _header_problem(names: list[str], columns: Mapping[str, str]) -> str | None:
    wrong = next((name for name in columns if names.count(name) != 1), None)
    if wrong is None:
        return None
    expected = ", ".join(f"{name} ({meaning})" for name, meaning in columns.items())
    return f"has {names.count(wrong)} columns {wrong}; expected {expected}"


def _shown(names: list[str]) -> str:
    written = ",".join(names)
    return written if len(written) <= _HEADER_SHOWN else f"{written[: _HEADER_SHOWN - 3]}..."


def _row(
    row: list[str], names: list[str], columns: Mapping[str, str], source: str, delimiter: str
) -> Row:
    if len(row) != len(names):
        hint = ""
        if delimiter == "," and len(row) > len(names):
            hint = " (for decimal commas, separate cells by semicolons)"
        raise FileError(f"{source}: has {len(row)} cells, the header {len(names)}{hint}")
    return Row(
        source,
        tuple(
            _number(row[names.index(name)], name, source, decimal_comma=delimiter != ",")
            for name in columns
        ),
    )


def _stem(row: Row) -> Stem:
    north_m, east_m, diameter_cm = row.numbers
    for name, value_m in (("x_m", north_m), ("y_m", east_m)):
        if abs(value_m) > DISTANCE_MAX_M:
            raise FileError(
                f"{row.source}: {name} [m] = {value_m:.10g} is {abs(value_m) / 1e3:,.0f} km from "
                "the mission's origin; clearway mission stems converts UTM, latitude and longitude"
            )
    if not 0.0 < diameter_cm <= DIAMETER_MAX_CM:
        raise FileError(
            f"{row.source}: dbh_cm [cm] = {diameter_cm:g} must be greater than 0 and at most "
            f"{DIAMETER_MAX_CM:g}"
        )
    return Stem(row.source.rsplit(" ", 1)[1], north_m, east_m, diameter_cm / 100.0)


def _number(cell: str, name: str, source: str, *, decimal_comma: bool) -> float:
    text = cell.strip()
    if decimal_comma and text.count(",") == 1 and "." not in text:
        text = text.replace(",", ".")
    try:
        # Python would also read 1_000 and other alphabets' digits.
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        unit = f" [{name.rsplit('_', 1)[1]}]" if name in COLUMNS else ""
        raise FileError(f"{source}: {name}{unit} = {cell[:40]!r} is not a finite number")
    return value
