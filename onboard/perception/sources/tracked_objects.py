"""autoware_perception_msgs/TrackedObjects as reports: movers besides those that sensors see.

A tracker smooths, predicts, and forgets: what it does not report may be there, so that it shows no
place free.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from onboard.files.sensor_sources import TrackedObjectsSource
from onboard.geometry.frames import FloatArray
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import ReportsFrame, kind_of_labels
from onboard.perception.ros2.tracked_objects import TrackedObject, decode_tracked_objects
from onboard.perception.scan.levelling import (
    FRD_FROM,
    BodyMotion,
    mounting_offset_m,
    mounting_rotation,
)
from onboard.perception.sources.detections3d import rotation_of
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput
from onboard.vehicle_state import Pose

# From east, north, up to north, east, down.
_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# A frame states no more; to be left out would be less.
_ERROR_MAX_M = 100.0


class TrackedObjectsInput(SensorInput):
    """Reads TrackedObjects.

    Args:
        config: of the tracker.
        poses: of the body.
    """

    def __init__(self, config: TrackedObjectsSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._frame_id, self._sequence = OneFrameId(config.frame_id), 0

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode the objects of one instant."""
        config, message = self._config, decode_tracked_objects(payload)
        self._frame_id.check(message.header)
        stamp_unix_s = message.header.stamp_unix_s
        pose = self._poses.at(stamp_unix_s)
        turn, origin_ned_m = self._placed(pose)
        self._sequence += 1
        taken: Counter[str] = Counter()
        obstacles = []
        for each in message.objects:
            center_ned_m = turn @ np.array(each.center.position_m) + origin_ned_m
            away_m = math.dist(center_ned_m[:2], pose.position_ned_m[:2])
            if away_m - self._error_m(each) > config.range_m:
                continue
            taken[each.id] += 1
            # A name that comes twice in one message does not name one of them.
            name = each.id if taken[each.id] == 1 else f"{each.id}-{taken[each.id]}"
            obstacles.append(self._obstacle(name, each, turn, center_ned_m))
        return (
            ReportsFrame.model_validate(
                {
                    "version": 2,
                    "source": config.name,
                    "sequence": self._sequence,
                    "stamp_unix_s": stamp_unix_s,
                    "frame": "local_ned",
                    "range_m": config.range_m,
                    "field_of_view_deg": 360.0,
                    "obstacles": obstacles,
                    "exposure_s": config.measured_within_s,
                }
            ),
        )

    def _placed(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return what turns from the frame of the messages into local NED, and its origin there."""
        config = self._config
        if config.objects_frame == "local_enu":
            return _NED_FROM_ENU, np.zeros(3)
        level = BodyMotion.of([pose], None).levelled(np.eye(3))
        cosine, sine = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        heading = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        body = heading @ level
        turn = body @ mounting_rotation(config.mounting) @ FRD_FROM["flu"]
        offset_m = (body @ mounting_offset_m(config.mounting))[:, 0]
        return turn, offset_m + np.array(pose.position_ned_m)

    def _error_m(self, each: TrackedObject) -> float:
        """Return how far an object may be off."""
        return self._config.uncertainty_m + (self._config.sigmas or 0.0) * each.position_sigma_m

    def _obstacle(
        self, name: str, each: TrackedObject, turn: FloatArray, center_ned_m: FloatArray
    ) -> dict[str, Any]:
        config = self._config
        yaw_rad, (length_m, width_m) = _footprint(turn @ rotation_of(each.center.rotation), each)
        sigmas = config.sigmas or 0.0
        seen: dict[str, Any] = {
            "id": name,
            "center_m": tuple(center_ned_m[:2].tolist()),
            "size_m": (length_m, width_m),
            "yaw_deg": math.degrees(yaw_rad),
            "uncertainty_m": min(self._error_m(each), _ERROR_MAX_M),
            "class": kind_of_labels(each.labels, config.labels),
            "box_whole": config.boxes_whole,
        }
        if each.heading_known:
            along_mps, left_mps = each.velocity_mps
            # Upright, an object's left is a quarter turn before its front, seen from above.
            cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
            seen["velocity_mps"] = (
                cosine * along_mps + sine * left_mps,
                sine * along_mps - cosine * left_mps,
            )
            if config.sigmas is not None:
                seen["velocity_uncertainty_mps"] = min(sigmas * each.velocity_sigma_mps, 300.0)
        return seen


def _footprint(axes: FloatArray, each: TrackedObject) -> tuple[float, tuple[float, float]]:
    """Return the yaw of an object, and what it covers along and across, seen from above.

    Args:
        axes: its own in local NED, as columns; a tilted box covers some of its height, too.
        each: the object.
    """
    size_m = np.array(each.size_m)
    if not each.axis_known:
        size_m[:2] = math.hypot(*each.size_m[:2])
    yaw_rad = math.atan2(axes[1, 0], axes[0, 0])
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    along_across = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0]])
    length_m, width_m = (np.abs(along_across @ axes) @ size_m).tolist()
    return yaw_rad, (length_m, width_m)
