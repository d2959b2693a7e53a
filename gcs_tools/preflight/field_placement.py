"""Checks that an obstacle field lies where the mission flies, not in other coordinates."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from gcs_tools.preflight.rule import Rule
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray

# A survey may reach far beyond the mission; without an obstacle this near it is of another site.
SITE_M = 1000.0
AXES = "x_m and center_ned_m begin with metres north, then metres east, of the mission's origin"


def check_placement(obstacles: ObstacleField, mission: Mission, range_m: float) -> Rule:
    """Return a rule that a field breaks if it is probably not meant for this mission.

    It is broken if no obstacle is within sensor range of the mission, and either the nearest one is
    more than `SITE_M` away, or some would be within range with north and east swapped.

    Args:
        obstacles: the field.
        mission: whose legs count.
        range_m: of the sensor.
    """
    nearest_m = float(_distances_m(obstacles, obstacles.center_ned_m, mission).min())
    name, reason = "placement", "the field must be where the mission is"
    if nearest_m <= range_m:
        return Rule(name, nearest_m, range_m, "m", reason, concerns="safety")
    swapped_m = _distances_m(obstacles, obstacles.center_ned_m[:, ::-1], mission)
    count = int((swapped_m <= range_m).sum())
    if count:
        reason = f"{count} obstacles would be on the mission's way with north and east swapped"
        limit_m = range_m
    else:
        reason = f"the nearest obstacle is {nearest_m:,.0f} m from the mission"
        limit_m = SITE_M
    note = f"no obstacle is within sensor range of the mission; {AXES}"
    return Rule(name, nearest_m, limit_m, "m", reason, note=note, concerns="safety")


def _distances_m(
    obstacles: ObstacleField, centers_ned_m: FloatArray, mission: Mission
) -> FloatArray:
    """Return a lower bound of each obstacle's distance from the nearest leg, (N,)."""
    points = np.array([mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)])
    distances_m = np.full(len(centers_ned_m), math.inf)
    for start_m, end_m in pairwise(points):
        along_m = end_m - start_m
        share = (centers_ned_m - start_m) @ along_m / (along_m @ along_m)
        foot_m = start_m + np.clip(share, 0.0, 1.0)[:, None] * along_m
        distances_m = np.minimum(distances_m, np.hypot(*(centers_ned_m - foot_m).T))
    nearest_m: FloatArray = np.maximum(0.0, distances_m - np.hypot(*obstacles.half_size_m.T))
    return nearest_m
