"""sensor_msgs/LaserScan and sensor_msgs/Range as detection frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.files.sensor_sources import LaserScanSource, RangeSource, SensorSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.messages import LaserScan, decode_laser_scan, decode_range
from onboard.perception.scan.levelling import BodyMotion
from onboard.perception.scan.range_beams import BeamDirections, levelled_beams
from onboard.perception.scan.scan_frames import ScanFrames
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput

# A scan that takes less than this is taken at once; a longer one is placed by a pose every 20 ms.
_AT_ONCE_S: Final = 1e-3
_POSE_STEP_S: Final = 0.02


class LaserScanInput(SensorInput):
    """Reads LaserScan.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: LaserScanSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._frames, self._frame_id = ScanFrames(config), OneFrameId(config.frame_id)
        self._geometry = (0.0, 0.0, 0)
        self._directions: BeamDirections | None = None

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode one scan."""
        scan = decode_laser_scan(payload)
        self._frame_id.check(scan.header)
        directions, stamp_unix_s = self._directions_of(scan), scan.header.stamp_unix_s
        lasting_s = scan.time_increment_s * (len(scan.ranges_m) - 1)
        count = 1 if lasting_s < _AT_ONCE_S else math.ceil(lasting_s / _POSE_STEP_S) + 1
        times_s = np.linspace(0.0, lasting_s, count).tolist()
        poses = [self._poses.at(stamp_unix_s + time_s) for time_s in times_s]
        beam_s = None if count == 1 else scan.time_increment_s * directions.used.astype(np.float64)
        motion = BodyMotion.of(poses, beam_s)
        limits_m = (scan.range_min_m, scan.range_max_m)
        with np.errstate(invalid="ignore"):  # of signalling NaN
            ranges_m = scan.ranges_m.astype(np.float64)
        down_m = poses[0].position_ned_m[2]
        beams = levelled_beams(ranges_m, limits_m, directions, motion, down_m, self._config)
        generation = self._poses.generation
        return (self._frames.frame(beams, poses[0], stamp_unix_s, generation, lasting_s),)

    def _directions_of(self, scan: LaserScan) -> BeamDirections:
        """Return the directions of the beams, which are the same from scan to scan."""
        geometry = (scan.angle_min_rad, scan.angle_increment_rad, len(scan.ranges_m))
        if self._directions is None or geometry != self._geometry:
            angle_rad = geometry[0] + geometry[1] * np.arange(geometry[2], dtype=np.float64)
            # Counter-clockwise in ROS, clockwise here.
            self._directions = BeamDirections.of_plane(
                -angle_rad, abs(geometry[1]), self._config, thin=True
            )
            self._geometry = geometry
        return self._directions


class RangeInput(SensorInput):
    """Reads Range: one cone, with an obstacle somewhere across it.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: RangeSource, poses: PastPoses) -> None:
        super().__init__()
        self._config = config
        self._cone, self._frame_id = ConeFrames(config, poses), OneFrameId(config.frame_id)

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode one reading."""
        reading = decode_range(payload)
        self._frame_id.check(reading.header)
        limits_m = (reading.range_min_m, reading.range_max_m)
        width_rad, stamp_unix_s = reading.field_of_view_rad, reading.header.stamp_unix_s
        return (self._cone.frame(reading.range_m, limits_m, width_rad, stamp_unix_s),)


class ConeFrames:
    """Makes frames of single cones along the sensor's axis.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: SensorSource, poses: PastPoses) -> None:
        self._config, self._poses, self._frames = config, poses, ScanFrames(config)

    def frame(
        self, range_m: float, limits_m: tuple[float, float], width_rad: float, stamp_unix_s: float
    ) -> DetectionFrame:
        """Return the frame of one reading; see `levelled_beams`."""
        pose = self._poses.at(stamp_unix_s)
        directions = BeamDirections.of_plane(np.zeros(1), width_rad, self._config, thin=False)
        motion = BodyMotion.of([pose], None)
        ranges_m, down_m = np.array([range_m]), pose.position_ned_m[2]
        beams = levelled_beams(ranges_m, limits_m, directions, motion, down_m, self._config)
        return self._frames.frame(beams, pose, stamp_unix_s, self._poses.generation)
