"""Rays of a sensor that is mounted in a moving body: from where they start, and what they meet.

Obstacles are upright and as tall as the sky; the ground is level.  A scan takes time, in which the
body moves and turns: each ray starts where the sensor was at its own moment.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from onboard.files.obstacle_field import FloatArray, ObstacleField
from onboard.files.sensor_sources import SensorPose
from sitl.environment.lidar import ray_ranges_m
from sitl.environment.world import Neighbourhood
from sitl.plant.truth import VehicleTruth

# The vehicle's centre is this high above the ground on which it stands.
_STANDS_M: Final = 0.15
NOTHING: Final = ObstacleField.of(())
# Steeper than this a ray meets the ground or nothing.
_STEEP: Final = 1e-3


class PastTruths:
    """Where the vehicle was, for as long as a scan takes.

    Args:
        lasting_s: of a scan.
    """

    def __init__(self, lasting_s: float) -> None:
        self._lasting_s = lasting_s
        self._truths: deque[VehicleTruth] = deque()

    def add(self, truth: VehicleTruth) -> None:
        """Take what is true now."""
        if self._truths and truth.time_s <= self._truths[-1].time_s:
            self._truths.pop()
        self._truths.append(truth)
        while len(self._truths) > 1 and self._truths[1].time_s <= truth.time_s - self._lasting_s:
            self._truths.popleft()

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (3, n) in local NED, and attitudes (4, n) as in `VehicleTruth`."""
        truths = self._truths
        if len(truths) == 1:
            (truth,) = truths
            shape = (1, len(times_s))
            position_m = np.tile(np.array(truth.position_ned_m)[:, None], shape)
            return position_m, np.tile(np.array(truth.attitude_quaternion)[:, None], shape)
        knots_s = [truth.time_s for truth in truths]
        rows = np.array([(*truth.position_ned_m, *truth.attitude_quaternion) for truth in truths])
        # Opposite quaternions are the same attitude.
        rows[:, 3:] *= np.where(rows[:, 3:] @ rows[0, 3:] < 0.0, -1.0, 1.0)[:, None]
        found = np.stack([np.interp(times_s, knots_s, column) for column in rows.T])
        return found[:3], found[3:] / np.linalg.norm(found[3:], axis=0)


def turned(quaternions: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn vectors (3, n), or (3, 1), by quaternions (4, n): w, x, y, z."""
    (w, x, y, z), (a, b, c) = quaternions, vectors
    # v + 2w (u x v) + 2 u x (u x v), with u the vector part.
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    turned: FloatArray = np.stack(
        (a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p)
    )
    return turned


class MountedBeams:
    """Casts the rays of one sensor.

    Args:
        directions: (3, n) unit vectors in the sensor's axes: forward, right, down.
        mounting: of the sensor.
        field: the obstacles.
    """

    def __init__(self, directions: FloatArray, mounting: SensorPose, field: ObstacleField) -> None:
        angles_deg = (mounting.yaw_deg, mounting.pitch_deg, mounting.roll_deg)
        turn = Rotation.from_euler("ZYX", angles_deg, degrees=True)
        self._directions = turn.as_matrix() @ directions
        self._offset_m = np.array([[mounting.x_m], [mounting.y_m], [mounting.z_m]])
        self._field, self._near = field, Neighbourhood(field)

    def ranges_m(
        self,
        truths: PastTruths,
        times_s: FloatArray,
        range_max_m: float,
        movers: ObstacleField = NOTHING,
    ) -> FloatArray:
        """Return the distance (n,) at which each ray first meets something; infinite beyond range.

        Args:
            truths: of the vehicle.
            times_s: (n,) when each ray is cast.
            range_max_m: how far they reach.
            movers: what moves, where it is as the scan ends.
        """
        places_m, attitudes = truths.at(times_s)
        rays = turned(attitudes, self._directions)
        origins_m = places_m + turned(attitudes, self._offset_m)
        level = np.hypot(rays[0], rays[1])
        # How far the rays start from the place of the first.
        spread_m = float(np.hypot(*(origins_m[:2] - origins_m[:2, :1])).max())
        first_m = (float(origins_m[0, 0]), float(origins_m[1, 0]))
        candidates = self._near.within(first_m, range_max_m + spread_m)
        found_m = np.full(rays.shape[1], math.inf)
        flat = np.flatnonzero(level > _STEEP)
        starts_m, bearings_rad = origins_m[:2, flat].T, np.arctan2(rays[1, flat], rays[0, flat])
        for field, near in ((self._field, candidates), (movers, np.arange(len(movers.ids)))):
            if near.size:
                away_m = ray_ranges_m(starts_m, bearings_rad, field, near) / level[flat]
                found_m[flat] = np.minimum(found_m[flat], away_m)
        ground_m = np.maximum(_STANDS_M - origins_m[2], 0.0) / np.maximum(rays[2], 1e-9)
        found_m = np.minimum(found_m, ground_m)
        return np.where(found_m <= range_max_m, found_m, math.inf)
