"""Draws ``flight.png``: the flight from above, its height, and its tracking error."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from gcs_tools.logs.flight_log import Log
from gcs_tools.logs.result import Result
from gcs_tools.scenario import Scenario
from onboard.contract.assessment import assess
from onboard.files.obstacle_field import ObstacleField
from onboard.files.truth_record import TruthRecord
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES
from onboard.recording.messages import SeenSpace, StateRecord
from onboard.recording.mover_record import extent

_FLOWN, _REFERENCE, _OBSTACLE, _REGION, _LIMIT = (
    "#1f5fa8",
    "#e07b00",
    "#5b7f4f",
    "#b03a48",
    "#b03a48",
)
_MOVER = "#c2187a"
_FREE = "#e6eff8"
_PHASES = {
    "cruise": "#ffffff",
    "avoid": "#fdeccf",
    "thread": "#eaf2fb",
    "pause": "#fdeccf",
    "yield": "#e2eef0",
    "arrived": "#e3f1e1",
    "hold": "#f6dada",
}
_MARGIN_M = 2.5
# Records of the set that are drawn over each other.
_SEEN_SPACES_MAX = 25
# Shorter phases have no room for their name.
_NAMED_PHASE_S = 1.5


def draw_flight(scenario: Scenario, flight: Log, truth: Log, result: Result, path: Path) -> None:
    """Draw a flight as a PNG.

    Args:
        scenario: obstacles, contract and vehicle radius.
        flight: the daemon's log.
        truth: the simulation's log.
        result: for the title.
        path: the file to write.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    top, height, error = figure.subplots(3, 1, height_ratios=(1.7, 1.0, 1.0))
    states = [state for state in flight.states if state.position_ned_m is not None]
    flown = [record for record in truth.truths if record.position_ned_m[2] < -0.1]
    start_s = _departure_s(states)
    _draw_top_view(top, scenario, flight, states, flown)
    _draw_height(height, states, flown, start_s)
    _draw_error(error, scenario, states, start_s)
    for axes in (height, error):
        _shade_phases(axes, states, start_s)
        axes.sharex(height)
    figure.suptitle(_title(scenario, result), fontsize=12, fontweight="bold", ha="left", x=0.01)
    figure.savefig(path, dpi=120)


def _title(scenario: Scenario, result: Result) -> str:
    clearance = (
        "no obstacle near"
        if result.clearance_min_m is None
        else f"clearance {result.clearance_min_m:.2f} m"
    )
    return (
        f"{scenario.name}: {result.outcome}, {result.obstacles_avoided} avoided, "
        f"{result.collisions} collisions, {clearance}, "
        f"tracking error {result.tracking_error_max_m:.2f} m"
    )


def _departure_s(states: list[StateRecord]) -> float:
    """Time of day when the daemon took control, or of the first state."""
    flying = (state.time_s for state in states if state.phase != "standby")
    return next(flying, states[0].time_s if states else 0.0)


def _draw_top_view(
    axes: Axes,
    scenario: Scenario,
    flight: Log,
    states: list[StateRecord],
    flown: list[TruthRecord],
) -> None:
    _draw_seen_space(axes, flight.seen_spaces)
    # No obstacle has a region where the flight rests on the space seen free alone.
    induction = any(state.phase in ("cruise", "avoid") for state in states)
    regions = _regions(flight) if induction or not flight.seen_spaces else []
    for number, corners in enumerate(regions):
        label = "region of influence" if number == 0 else None
        axes.add_patch(Polygon(corners, fill=False, edgecolor=_REGION, linestyle="--", label=label))
    for number, corners in enumerate(_obstacle_corners(scenario.obstacles)):
        label = "obstacle" if number == 0 else None
        axes.add_patch(Polygon(corners, facecolor=_OBSTACLE, edgecolor="black", label=label))
    legs = [scenario.mission.start_ned_m, *(leg.end_ned_m for leg in scenario.mission.legs)]
    for number, leg in enumerate(pairwise(legs)):
        label = "leg" if number == 0 else None
        axes.plot(*np.array(leg).T, color="0.75", linewidth=1.0, linestyle=":", label=label)
    for number, way_ned_m in enumerate(_mover_ways(flight)):
        label = "mover, as seen" if number == 0 else None
        axes.plot(*np.array(way_ned_m).T, color=_MOVER, linewidth=1.2, linestyle="--", label=label)
    reference = _column(state.reference_position_ned_m for state in states)
    axes.plot(*reference[:, :2].T, color=_REFERENCE, linewidth=3.0, alpha=0.6, label="reference")
    path = _column(record.position_ned_m for record in flown)
    axes.plot(*path[:, :2].T, color=_FLOWN, linewidth=1.4, label="flown")
    _draw_vehicle(axes, scenario, flown)
    seen = [] if induction else _free_runs(flight.seen_spaces[-1:])
    _frame_top_view(axes, np.vstack([path[:, :2], np.array(legs), *regions, *seen]))


def _draw_seen_space(axes: Axes, records: Sequence[SeenSpace]) -> None:
    """Fill what was seen free at any time of the flight."""
    runs = _free_runs([*records[:: max(1, len(records) // _SEEN_SPACES_MAX)], *records[-1:]])
    if runs:
        free = PolyCollection(
            runs, facecolors=_FREE, edgecolors=_FREE, linewidths=0.2, zorder=0.5, label="seen free"
        )
        axes.add_collection(free, autolim=False)


def _free_runs(records: Iterable[SeenSpace]) -> list[FloatArray]:
    """Return the corners of every run of free cells, north and east, each (4, 2)."""
    found: list[FloatArray] = []
    for seen in records:
        row, first, after = (
            np.array(cells, dtype=np.float64)
            for cells in (seen.row, seen.column_from, seen.column_to)
        )
        along_m = seen.cell_m * np.stack((row, row + 1.0, row + 1.0, row), axis=1)
        across_m = seen.cell_m * np.stack((first, first, after, after), axis=1)
        cosine, sine = math.cos(seen.heading_rad), math.sin(seen.heading_rad)
        north_m = seen.corner_ned_m[0] + cosine * along_m - sine * across_m
        east_m = seen.corner_ned_m[1] + sine * along_m + cosine * across_m
        found.extend(np.stack((north_m, east_m), axis=2))
    return found


def _draw_vehicle(axes: Axes, scenario: Scenario, flown: list[TruthRecord]) -> None:
    """Mark the vehicle where it started, ended, and was nearest to an obstacle."""
    if not flown:
        return
    _mark_vehicle(axes, scenario, flown[0], "start", above=True)
    _mark_vehicle(axes, scenario, flown[-1], "end", above=True)
    near = [record for record in flown if record.clearance_m is not None]
    if near:
        nearest = min(near, key=lambda record: record.clearance_m or 0.0)
        centers_m = scenario.obstacles.center_ned_m
        offsets_m = centers_m - np.array(nearest.position_ned_m[:2])
        _, east_m = offsets_m[np.argmin(np.hypot(*offsets_m.T))]
        label = f"{nearest.clearance_m:.2f} m clear"
        _mark_vehicle(axes, scenario, nearest, label, above=bool(east_m > 0.0))


def _mark_vehicle(
    axes: Axes, scenario: Scenario, record: TruthRecord, label: str, *, above: bool
) -> None:
    position_m, radius_m = record.position_ned_m[:2], scenario.plant.multirotor.radius_m
    axes.add_patch(Circle(position_m, radius_m, facecolor=_FLOWN, alpha=0.55))
    offset = (0, 9 if above else -16)
    axes.annotate(label, position_m, offset, textcoords="offset points", ha="center", size=8)


def _frame_top_view(axes: Axes, points_m: FloatArray) -> None:
    lowest, highest = np.nanmin(points_m, axis=0), np.nanmax(points_m, axis=0)
    axes.set_xlim(lowest[0] - _MARGIN_M, highest[0] + _MARGIN_M)
    # Seen from above with north to the right, east is down.
    axes.set_ylim(highest[1] + _MARGIN_M / 2, lowest[1] - _MARGIN_M / 2)
    axes.set_aspect("equal")
    axes.set_xlabel("north (m)")
    axes.set_ylabel("east (m)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=5, frameon=False, fontsize=9)


def _draw_height(
    axes: Axes, states: list[StateRecord], flown: list[TruthRecord], start_s: float
) -> None:
    reference = _column(state.reference_position_ned_m for state in states)
    times_s = np.array([state.time_s for state in states]) - start_s
    axes.plot(times_s, -reference[:, 2], color=_REFERENCE, linewidth=3.0, alpha=0.6)
    path = _column(record.position_ned_m for record in flown)
    truth_times_s = np.array([record.time_unix_s for record in flown]) - start_s
    axes.plot(truth_times_s, -path[:, 2], color=_FLOWN, linewidth=1.4)
    axes.set_ylim(top=1.3 * axes.get_ylim()[1])
    axes.set_ylabel("height (m)")
    axes.grid(alpha=0.25)
    axes.tick_params(labelbottom=False)


def _draw_error(axes: Axes, scenario: Scenario, states: list[StateRecord], start_s: float) -> None:
    flying = [state for state in states if state.phase in FLYING_PHASES]
    times_s = [state.time_s - start_s for state in flying]
    errors_m = [state.tracking_error_m or 0.0 for state in flying]
    axes.plot(times_s, errors_m, color=_FLOWN, linewidth=1.2)
    allowed_m = assess(scenario.contract).terms.tracking_error_m
    axes.axhline(allowed_m, color=_LIMIT, linestyle="--", linewidth=1.0)
    axes.annotate(
        "$E_{tr}$ of the contract", (0.005, allowed_m), (0, 3),
        xycoords=("axes fraction", "data"), textcoords="offset points", color=_LIMIT, size=8,
    )  # fmt: skip
    axes.set_ylim(0.0, 1.35 * max(allowed_m, *errors_m, 0.01))
    axes.set_ylabel("tracking error (m)")
    axes.set_xlabel("time since departure (s)")
    axes.grid(alpha=0.25)


def _shade_phases(axes: Axes, states: list[StateRecord], start_s: float) -> None:
    """Colour the background by phase; name the phases along the upper edge."""
    for phase, group in groupby(states, key=lambda state: state.phase):
        colour, times_s = _PHASES.get(phase), [state.time_s - start_s for state in group]
        if colour is None:
            continue
        axes.axvspan(times_s[0], times_s[-1], color=colour, zorder=0)
        if times_s[-1] - times_s[0] > _NAMED_PHASE_S:
            axes.annotate(
                phase, ((times_s[0] + times_s[-1]) / 2.0, 0.88), size=8, color="0.45",
                xycoords=("data", "axes fraction"), ha="center",
            )  # fmt: skip


def _mover_ways(flight: Log) -> list[list[tuple[float, float]]]:
    """Return the middles of the boxes of each mover, in the order of time."""
    ways: dict[str, list[tuple[float, float]]] = {}
    for record in flight.movers:
        for mover in record.movers:
            if mover.box_ned_m:
                low_n_m, high_n_m, low_e_m, high_e_m = extent(mover.box_ned_m)
                middle_m = (low_n_m + high_n_m) / 2.0, (low_e_m + high_e_m) / 2.0
                ways.setdefault(mover.id, []).append(middle_m)
    return list(ways.values())


def _regions(flight: Log) -> list[FloatArray]:
    """Corners of the region of each obstacle, as last known."""
    latest: dict[str, FloatArray] = {}
    for message in flight.obstacles:
        for obstacle in message.obstacles:
            latest[obstacle.id] = np.array(obstacle.region_ned_m)
    return list(latest.values())


def _obstacle_corners(obstacles: ObstacleField) -> list[FloatArray]:
    corners = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    found = []
    columns = obstacles.center_ned_m, obstacles.half_size_m, obstacles.yaw_rad.tolist()
    for center_m, half_m, yaw_rad in zip(*columns, strict=True):
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        found.append(center_m + (corners * half_m) @ turn.T)
    return found


def _column(vectors: Iterable[tuple[float, float, float] | None]) -> FloatArray:
    """Return vectors as an array (N, 3); NaN where one is None."""
    missing = (math.nan, math.nan, math.nan)
    rows = [missing if vector is None else vector for vector in vectors]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
