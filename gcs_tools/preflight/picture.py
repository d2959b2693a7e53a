"""Draws an obstacle field, with the regions that break a rule in red, or a rehearsal in it."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight.field_check import LegField
from gcs_tools.preflight.field_merging import PAIRS_MAX, intersecting_pairs
from gcs_tools.preflight.rehearsal.prediction import Rehearsal
from onboard.geometry.frames import FloatArray, LegFrame

BoolArray = NDArray[np.bool_]

_OBSTACLE, _REGION, _BROKEN, _LEG = "#5b7f4f", "#8aa6c8", "#b03a48", "#1f5fa8"
_MARGIN_M = 4.0
# Obstacles farther from every leg are left out; a survey of a whole forest would hide the legs.
_SHOWN_BESIDE_M = 60.0


def draw_field(legs: tuple[LegField, ...], title: str, path: Path) -> None:
    """Draw a field as its legs meet it.

    Args:
        legs: the field, leg by leg; the first leg's boxes are drawn as the obstacles.
        title: above the picture.
        path: the file to write; its suffix says whether PNG, SVG or PDF.

    Raises:
        CommandError: the file cannot be written.
    """
    figure, axes = _canvas()
    lines_m = [_line_ned_m(leg) for leg in legs]
    shown_m = [np.vstack(lines_m)]
    for leg, line_m in zip(legs, lines_m, strict=True):
        near = _near(leg, shown_m[0])
        shown_m.append(_draw_leg(axes, leg, near))
        axes.plot(*line_m.T, color=_LEG, marker="o", markersize=4.0, linewidth=1.4, label="leg")
    _frame(axes, np.vstack(shown_m))
    _save(figure, title, path)


def draw_rehearsal(legs: tuple[LegField, ...], rehearsal: Rehearsal, path: Path) -> None:
    """Draw a rehearsed mission: obstacles, the path coloured by speed, and where it waits.

    Args:
        legs: the field, leg by leg.
        rehearsal: the prediction.
        path: the file to write; its suffix says whether PNG, SVG or PDF.

    Raises:
        CommandError: the file cannot be written.
    """
    figure, axes = _canvas()
    flown_m = [leg.path_ned_m for leg in rehearsal.legs]
    shown_m = np.vstack([*(_line_ned_m(leg) for leg in legs), *flown_m])
    boxes_m = _corners_ned_m(legs[0].stretch.frame, legs[0].single_boxes_m)
    low_m, high_m = shown_m.min(axis=0) - 3.0 * _MARGIN_M, shown_m.max(axis=0) + 3.0 * _MARGIN_M
    centers_m = boxes_m.mean(axis=1)
    near = np.all((centers_m >= low_m) & (centers_m <= high_m), axis=1)
    axes.add_collection(PolyCollection(list(boxes_m[near]), facecolors=_OBSTACLE, label="obstacle"))
    for leg in legs:
        axes.plot(*_line_ned_m(leg).T, color=_LEG, linestyle=":", linewidth=1.0, label="leg")
    speeds_mps = np.concatenate([leg.speed_mps for leg in rehearsal.legs])
    points_m = np.vstack(flown_m)
    north_m, east_m = points_m.T
    coloured = axes.scatter(
        north_m, east_m, c=speeds_mps, cmap="viridis", s=9.0, label="predicted way"
    )
    figure.colorbar(coloured, ax=axes, label="speed (m/s)", shrink=0.7)
    waits_m = np.array([wait.position_ned_m for wait in rehearsal.waits]).reshape(-1, 2)
    if len(waits_m):
        axes.plot(*waits_m.T, "x", color=_BROKEN, markersize=9.0, label="pause")
    _frame(axes, shown_m)
    _save(figure, f"Rehearsal, a prediction: {rehearsal.sentence()}", path)


def _canvas() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots()


def _save(figure: Figure, title: str, path: Path) -> None:
    figure.suptitle(title, fontsize=12, fontweight="bold", ha="left", x=0.01)
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise CommandError(f"{path}: cannot be written: {error}") from error


def _draw_leg(axes: Axes, leg: LegField, near: BoolArray) -> FloatArray:
    """Draw the near obstacles of a leg; return the corners of their regions, (N, 2)."""
    boxes_m = _corners_ned_m(leg.stretch.frame, leg.boxes_m)
    regions_m = _corners_ned_m(leg.stretch.frame, leg.regions.extent_m)
    broken = offending(leg)
    unfilled = {"facecolors": "none", "linestyles": "--"}
    layers: tuple[tuple[FloatArray, dict[str, Any]], ...] = (
        (boxes_m[near], {"facecolors": _OBSTACLE, "label": "obstacle"}),
        (
            regions_m[near & ~broken],
            {**unfilled, "edgecolors": _REGION, "label": "region of influence"},
        ),
        (
            regions_m[near & broken],
            {**unfilled, "edgecolors": _BROKEN, "label": "region that breaks a rule"},
        ),
    )
    for corners_m, style in layers:
        if len(corners_m):
            axes.add_collection(PolyCollection(list(corners_m), **style))
    return regions_m[near].reshape(-1, 2)


def _line_ned_m(leg: LegField) -> FloatArray:
    """Return the ends of a leg, (2, 2); without a mission it ends behind the last obstacle."""
    length_m = leg.stretch.end.x_min_m
    if not np.isfinite(length_m):
        length_m = float(leg.regions.extent_m[:, 1].max(initial=0.0))
    ends_m = np.array([(0.0, 0.0, 0.0), (length_m, 0.0, 0.0)])
    ned_m: FloatArray = leg.stretch.frame.position_ned_from_leg(ends_m)[:, :2]
    return ned_m


def _near(leg: LegField, lines_ned_m: FloatArray) -> BoolArray:
    centers_m = _corners_ned_m(leg.stretch.frame, leg.boxes_m).mean(axis=1)
    lowest_m = lines_ned_m.min(axis=0) - _SHOWN_BESIDE_M
    highest_m = lines_ned_m.max(axis=0) + _SHOWN_BESIDE_M
    near: BoolArray = np.all((centers_m >= lowest_m) & (centers_m <= highest_m), axis=1)
    return near


def _corners_ned_m(frame: LegFrame, boxes_m: FloatArray) -> FloatArray:
    """Return the corners of leg-frame boxes, north and east; (N, 4) -> (N, 4, 2)."""
    x_m, y_m = boxes_m[:, [0, 1, 1, 0]], boxes_m[:, [2, 2, 3, 3]]
    corners_m = np.stack((x_m, y_m, np.zeros_like(x_m)), axis=-1).reshape(-1, 3)
    ned_m: FloatArray = frame.position_ned_from_leg(corners_m)[:, :2].reshape(-1, 4, 2)
    return ned_m


def _frame(axes: Axes, points_m: FloatArray) -> None:
    """Set the limits: north to the right, so that east is down as seen from above."""
    lowest_m, highest_m = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
    axes.set_xlim(lowest_m[0], highest_m[0])
    axes.set_ylim(highest_m[1], lowest_m[1])
    axes.set_aspect("equal")
    axes.set_xlabel("north (m)")
    axes.set_ylabel("east (m)")
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(named.values(), named.keys(), loc="upper left", fontsize=9)


def offending(leg: LegField) -> BoolArray:
    """Return which obstacles break a rule about regions on this leg, (N,)."""
    found = np.zeros(len(leg.ids), dtype=np.bool_)
    for pair in islice(intersecting_pairs(leg.regions.apart_m), PAIRS_MAX):
        found[list(pair)] = True
    for place in (leg.stretch.start, leg.stretch.end):
        found[leg.regions_at(place)] = True
    return found
