"""The narrowest gap between two obstacles that a path leads through."""

from __future__ import annotations

import numpy as np

from onboard.geometry.frames import FloatArray

# Obstacles farther away than this make no gap.
NEAR_M = 8.0


def narrowest_gap_m(path_m: FloatArray, boxes_m: FloatArray) -> float | None:
    """Return the least distance of two obstacles' faces, one on either side of the path.

    Args:
        path_m: points (n, 2).
        boxes_m: (N, 4): x from, x to, y from, y to.

    Returns:
        None where the path never leads between two obstacles.
    """
    gaps_m = [gap for point in path_m if (gap := _gap_at(point, boxes_m)) is not None]
    return min(gaps_m, default=None)


def _gap_at(point_m: FloatArray, boxes_m: FloatArray) -> float | None:
    faces_m = np.clip(point_m, boxes_m[:, ::2], boxes_m[:, 1::2]) - point_m
    distance_m = np.hypot(*faces_m.T)
    near = np.flatnonzero(distance_m <= NEAR_M)
    if near.size < 2:
        return None
    one = faces_m[near[int(distance_m[near].argmin())]]
    opposite = faces_m[near][faces_m[near] @ one < 0.0]
    if not len(opposite):
        return None
    return float(np.hypot(*(opposite - one).T).min())
