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
    from pathlib import Path

COLUMNS: Final = {"x_m": "metres north", "y_m": "metres east", "dbh_cm": "stem diameter in cm"}
# Flights stay within this distance of the origin; map coordinates such as UTM's lie beyond it.
DISTANCE_MAX_M: Final = 1e5
# The thickest known tree has a diameter of 12 m: larger numbers are in another unit.
DIAMETER_MAX_CM: Final = 2000.0
_HEADER_SHOWN: Final = 80


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


def read_stems(path: Path) -> list[Stem]:
    """Read a stem map.

    Raises:
        FileError: names the file, the row, the column with its unit, and the value.
    """
    text = read_text(path)
    header, _, _ = text.partition("\n")
    delimiter = next((each for each in ";\t" if each in header), ",")
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        columns = _columns(next(rows, []), path)
        stems = [
            _stem(row, columns, f"{path}: row {rows.line_num}", delimiter)
            for row in rows
            if any(cell.strip() for cell in row)  # spreadsheets leave empty rows behind
        ]
    except csv.Error as error:
        raise FileError(f"{path}: row {rows.line_num}: is not CSV: {error}") from error
    if not stems:
        raise FileError(f"{path}: a field needs at least one obstacle")
    return stems


def _columns(header: list[str], path: Path) -> dict[str, int]:
    """Return the place of every column of ours, and of the last one under ``""``."""
    names = [name.strip() for name in header]
    problem = next(
        (f"has {names.count(name)} columns {name}" for name in COLUMNS if names.count(name) != 1),
        None,
    )
    if problem is not None:
        written = ",".join(header)
        shown = written if len(written) <= _HEADER_SHOWN else f"{written[: _HEADER_SHOWN - 3]}..."
        expected = ", ".join(f"{name} ({meaning})" for name, meaning in COLUMNS.items())
        raise FileError(
            f"{path}: header is {shown!r}, which {problem}; expected {expected}, from the "
            "mission's origin"
        )
    return {name: names.index(name) for name in COLUMNS} | {"": len(names)}


def _stem(row: list[str], columns: dict[str, int], source: str, delimiter: str) -> Stem:
    if len(row) != columns[""]:
        hint = ""
        if delimiter == "," and len(row) > columns[""]:
            hint = " (for decimal commas, separate cells by semicolons)"
        raise FileError(f"{source}: has {len(row)} cells, the header {columns['']}{hint}")
    numbers = [
        _number(row[columns[name]], name, source, decimal_comma=delimiter != ",")
        for name in COLUMNS
    ]
    north_m, east_m, diameter_cm = numbers
    for name, value_m in (("x_m", north_m), ("y_m", east_m)):
        if abs(value_m) > DISTANCE_MAX_M:
            raise FileError(
                f"{source}: {name} [m] = {value_m:.10g} is {abs(value_m) / 1e3:,.0f} km from the "
                "mission's origin; subtract the origin from map coordinates such as UTM's"
            )
    if not 0.0 < diameter_cm <= DIAMETER_MAX_CM:
        raise FileError(
            f"{source}: dbh_cm [cm] = {diameter_cm:g} must be greater than 0 and at most "
            f"{DIAMETER_MAX_CM:g}"
        )
    return Stem(source.rsplit(" ", 1)[1], north_m, east_m, diameter_cm / 100.0)


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
        unit = name.rsplit("_", 1)[1]
        raise FileError(f"{source}: {name} [{unit}] = {cell!r} is not a finite number")
    return value
