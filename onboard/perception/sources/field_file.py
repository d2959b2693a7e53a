"""Virtual obstacles of a field file, seen as a level scanner at the vehicle's centre sees them.

Rays meet the nearest box, so that what hides another casts its shadow, and only what was seen is
free, as with a real scan.  Boxes are placed by the autopilot's own estimate, so that no error of
the position shows.  There is no message: the service asks for a measurement when one is due.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.sensor_sources import FieldFileSource
from onboard.geometry.frames import FloatArray
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.scan.levelling import BodyMotion
from onboard.perception.scan.range_beams import BeamDirections, levelled_beams
from onboard.perception.scan.scan_frames import ScanFrames
from onboard.perception.sources.sensor_input import PastPoses, SensorInput
from onboard.vehicle_state import Pose

# North and east.
Home = tuple[float, float]
_HOME: Final = struct.Struct("<2d")
_STEP_RAD: Final = math.radians(0.25)
_NEAREST_M: Final = 0.05
# Of rays: round-off takes nothing off the range that is declared.
_BEYOND_M: Final = 0.01


def request_of(home_ned_m: Home | None) -> bytes:
    """Return what asks for a measurement; it states where the vehicle was armed, if known."""
    return b"" if home_ned_m is None else _HOME.pack(*home_ned_m)


class FieldFileInput(SensorInput):
    """Measures the boxes of a field.

    Args:
        config: of the sensor; its field is read at once.
        poses: of the body.

    Raises:
        FileError: the field cannot be used.
    """

    def __init__(self, config: FieldFileSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._field = _at_least(load_field(config.field), config.range_m * _STEP_RAD)
        self._frames = ScanFrames(config)
        count = math.ceil(math.radians(config.field_of_view_deg) / _STEP_RAD)
        width_rad = math.radians(config.field_of_view_deg) / count
        angle_rad: FloatArray = (np.arange(count, dtype=np.float64) - (count - 1) / 2.0) * width_rad
        self._directions = BeamDirections.of_plane(angle_rad, width_rad, config, thin=True)
        self._angle_rad = angle_rad

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Measure as of a latency ago.

        Args:
            payload: of `request_of`.
            now_unix_s: when the measurement arrives.
        """
        config, stamp_unix_s = self._config, now_unix_s - self._config.latency_s
        pose = self._poses.at(stamp_unix_s)
        level = pose._replace(roll_rad=0.0, pitch_rad=0.0)
        ranges_m = self._ranges_m(level, self._origin_ned_m(payload))
        motion = BodyMotion.of([level], None)
        limits_m = (_NEAREST_M, config.range_m + _BEYOND_M)
        beams = levelled_beams(
            ranges_m, limits_m, self._directions, motion, pose.position_ned_m[2], config
        )
        return (self._frames.frame(beams, pose, stamp_unix_s, self._poses.generation),)

    def _origin_ned_m(self, payload: bytes) -> Home:
        if self._config.relative_to == "local_ned":
            return 0.0, 0.0
        if len(payload) != _HOME.size:
            raise DecodeError("where the vehicle was armed is unknown")
        north_m, east_m = _HOME.unpack(payload)
        return north_m, east_m

    def _ranges_m(self, pose: Pose, origin_ned_m: Home) -> FloatArray:
        """Return the distance to the nearest box along each ray, (n,); infinite without one."""
        field, range_m = self._field, self._config.range_m
        here_m = np.array(pose.position_ned_m[:2]) - origin_ned_m
        reach_m = range_m + np.hypot(*field.half_size_m.T)
        near = np.flatnonzero(np.hypot(*(field.center_ned_m - here_m).T) <= reach_m)
        bearing_rad = self._angle_rad[None, :] + (pose.yaw_rad - field.yaw_rad[near])[:, None]
        cosine, sine = np.cos(field.yaw_rad[near]), np.sin(field.yaw_rad[near])
        off_m = here_m - field.center_ned_m[near]
        along_m = cosine * off_m[:, 0] + sine * off_m[:, 1]
        across_m = cosine * off_m[:, 1] - sine * off_m[:, 0]
        half_m = field.half_size_m[near]
        enter_x_m, leave_x_m = _slab(along_m, np.cos(bearing_rad), half_m[:, 0])
        enter_y_m, leave_y_m = _slab(across_m, np.sin(bearing_rad), half_m[:, 1])
        enter_m = np.maximum(np.maximum(enter_x_m, enter_y_m), 0.0)
        leave_m = np.minimum(leave_x_m, leave_y_m)
        met_m = np.where(enter_m <= leave_m, enter_m, math.inf)
        nearest_m: FloatArray = met_m.min(axis=0, initial=math.inf)
        return nearest_m


def _slab(
    place_m: FloatArray, direction: FloatArray, half_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return between which distances rays are within a slab around 0; (N,), (N, n), (N,)."""
    # A ray along the slab is in it always, or never.
    steady = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
    first_m = (-half_m - place_m)[:, None] / steady
    second_m = (half_m - place_m)[:, None] / steady
    return np.minimum(first_m, second_m), np.maximum(first_m, second_m)


def _at_least(field: ObstacleField, side_m: float) -> ObstacleField:
    """Return a field whose boxes are no thinner than rays are apart at the range."""
    return ObstacleField(
        field.ids, field.center_ned_m, np.maximum(field.half_size_m, side_m / 2.0), field.yaw_rad
    )
