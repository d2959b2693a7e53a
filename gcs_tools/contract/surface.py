"""``clearway contract surface``: a requirement over two keys, as in Fig. 11, 12 and 13."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, write_document, write_text
from gcs_tools.contract.surface_grid import MARGIN, Axis, Reading, Surface, evaluate
from onboard.files.contract_file import Contract, InputSet, load_contract

FigureNumber = Literal["11", "12", "13"]

# Rows and columns of the printed table; files have the whole grid.
_TABLE_STEPS = 8


@dataclass(frozen=True)
class Figure:
    """What to draw, such as a figure of the paper, with the terms that it fixes."""

    x: str
    y: str
    quantity: str
    overrides: tuple[str, ...] = ()
    reading: Reading = "inflated"


_SPEEDS = "vehicle.cruise_speed_mps=0.5:8:151"
_ANGLES = "vehicle.roll_max_deg+vehicle.pitch_max_deg=5:30:126"
_SIZE_4_M = ("environment.obstacle_size_max_m=4.0", "environment.obstacle_size_min_m=4.0")
FIGURES: dict[FigureNumber, Figure] = {
    "11": Figure(_SPEEDS, _ANGLES, "detection_range", _SIZE_4_M),
    "12": Figure(
        _SPEEDS,
        "environment.obstacle_size_max_m=0.5:8:151",
        "separation",
        (
            "vehicle.roll_max_deg=15.0",
            "vehicle.pitch_max_deg=15.0",
            "environment.obstacle_size_min_m=0.0",
        ),
    ),
    "13": Figure(_SPEEDS, _ANGLES, "separation", _SIZE_4_M),
}


@dataclass(frozen=True)
class SurfaceRequest:
    """The command's arguments; None takes the figure's value, or the default without a figure."""

    figure: FigureNumber | None = None
    x: str | None = None
    y: str | None = None
    quantity: str | None = None
    reading: Reading | None = None


def write_surface(
    contract_path: Path,
    request: SurfaceRequest,
    *,
    overrides: tuple[str, ...],
    input_set: InputSet,
    form: Format,
    output: Path | None,
    plot: Path | None,
) -> None:
    """Evaluate, write and draw a surface.

    Raises:
        FileError: the contract, an override or an end of an axis is not admissible.
        CommandError: an axis, key or quantity is invalid, or a file cannot be written.
    """
    surface = request_surface(contract_path, request, overrides=overrides, input_set=input_set)
    if plot is not None:
        from gcs_tools.contract.surface_picture import save_picture  # noqa: PLC0415  loads matplotlib

        save_picture(surface, plot)
    if form == "csv":
        write_text(surface_csv(surface), output)
        return
    write_document(
        surface_document(surface), partial(print_surface, surface), form=form, path=output
    )


def request_surface(
    contract_path: Path, request: SurfaceRequest, *, overrides: tuple[str, ...], input_set: InputSet
) -> Surface:
    """Evaluate the requested surface; without axes, Fig. 11.

    Raises:
        FileError: the contract, an override or an end of an axis is not admissible.
        CommandError: an axis, key or quantity is invalid.
    """
    figure = _figure(request)
    # The operator's overrides take precedence over the figure's.
    contract = load_contract(contract_path, (*figure.overrides, *overrides))
    reading = request.reading or figure.reading
    x, y = Axis.parse(request.x or figure.x), Axis.parse(request.y or figure.y)
    if request.x is None and reading == "inflated":
        x = _where_known(x, contract)
    surface = evaluate(
        contract, x, y, request.quantity or figure.quantity, reading=reading, input_set=input_set
    )
    stated = load_contract(contract_path, overrides)
    own_x, own_y = x.value_in(stated), y.value_in(stated)
    return surface if own_x is None or own_y is None else replace(surface, own=(own_x, own_y))


def _where_known(speeds: Axis, contract: Contract) -> Axis:
    """Return a figure's speeds up to that at which the run after a loss was measured."""
    known_mps = contract.vehicle.setpoint_loss_run_on_speed_mps
    if known_mps is None or not contract.requirements.passive_safety:
        return speeds
    return speeds.up_to(known_mps)


def _figure(request: SurfaceRequest) -> Figure:
    if request.figure is None and (request.x is not None or request.y is not None):
        if request.x is None or request.y is None:
            raise CommandError("give both --x and --y, or a --figure")
        return Figure(request.x, request.y, MARGIN.name)
    return FIGURES[request.figure or "11"]


def surface_document(surface: Surface) -> dict[str, Any]:
    """Return the surface, rows of ``values`` along y; the keys are a published interface."""
    return {
        "reading": surface.reading,
        "input_set": surface.input_set,
        "x": _axis_document(surface.x),
        "y": _axis_document(surface.y),
        "z": {
            "name": surface.quantity.name,
            "unit": surface.quantity.unit,
            "values": surface.values.tolist(),
        },
        "own": None
        if surface.own is None
        else {"x": surface.own[0], "y": surface.own[1], "safe": surface.own_safe},
        "safe": surface.safe.tolist(),
        "compliant": surface.compliant.tolist(),
    }


def _axis_document(axis: Axis) -> dict[str, Any]:
    return {
        "keys": [key.path for key in axis.keys],
        "unit": axis.unit,
        "values": axis.values.tolist(),
    }


def surface_csv(surface: Surface) -> str:
    """Return one line per point: x, y, z, safe, compliant."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((surface.x.name, surface.y.name, surface.quantity.name, "safe", "compliant"))
    x, y = np.meshgrid(surface.x.values, surface.y.values)
    columns = (x, y, surface.values, surface.safe.astype(int), surface.compliant.astype(int))
    writer.writerows(zip(*(column.ravel().tolist() for column in columns), strict=True))
    return text.getvalue()


def print_surface(surface: Surface, console: Console) -> None:
    """Print a coarse grid with the safe side marked."""
    x, y, z = surface.x, surface.y, surface.quantity
    rows = _spread(len(y.values))
    columns = _spread(len(x.values))
    table = Table(
        f"{y.name} {_bracketed(y.unit)}",
        title=f"{z.label} {_bracketed(z.unit)}: {surface.reading} vehicle, {surface.input_set} "
        f"set, over {x.name} {_bracketed(x.unit)}",
        title_justify="left",
        caption=f"green: {_safe_meaning(surface)}",
    )
    for column in columns:
        table.add_column(f"{x.values[column]:.4g}", justify="right")
    for row in rows:
        cells = [
            f"[{'green' if surface.safe[row, column] else 'red'}]{surface.values[row, column]:.4g}"
            for column in columns
        ]
        table.add_row(f"{y.values[row]:.4g}", *cells)
    console.print(table)
    share = 100.0 * float(surface.compliant.mean())
    console.print(f"{share:.1f} % of {surface.values.size:,} points comply with every clause")
    console.print(_own_in_words(surface), soft_wrap=True, markup=False)


def _own_in_words(surface: Surface) -> str:
    if surface.own is None:
        return "the contract has no single point here: it states none of an axis, or several"
    x, y = surface.own
    place = f"{surface.x.name} = {x:.4g} {surface.x.unit}, {surface.y.name} = {y:.4g}"
    meaning = _safe_meaning(surface)
    found = {
        True: f"here {meaning}",
        False: f"it is not so that {meaning}",
        None: "outside the axes",
    }
    return f"the contract's own point, {place} {surface.y.unit}: {found[surface.own_safe]}"


def _bracketed(unit: str) -> str:
    return escape(f"[{unit}]") if unit else ""


def _safe_meaning(surface: Surface) -> str:
    if surface.quantity.clause:
        return f"the clause {surface.quantity.clause} holds"
    return "every clause holds"


def _spread(count: int) -> list[int]:
    """Return the indices of at most `_TABLE_STEPS` of ``count`` points, ends included."""
    return sorted({round(i) for i in np.linspace(0, count - 1, min(count, _TABLE_STEPS))})
