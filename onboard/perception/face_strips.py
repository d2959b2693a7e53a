"""Where the faces of a reported box may be: boxes that hold it, strips around its faces."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.perception.seen_free import CELL_M

# A strip consists of at most so many pieces.
_PIECES_MAX: Final = 200


def enclosing_boxes(seen_leg_m: FloatArray, face_error_m: float) -> list[Box]:
    """Return boxes along the leg that hold all within an error of the faces of turned ones.

    The error that the caller adds to the faces along the leg is left out.
    """
    low, high = seen_leg_m.min(axis=1), seen_leg_m.max(axis=1)
    sides_m = np.abs(seen_leg_m[:, 1:3] - seen_leg_m[:, 0:2])
    lengths_m = np.hypot(sides_m[..., 0], sides_m[..., 1])
    longer = np.arange(len(sides_m)), lengths_m.argmax(axis=1)
    # A box without extent may be turned by any angle.
    turned, long = np.full(len(sides_m), math.sqrt(2.0)), lengths_m[longer] > CELL_M
    np.divide(sides_m[longer].sum(axis=1), lengths_m[longer], out=turned, where=long)
    margins_m = np.maximum(turned - 1.0, 0.0)[:, None] * face_error_m
    low, high = low - margins_m, high + margins_m
    rows = np.stack((low[:, 0], high[:, 0], low[:, 1], high[:, 1]), axis=1)
    return [Box(*row) for row in rows.tolist()]


def strip_around(
    begin_m: FloatArray, end_m: FloatArray, margin_m: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return rectangles along the leg that cover all within a margin of a line (box norm)."""
    along_m = end_m - begin_m
    length_m = float(np.hypot(along_m[0], along_m[1]))
    unit = along_m / length_m if length_m > 0.0 else np.array([1.0, 0.0])
    whole_m = length_m + 2.0 * margin_m
    count = min(math.ceil(whole_m / max(2.0 * margin_m, CELL_M)), _PIECES_MAX)
    steps_m = (np.arange(count) + 0.5) * (whole_m / count) - margin_m
    middle_m = begin_m + steps_m[:, None] * unit
    half_m = whole_m / count / 2.0 * np.abs(unit) + margin_m * np.abs(unit[::-1])
    low_m, high_m = middle_m - half_m, middle_m + half_m
    return low_m[:, 0], high_m[:, 0], low_m[:, 1], high_m[:, 1]
