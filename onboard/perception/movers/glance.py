"""What one frame says of movers, before it is put on a raster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray, View, seen_past
from onboard.perception.view_sector import in_sector, of_whole_cells

# Nearer to an all-round sensor than this, cells are too near for lines of sight.
NEAR_M: Final = 0.7


@dataclass(frozen=True)
class Glance:
    """What one frame says of movers.

    Attributes:
        view: the frame, with every box that blocks its lines of sight.
        stamp_s: when it was taken; when its measurement began.
        movers: (n, 4): least and greatest north, least and greatest east of each mover's box, its
            errors included; no cell of them is free.
        open_view: the same without what stands still, where no mover hides behind that.
        exposure_s: how long its measurement took, at most.
        cores: as `movers`, but what each fills at least: only that may be a surprise.  By default
            the same.
    """

    view: View
    stamp_s: float
    movers: FloatArray
    open_view: View | None = None
    exposure_s: float = 0.0
    cores: FloatArray | None = None


def boxes_array(boxes: Sequence[tuple[float, float, float, float]]) -> FloatArray:
    """Return boxes as rows, (0, 4) without any."""
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)


def without(view: View, keep: Sequence[bool]) -> View:
    """Return a view that only some of its boxes block."""
    return replace(view, boxes=[box for box, kept in zip(view.boxes, keep, strict=True) if kept])


def cells_shown(
    view: View, blocking: Sequence[Sequence[Box]], xs_m: FloatArray, ys_m: FloatArray, cell_m: float
) -> list[BoolArray]:
    """Tell of each cell of a raster whether a view shows all of it past each of some sets of boxes.

    Args:
        view: see `seen_past`.
        blocking: the sets.
        xs_m: of the centres, one for each row (n,), ascending.
        ys_m: one for each column (m,), likewise.
        cell_m: edge of a cell.

    Returns:
        Of each set, (n, m).
    """
    shown = [np.zeros((xs_m.size, ys_m.size), dtype=bool) for _ in blocking]
    whole = of_whole_cells(view, cell_m)
    if whole is None:
        return shown
    rows, columns = (
        slice(*np.searchsorted(middles_m, (at_m - whole.range_m, at_m + whole.range_m)).tolist())
        for middles_m, at_m in zip((xs_m, ys_m), view.position_leg_m, strict=True)
    )
    xs_m, ys_m = xs_m[rows], ys_m[columns]
    i, j = np.nonzero(in_sector(whole, xs_m, ys_m))
    for cells, seen in zip(shown, seen_past(view, blocking, xs_m[i], ys_m[j], cell_m), strict=True):
        cells[rows, columns][i, j] = seen
    return shown


def nothing_near(view: View) -> bool:
    """Tell whether a sensor that sees all round reports nothing close to itself."""
    x_m, y_m = view.position_leg_m
    reach_m = NEAR_M + view.face_error_m + view.pose_error_m + view.placing_error_m
    # A scan that measured nothing in some direction has not looked there.
    looks = view.half_view_rad >= math.pi and min(view.free_range_m, default=reach_m) >= reach_m
    return looks and not any(
        math.hypot(
            max(box.x_min_m - x_m, 0.0, x_m - box.x_max_m),
            max(box.y_min_m - y_m, 0.0, y_m - box.y_max_m),
        )
        <= reach_m
        for box in view.boxes
    )
