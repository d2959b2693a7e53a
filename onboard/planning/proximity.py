"""Least distance of a trajectory from boxes: the choice to make where no trajectory certifies."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.motion.trajectory import Trajectory, X, Y

# Samples of a trajectory: a vehicle moves less than its own radius from one to the next.
STEP_S: Final = 0.1
SAMPLES_MAX: Final = 1000


def least_room_m(trajectory: Trajectory, boxes: Iterable[Box]) -> float:
    """Return the least distance of a trajectory from any box, in metres, by samples.

    Negative inside a box: how far from its nearest face; infinite without boxes.
    """
    duration_s = trajectory.end_s - trajectory.start_s
    count = min(math.ceil(duration_s / STEP_S) + 1, SAMPLES_MAX)
    times_s = trajectory.start_s + np.linspace(0.0, duration_s, count)
    points_m = np.array([trajectory.sample(time_s).position_leg_m for time_s in times_s.tolist()])
    rooms_m = (_distance_m(box, points_m[:, X], points_m[:, Y]).min() for box in boxes)
    return float(min(rooms_m, default=math.inf))


def _distance_m(box: Box, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    outside_x_m = np.maximum(box.x_min_m - x_m, x_m - box.x_max_m)
    outside_y_m = np.maximum(box.y_min_m - y_m, y_m - box.y_max_m)
    inside_m = np.minimum(np.maximum(outside_x_m, outside_y_m), 0.0)
    outside_m: FloatArray = np.hypot(np.maximum(outside_x_m, 0.0), np.maximum(outside_y_m, 0.0))
    return outside_m + inside_m
