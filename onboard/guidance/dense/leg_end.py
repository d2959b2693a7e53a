"""The end of a leg, and a free place beside it where an obstacle stands on it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.box import Box

_STEP_M: Final = 0.2


def is_blocked(place_leg_m: tuple[float, float], boxes: Sequence[Box], margin_m: float) -> bool:
    """Tell whether a known obstacle, grown by a margin, covers a place."""
    x_m, y_m = place_leg_m
    return any(
        box.x_min_m - margin_m < x_m < box.x_max_m + margin_m
        and box.y_min_m - margin_m < y_m < box.y_max_m + margin_m
        for box in boxes
    )


def end_beside(
    end_leg_m: tuple[float, float], boxes: Sequence[Box], margin_m: float, half_width_m: float
) -> tuple[float, float] | None:
    """Return the place nearest to the end of a leg that no known obstacle covers.

    Args:
        end_leg_m: (x, y).
        boxes: known obstacles, leg frame.
        margin_m: that they are grown by.
        half_width_m: how far from the end on each axis the leg may end.

    Returns:
        None if they cover every place.
    """
    steps = math.floor(half_width_m / _STEP_M)
    offsets_m = _STEP_M * np.arange(-steps, steps + 1)
    x_m, y_m = (offsets_m[:, None] + end_leg_m[0], offsets_m[None, :] + end_leg_m[1])
    free = np.ones((offsets_m.size, offsets_m.size), bool)
    for box in boxes:
        beside = (x_m <= box.x_min_m - margin_m) | (x_m >= box.x_max_m + margin_m)
        free &= beside | (y_m <= box.y_min_m - margin_m) | (y_m >= box.y_max_m + margin_m)
    if not free.any():
        return None
    apart_m = np.where(free, np.hypot(offsets_m[:, None], offsets_m[None, :]), math.inf)
    i, j = np.unravel_index(int(apart_m.argmin()), apart_m.shape)
    return float(x_m[i, 0]), float(y_m[0, j])
