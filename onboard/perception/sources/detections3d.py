"""vision_msgs/Detection3DArray as detection frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from onboard.files.sensor_sources import DetectionsSource
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import MovingFrame, kind_of_labels
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.messages import DetectedBox, Quaternion, decode_detections
from onboard.perception.scan.box_tracks import BoxTracks
from onboard.perception.scan.cloud_beams import BEARINGS_RAD, covered_bearings
from onboard.perception.scan.free_ranges import BIN_RAD, free_view
from onboard.perception.scan.levelled_beams import LevelledBeams
from onboard.perception.scan.levelling import (
    FRD_FROM,
    BodyMotion,
    band_above_ground_m,
    is_in_band,
    mounting_offset_m,
    mounting_rotation,
)
from onboard.perception.scan.scan_frames import ScanFrames, VerticalView
from onboard.perception.sources.sensor_input import OneFrameId, PastPoses, SensorInput
from onboard.vehicle_state import Pose

_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
_NAME_MAX = 60


class _Footprint(NamedTuple):
    """A box from above, in the levelled body, and what encloses it in local NED."""

    center_m: tuple[float, float]
    size_m: tuple[float, float]
    yaw_rad: float
    bounds_ned_m: FloatArray
    down_m: tuple[float, float]
    kind: str


class DetectionsInput(SensorInput):
    """Reads Detection3DArray; boxes without an ``id`` are named by where they are.

    Every box counts, whatever its score.  A detector that reports nothing says that nothing is
    there only as far as ``no_return_is_free_to_m`` allows.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: DetectionsSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        self._frames, self._frame_id = ScanFrames(config), OneFrameId(config.frame_id)
        self._tracks = BoxTracks(config.cluster_gap_m / 2.0, math.inf)
        self._generation = 0

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:  # noqa: ARG002  stamped
        """Decode the detections of one instant."""
        config, message = self._config, decode_detections(payload)
        self._frame_id.check(message.header)
        stamp_unix_s = message.header.stamp_unix_s
        pose = self._poses.at(stamp_unix_s)
        level = BodyMotion.of([pose], None).levelled(np.eye(3))
        mounted = mounting_rotation(config.mounting)
        from_sensor = level @ mounted
        sensor_m = (level @ mounting_offset_m(config.mounting))[:, 0]
        band_m = band_above_ground_m(config, pose.position_ned_m[2], float(sensor_m[2]))
        view = free_view(
            self._looks(from_sensor, sensor_m, band_m),
            range_m=config.range_m,
            view_max_rad=math.radians(config.field_of_view_deg),
            own_radius_m=config.own_radius_m,
        )
        if view is None:
            raise DecodeError("does not look ahead")
        turn = from_sensor @ FRD_FROM[config.axes]
        # Of the body: a sensor that is mounted at an angle sees less either way.
        mounted_deg = math.degrees(math.acos(min(max(mounted[2, 2], -1.0), 1.0)))
        vertical_deg = min(max(config.view_deg[1] / 2.0 - mounted_deg, 0.0), 89.0)
        found = [
            (box.id, self._footprint(box, turn, sensor_m, band_m, pose)) for box in message.boxes
        ]
        obstacles = self._obstacles([(name, each) for name, each in found if each is not None])
        return (
            self._frames.frame_of(
                obstacles,
                stamp_unix_s,
                range_m=view.range_m,
                field_of_view_deg=min(math.degrees(2.0 * view.half_view_rad), 360.0),
                free_range_m=tuple(view.free_m.tolist()),
                vertical_view=VerticalView((vertical_deg, vertical_deg), band_m),
                kind=MovingFrame,
            ),
        )

    def _looks(
        self, from_sensor: FloatArray, sensor_m: FloatArray, band_m: tuple[float, float]
    ) -> LevelledBeams:
        """Return what the sensor looks at as beams that return nothing."""
        config, looks = self._config, is_in_band(float(sensor_m[2]), band_m)
        covered = np.flatnonzero(covered_bearings(from_sensor, config.view_deg, config))
        nothing, count = np.zeros(covered.size, np.bool_), covered.size
        return LevelledBeams(
            BEARINGS_RAD[covered],
            np.full(count, BIN_RAD),
            nothing,
            np.zeros((2, count)),
            np.full(count, (config.no_return_is_free_to_m or 0.0) if looks else 0.0),
            nothing,
            np.full(count, config.range_m if looks else 0.0),
            (float(sensor_m[0]), float(sensor_m[1])),
        )

    def _footprint(
        self,
        box: DetectedBox,
        turn: FloatArray,
        sensor_m: FloatArray,
        band_m: tuple[float, float],
        pose: Pose,
    ) -> _Footprint | None:
        """Return a box from above; None for one that lies above or below the vehicle."""
        own = rotation_of(box.center.rotation)
        corners_m = (_CORNERS * box.size_m) @ own.T + box.center.position_m
        corners_m = corners_m @ turn.T + sensor_m
        above_m, below_m = band_m
        if corners_m[:, 2].min() > below_m or corners_m[:, 2].max() < -above_m:
            return None
        # The side that lies flattest gives the direction.
        axes = turn @ own
        axis = axes[:, int(np.hypot(axes[0], axes[1]).argmax())]
        yaw_rad = math.atan2(axis[1], axis[0])
        frame = LegFrame((0.0, 0.0, 0.0), yaw_rad)
        turned_m = frame.vector_leg_from_ned(corners_m)
        low_m, high_m = turned_m.min(axis=0), turned_m.max(axis=0)
        down_m = (float(low_m[2]), float(high_m[2]))
        center_m = frame.vector_ned(tuple(((low_m + high_m) / 2.0).tolist()))
        size_m = (float(high_m[0] - low_m[0]), float(high_m[1] - low_m[1]))
        body = LegFrame(pose.position_ned_m, pose.yaw_rad)
        ned_m = body.position_ned_from_leg(corners_m)
        low_m, high_m = ned_m.min(axis=0), ned_m.max(axis=0)
        bounds_ned_m = np.array((low_m[0], high_m[0], low_m[1], high_m[1]))
        kind = kind_of_labels(box.labels, self._config.labels)
        return _Footprint(center_m[:2], size_m, yaw_rad, bounds_ned_m, down_m, kind)

    def _obstacles(self, found: list[tuple[str, _Footprint]]) -> list[dict[str, Any]]:
        if self._generation != self._poses.generation:
            self._generation = self._poses.generation
            self._tracks.forget()
        taken: set[str] = set()
        names: list[str | None] = []
        for name, _ in found:
            # A name that comes twice in one frame names nothing.
            unique = bool(name) and name not in taken
            taken.add(name)
            names.append(f"id-{name}"[:_NAME_MAX] if unique else None)
        unnamed = [
            each.bounds_ned_m for name, (_, each) in zip(names, found, strict=True) if not name
        ]
        numbers = iter(self._tracks.name(np.array(unnamed).reshape(-1, 4)))
        return [
            {
                "id": f"{self._generation}.{next(numbers)}" if name is None else name,
                "center_m": each.center_m,
                "size_m": each.size_m,
                "yaw_deg": math.degrees(each.yaw_rad),
                "uncertainty_m": self._config.uncertainty_m,
                "down_m": each.down_m,
                "down_uncertainty_m": self._config.uncertainty_m,
                "class": each.kind,
                "box_whole": self._config.boxes_whole,
            }
            for name, (_, each) in zip(names, found, strict=True)
        ]


def rotation_of(quaternion: Quaternion) -> FloatArray:
    """Return the rotation matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
