"""Arrays of cells around the vehicle: how deep inside an area each lies, and moving the window."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import distance_transform_edt

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray


def depth_of(cells: BoolArray, *, edge_open: bool) -> FloatArray:
    """Return how many cells lie at least between each of some cells and the nearest other one.

    From centre to centre it is the square root of two more, at most.

    Args:
        cells: those inside.
        edge_open: whether what lies beyond the raster counts as inside.
    """
    padded = np.pad(cells, 1, constant_values=edge_open)
    if padded.all():
        return np.full(cells.shape, math.inf)
    depth: FloatArray = distance_transform_edt(padded)[1:-1, 1:-1]
    return np.maximum(depth - math.sqrt(2.0), 0.0)


def moved(cells: FloatArray, di: int, dj: int, fill: float) -> FloatArray:
    """Return the window moved by whole cells; new cells get a value."""
    window = np.full_like(cells, fill)
    size = cells.shape[0]
    if abs(di) >= size or abs(dj) >= size:
        return window
    source = cells[max(di, 0) : size + min(di, 0), max(dj, 0) : size + min(dj, 0)]
    window[max(-di, 0) : size + min(-di, 0), max(-dj, 0) : size + min(-dj, 0)] = source
    return window
