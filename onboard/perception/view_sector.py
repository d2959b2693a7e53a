"""Which cells around a sensor are worth looking at: those whose centres its view may show.

Most cells around a view's bounding box lie beside it.  What is left out here is only what
`onboard.perception.line_of_sight.seen_free` refuses anyway, since that asks for the whole cell.
Each bound is one comparison of a row with a column, whatever range and heading the view has: cheap
enough for every frame, so that nothing is kept, and no larger than what is asked about.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray, View

# More than what single precision leaves open in `seen_free`, in metres and in radians.
_SLACK: Final = 1e-4


def of_whole_cells(view: View, cell_m: float) -> View | None:
    """Return a smaller view that holds the centre of every cell that a view shows as a whole.

    `seen_free` asks for a disc about the centre that errors make larger, and wants it within range
    and view less errors: no centre is farther, or nearer to an edge, than the disc allows there.

    Args:
        view: the frame.
        cell_m: edge of a cell.

    Returns:
        None if no cell can be within.
    """
    eps, root = view.heading_error_rad, math.sqrt(2.0)
    # The radius of the disc is root * (grown + eps * distance), without its round-off.
    grown_m = cell_m / 2.0 * (1.0 + root * eps) + view.pose_error_m
    within_m = view.range_m - max(view.face_error_m, view.placing_error_m)
    range_m = (within_m - root * grown_m) / (1.0 + root * eps) + _SLACK
    if not range_m > _SLACK:
        return None
    half_rad = view.half_view_rad
    if half_rad < math.pi:
        astray_m = view.pose_error_m + view.placing_error_m
        # What a disc takes of the view is more than its radius over its distance.
        half_rad -= eps * (1.0 + root) + (root * grown_m + astray_m) / range_m - _SLACK
        if not half_rad > 0.0:
            return None
    return replace(view, range_m=range_m, half_view_rad=half_rad)


def in_sector(view: View, xs_m: FloatArray, ys_m: FloatArray) -> BoolArray:
    """Tell for each cell of a raster whether its centre is within range and field of view.

    Args:
        view: the frame.
        xs_m: of the centres, one for each row (n,), leg frame.
        ys_m: one for each column (m,), likewise.

    Returns:
        (n, m).
    """
    dx_m, dy_m = xs_m - view.position_leg_m[0], ys_m - view.position_leg_m[1]
    sector: BoolArray = (dx_m * dx_m)[:, None] <= view.range_m * view.range_m - dy_m * dy_m
    half_rad = view.half_view_rad
    if half_rad >= math.pi:
        return sector
    # On the inner side of both edges of the view; of either edge where it is wider than half round.
    left_rad, right_rad = view.heading_leg_rad - half_rad, view.heading_leg_rad + half_rad
    inside = (-math.sin(left_rad) * dx_m)[:, None] >= -math.cos(left_rad) * dy_m
    of_right = (math.sin(right_rad) * dx_m)[:, None] >= math.cos(right_rad) * dy_m
    combine = np.logical_and if half_rad <= math.pi / 2.0 else np.logical_or
    combine(inside, of_right, out=inside)
    sector &= inside
    return sector
