"""Turns what a mounted sensor measured into the levelled body: forward, right, down, yaw only.

The levelled body stands where the vehicle was at a reference time, with the heading that it had.  A
scan takes time; each beam is placed by the pose of its own moment (de-skewing).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.files.sensor_sources import Axes, Mounting, SensorSource
from onboard.geometry.frames import FloatArray
from onboard.vehicle_state import Pose

# To forward, right, down: from forward, left, up, as ROS has it, and from a camera's right, down,
# forward.
FRD_FROM: Final[dict[Axes, FloatArray]] = {
    "flu": np.diag([1.0, -1.0, -1.0]),
    "optical": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}

# Less than a vehicle, and a sensor of it, stands high.
_BAND_MIN_M: Final = 0.1
# Below this cosine of the pitch, yaw and roll turn about one axis and cannot be told apart.  It is
# less than what a rotation may be off by, so that leaving it out is no error.
_LOCKED_MAX: Final = 1e-7
_ROTATION_ERROR_MAX: Final = 1e-6


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Attitude and place of the body for each beam, in the levelled body of the reference time.

    Attributes:
        roll_rad, pitch_rad, yaw_rad: (n,), or (1,) for all beams; yaw from that of the reference.
        place_m: (3, n) or (3, 1), from the place of the reference.
    """

    roll_rad: FloatArray
    pitch_rad: FloatArray
    yaw_rad: FloatArray
    place_m: FloatArray

    @classmethod
    def of(cls, poses: Sequence[Pose], beam_s: FloatArray | None) -> BodyMotion:
        """Return the motion through some poses, of which the first is the reference.

        Args:
            poses: in the order of time.
            beam_s: (n,) when each beam was measured, after the reference; None for all at once.
        """
        reference = poses[0]
        angles = np.array([(p.roll_rad, p.pitch_rad, p.yaw_rad) for p in poses])
        if np.ptp(angles, axis=0).max() >= math.pi:
            angles = np.unwrap(angles, axis=0)
        angles = angles.T
        angles[2] -= reference.yaw_rad
        offset_m = np.array([p.position_ned_m for p in poses]) - reference.position_ned_m
        cosine, sine = math.cos(reference.yaw_rad), math.sin(reference.yaw_rad)
        place_m = np.stack(
            (
                cosine * offset_m[:, 0] + sine * offset_m[:, 1],
                cosine * offset_m[:, 1] - sine * offset_m[:, 0],
                offset_m[:, 2],
            )
        )
        if beam_s is None:
            return cls(angles[0, :1], angles[1, :1], angles[2, :1], place_m[:, :1])
        knots_s = np.array([pose.time_s - reference.time_s for pose in poses])
        roll, pitch, yaw, *place = (np.interp(beam_s, knots_s, v) for v in (*angles, *place_m))
        return cls(roll, pitch, yaw, np.array(place))

    def levelled(self, vectors: FloatArray) -> FloatArray:
        """Turn vectors (3, n) or (3, 1) from the body into the levelled body."""
        x, y, z = vectors
        roll, pitch, yaw = self._turns
        y, z = roll[0] * y - roll[1] * z, roll[1] * y + roll[0] * z
        x, z = pitch[0] * x + pitch[1] * z, pitch[0] * z - pitch[1] * x
        return np.array((yaw[0] * x - yaw[1] * y, yaw[1] * x + yaw[0] * y, z))

    @functools.cached_property
    def _turns(self) -> list[tuple[FloatArray, FloatArray]]:
        """Cosine and sine of each angle."""
        angles_rad = (self.roll_rad, self.pitch_rad, self.yaw_rad)
        return [(np.cos(angle), np.sin(angle)) for angle in angles_rad]


def mounting_rotation(mounting: Mounting) -> FloatArray:
    """Return the rotation (3, 3) from the sensor, forward, right, down, into the body."""
    turns = []
    for degrees, (first, second) in (
        (mounting.yaw_deg, (0, 1)),
        (mounting.pitch_deg, (2, 0)),
        (mounting.roll_deg, (1, 2)),
    ):
        turn = np.eye(3)
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn[first, first] = turn[second, second] = cosine
        turn[first, second], turn[second, first] = -sine, sine
        turns.append(turn)
    rotation: FloatArray = turns[0] @ turns[1] @ turns[2]
    return rotation


def mounting_of(base_from_sensor: FloatArray, axes: Axes) -> Mounting:
    """Return the mounting of a sensor whose pose in the base is known.

    Args:
        base_from_sensor: (4, 4) from the sensor's own axes into forward, left, up of the body.
        axes: of the sensor.

    Raises:
        ValidationError: it is farther from the base than a mounting may be.
        ValueError: its turn is not a rotation.
    """
    flip = FRD_FROM["flu"]
    turn = flip @ base_from_sensor[:3, :3] @ FRD_FROM[axes].T
    x_m, y_m, z_m = (float(value) for value in flip @ base_from_sensor[:3, 3])
    level = math.hypot(turn[0, 0], turn[1, 0])
    if level < _LOCKED_MAX:
        # Straight up or down: what there is of a turn about the axis counts as yaw.
        roll_rad, yaw_rad = 0.0, math.atan2(-turn[0, 1], turn[1, 1])
    else:
        roll_rad = math.atan2(turn[2, 1], turn[2, 2])
        yaw_rad = math.atan2(turn[1, 0], turn[0, 0])
    mounting = Mounting(
        x_m=x_m,
        y_m=y_m,
        z_m=z_m,
        roll_deg=math.degrees(roll_rad),
        pitch_deg=math.degrees(math.atan2(-turn[2, 0], level)),
        yaw_deg=math.degrees(yaw_rad),
    )
    error = float(np.abs(mounting_rotation(mounting) - turn).max())
    if not error <= _ROTATION_ERROR_MAX:  # NaN compares false
        raise ValueError(f"the turn of the pose is no rotation: its angles are {error:g} off")
    return mounting


def mounting_offset_m(mounting: Mounting) -> FloatArray:
    """Return where the sensor is in the body, (3, 1)."""
    return np.array([[mounting.x_m], [mounting.y_m], [mounting.z_m]])


def band_above_ground_m(
    config: SensorSource, down_m: float, sensor_down_m: float = 0.0
) -> tuple[float, float]:
    """Return the heights above and below the vehicle that are looked at, without the ground.

    Near the ground the band ends just below the vehicle and its sensor: a level beam still counts.

    Args:
        config: of the sensor.
        down_m: of the vehicle in local NED, whose origin is on the ground.
        sensor_down_m: how far the sensor is below the vehicle's centre, in the levelled body.
    """
    above_m, below_m = config.height_band_m
    ground_m = max(-down_m - config.ground_margin_m, _BAND_MIN_M, sensor_down_m + _BAND_MIN_M)
    return above_m, min(below_m, ground_m)


def is_in_band(sensor_down_m: float, band_m: tuple[float, float]) -> bool:
    """Tell whether a sensor is at a height that is looked at; from outside none of it is seen.

    Args:
        sensor_down_m: below the vehicle's centre, in the levelled body.
        band_m: heights above and below the vehicle.
    """
    above_m, below_m = band_m
    return -above_m <= sensor_down_m <= below_m


def in_sectors(
    bearing_rad: FloatArray, sectors_deg: Sequence[tuple[float, float]]
) -> NDArray[np.bool_]:
    """Tell of each bearing whether it lies in one of some sectors (from, to), clockwise."""
    inside = np.zeros(bearing_rad.shape, np.bool_)
    for first_deg, last_deg in sectors_deg:
        wide_rad = math.radians((last_deg - first_deg) % 360.0)
        inside |= (bearing_rad - math.radians(first_deg)) % (2.0 * math.pi) <= wide_rad
    return inside
