"""``clearway identify``: what flights have shown, and the contract values to declare for it."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.identify_logs import read_recording
from gcs_tools.identify_recording import Measured, measure
from gcs_tools.output import Format, write_document

# Declared values are rounded up to this.
_RESOLUTION = 0.01


def identify(paths: list[Path], *, margin: float, form: Format, output: Path | None) -> None:
    """Measure flights, and write what to declare.

    Args:
        paths: logs of the same vehicle.
        margin: added to what was measured, as a part of it.
        form: how to write.
        output: where to; standard output without it.

    Raises:
        CommandError: a log cannot be used, or the output cannot be written.
    """
    flights = [measure(read_recording(path)) for path in paths]
    declared = contract_values(flights, margin)
    document = {
        "margin": margin,
        "contract": declared,
        "worst": max(flights, key=lambda each: each.tracking_error_m).source,
        "flights": [asdict(flight) for flight in flights],
    }
    table = partial(_print, flights, declared, margin)
    write_document(document, table, form=form, path=output)


def contract_values(flights: list[Measured], margin: float) -> dict[str, float | None]:
    """Return the worst of all flights, with its margin, by contract key; None if none shows it."""
    columns: dict[str, list[float | None]] = {
        "vehicle.tracking_error_m": [each.tracking_error_m for each in flights],
        "vehicle.velocity_error_mps.0": [each.velocity_error_mps[0] for each in flights],
        "vehicle.velocity_error_mps.1": [each.velocity_error_mps[1] for each in flights],
        "vehicle.reaction_time_s": [each.reaction_time_s for each in flights],
        "vehicle.attitude_lag_s": [each.attitude_lag_s for each in flights],
    }
    return {key: _declared(values, margin) for key, values in columns.items()}


def _declared(values: list[float | None], margin: float) -> float | None:
    known = [value for value in values if value is not None]
    if not known:
        return None
    steps = math.ceil(max(known) * (1.0 + margin) / _RESOLUTION - 1e-9)
    return round(steps * _RESOLUTION, 6)


def _print(
    flights: list[Measured],
    declared: dict[str, float | None],
    margin: float,
    console: Console,
) -> None:
    table = Table("log", title="Measured", title_justify="left")
    for column in ("E_tr m", "dV_x m/s", "dV_y m/s", "reaction s", "lag s", "tilt asked, had °"):
        table.add_column(column, justify="right")
    for each in flights:
        numbers = (each.tracking_error_m, *each.velocity_error_mps)
        tilt = f"{each.tilt_asked_deg:.1f}, {each.tilt_max_deg:.1f}"
        delays = (each.reaction_time_s, each.attitude_lag_s)
        table.add_row(escape(each.source), *map(_number, (*numbers, *delays)), tilt)
    console.print(table)
    worst = max(flights, key=lambda each: each.tracking_error_m)
    console.print(f"worst: {worst.source}, {worst.worst}", markup=False, soft_wrap=True)
    console.print(f"\nto declare, {100.0 * margin:g} % above what was measured:")
    for key, value in declared.items():
        console.print(f"  {key}: {'these logs do not show it' if value is None else value}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
