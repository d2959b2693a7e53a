"""A frame that has counted for the mover-free set, as it is kept: on its raster."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.perception.line_of_sight import BoolArray
from onboard.perception.movers.open_cells import OpenCells
from onboard.perception.movers.raster import Rectangle


@dataclass
class Past:
    """What is kept of a frame that can no longer change places: its part in its sensor's row."""

    stamp_s: float
    source: str
    row: int
    open: OpenCells


@dataclass
class Step:
    """A frame on the raster, and what was known before it."""

    stamp_s: float
    # When the measurement had ended.
    ended_s: float
    source: str
    # Which of its sensor's rows of successive frames it belongs to.
    row: int
    seen: BoolArray
    shaded: BoolArray
    # What movers may fill, and what they fill at least.
    occupied: list[Rectangle]
    filled: list[Rectangle]
    free_until_s: FloatArray = field(default_factory=lambda: np.empty(0))
    unvisited_until_s: FloatArray = field(default_factory=lambda: np.empty(0))
    # What this frame shows open.
    open: OpenCells = field(default_factory=lambda: OpenCells(np.empty((0, 0), dtype=bool)))


class Word(NamedTuple):
    """No mover is in a disc at a time, as the operator says."""

    north_m: float
    east_m: float
    radius_m: float
    at_s: float
