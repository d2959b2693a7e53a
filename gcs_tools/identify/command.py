"""``clearway identify``: measures flights, and derives the contract values to declare."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.console.errors import CommandError
from gcs_tools.console.output import Format, write_document
from gcs_tools.identify.logs import NotALogError, read_recording
from gcs_tools.identify.recording import Measured, measure
from gcs_tools.logs.flight_log import FOXGLOVE_SUFFIX

# Declared values are rounded up to a multiple of this.
_RESOLUTION = 0.01


def identify(
    paths: list[Path],
    system_id: int | None = None,
    *,
    margin: float,
    form: Format,
    output: Path | None,
) -> None:
    """Measure flights, and write the values to declare.

    Args:
        paths: logs of the same vehicle, and directories of such logs.
        system_id: MAVLink id of the vehicle, in logs of several.
        margin: added to the measured values, as a share of them.
        form: of the output.
        output: file to write; None for standard output.

    Raises:
        CommandError: a log cannot be used, or the output cannot be written.
    """
    flights: list[Measured] = []
    skipped: list[str] = []
    for path in paths:
        if path.is_dir():
            _measure_directory(path, system_id, flights, skipped)
        else:
            flights.append(measure(read_recording(path, system_id)))
    declared = contract_values(flights, margin)
    document = {
        "margin": margin,
        "contract": declared,
        "worst": max(flights, key=lambda each: each.tracking_error_m).source,
        "flights": [asdict(flight) for flight in flights],
        "skipped": skipped,
    }
    table = partial(_print, flights, declared, margin, skipped)
    write_document(document, table, form=form, path=output)


def _measure_directory(
    path: Path, system_id: int | None, flights: list[Measured], skipped: list[str]
) -> None:
    """Measure every flight in a directory and below, once.

    Files that are not logs are skipped, and so are scenes for viewers exported from a log.

    Raises:
        CommandError: the directory has no log with a flight.
    """
    measured, unusable = len(flights), len(skipped)
    for file in sorted(each for each in path.rglob("*") if each.is_file()):
        if _is_exported(file):
            continue
        try:
            flights.append(measure(read_recording(file, system_id)))
        except NotALogError:
            continue
        except CommandError as error:
            skipped.append(str(error))
    if len(flights) == measured:
        first = f", first {skipped[unusable]}" if len(skipped) > unusable else ""
        raise CommandError(f"{path}: no flight log in this directory can be used{first}")


def _is_exported(path: Path) -> bool:
    """Tell whether a file repeats the records of the log beside it."""
    log, suffix, _ = path.name.rpartition(FOXGLOVE_SUFFIX)
    return bool(suffix) and path.with_name(f"{log}.mcap").exists()


def contract_values(flights: list[Measured], margin: float) -> dict[str, float | None]:
    """Return the worst of all flights plus margin, by contract key; None if no flight shows it."""
    columns: dict[str, list[float | None]] = {
        "vehicle.tracking_error_m": [each.tracking_error_m for each in flights],
        "vehicle.tracking_error_z_m": [each.tracking_error_z_m for each in flights],
        "vehicle.velocity_error_mps.0": [each.velocity_error_mps[0] for each in flights],
        "vehicle.velocity_error_mps.1": [each.velocity_error_mps[1] for each in flights],
        "vehicle.reaction_time_s": [each.reaction_time_s for each in flights],
        "vehicle.attitude_lag_s": [each.attitude_lag_s for each in flights],
        "vehicle.heading_error_deg": [each.heading_error_deg for each in flights],
    }
    declared = {key: _declared(values, margin) for key, values in columns.items()}
    # The speed says where the run was measured: it gets no margin.
    ran_on = [each for each in flights if each.run_on_m is not None]
    if ran_on:
        declared["vehicle.setpoint_loss_run_on_m"] = _declared(
            [each.run_on_m for each in ran_on], margin
        )
        slowest_mps = min(each.run_on_speed_mps or 0.0 for each in ran_on)
        declared["vehicle.setpoint_loss_run_on_speed_mps"] = round(slowest_mps, 3)
    return declared


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
    skipped: list[str],
    console: Console,
) -> None:
    table = Table(title="Measured", title_justify="left")
    table.add_column("log", overflow="fold")
    for column in _COLUMNS:
        table.add_column(column, justify="right")
    for each in flights:
        errors = (each.tracking_error_m, each.tracking_error_z_m, *each.velocity_error_mps)
        rest = (each.reaction_time_s, each.attitude_lag_s, each.rest_time_s, each.heading_error_deg)
        asked = "-" if each.tilt_asked_deg is None else f"{each.tilt_asked_deg:.1f}"
        tilt = f"{each.tilt_max_deg:.1f}, {asked}"
        table.add_row(escape(each.source), *map(_number, (*errors, *rest)), tilt)
    console.print(table)
    say = partial(console.print, markup=False, soft_wrap=True)
    worst = max(flights, key=lambda each: each.tracking_error_m)
    say(f"worst: {worst.source}, {worst.worst}")
    for each in flights:
        if each.run_on_m is not None and each.run_on_speed_mps is not None:
            say(
                f"{each.source}: without setpoints it ran on {each.run_on_m:.2f} m from "
                f"{each.run_on_speed_mps:.2f} m/s, and rested after "
                f"{each.run_on_rest_s or 0.0:.1f} s"
            )
        for note in each.notes:
            say(f"{each.source}: {note}")
    for reason in skipped:
        say(f"skipped: {reason}")
    say(f"\nto declare, {100.0 * margin:g} % above the measured values:")
    for key, value in declared.items():
        say(f"  {key}: {'not in these logs' if value is None else value}")


_COLUMNS = (
    "E_tr m",
    "E_z m",
    "dV_x m/s",
    "dV_y m/s",
    "reaction s",
    "lag s",
    "rest s",
    "heading °",
    "tilt °, asked",
)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
