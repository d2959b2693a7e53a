"""sensor_msgs/PointCloud2 as detection frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from onboard.files.sensor_sources import PointCloudSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.point_cloud import decode_point_cloud
from onboard.perception.scan.cloud_beams import cloud_beams, covered_bearings
from onboard.perception.scan.levelling import (
    FRD_FROM,
    BodyMotion,
    band_above_ground_m,
    mounting_offset_m,
    mounting_rotation,
)
from onboard.perception.scan.scan_frames import ScanFrames
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput


class PointCloudInput(SensorInput):
    """Reads PointCloud2: all points count as measured at its stamp.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: PointCloudSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._frames, self._frame_id = ScanFrames(config), OneFrameId(config.frame_id)
        self._body_from_sensor = mounting_rotation(config.mounting)

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode one cloud."""
        config, cloud = self._config, decode_point_cloud(payload)
        self._frame_id.check(cloud.header)
        if config.no_return_is_free_to_m is None and not np.isfinite(cloud.points_m[0]).any():
            # Of a covered camera as well as of an open sky.
            raise DecodeError("not a single point")
        stamp_unix_s = cloud.header.stamp_unix_s
        pose = self._poses.at(stamp_unix_s)
        level = BodyMotion.of([pose], None).levelled(np.eye(3))
        from_sensor = level @ self._body_from_sensor
        sensor_m = (level @ mounting_offset_m(config.mounting))[:, 0]
        covered = covered_bearings(from_sensor, config.view_deg, config)
        turn = from_sensor @ FRD_FROM[config.axes]
        band_m = band_above_ground_m(config, pose.position_ned_m[2], float(sensor_m[2]))
        beams = cloud_beams(cloud.points_m, turn, sensor_m, covered, band_m, config)
        return (self._frames.frame(beams, pose, stamp_unix_s, self._poses.generation),)
