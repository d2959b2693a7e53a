"""Levelled beams as detection frames: boxes, free ranges, and how far and wide was seen."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.files.sensor_sources import SensorSource
from onboard.geometry.frames import LegFrame
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import MovingFrame, ReturnsFrame
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.scan.free_ranges import free_view
from onboard.perception.scan.levelled_beams import LevelledBeams
from onboard.perception.scan.scan_boxes import NamedBox, ScanBoxes
from onboard.vehicle_state import Pose

# Free ranges are rounded down to this.
_STEP_M: Final = 1e-3
# A frame has to state a range and a view; this is none.
_NO_RANGE_M: Final = 0.01


# A sensor of which more than this share of the view returns no measurement does not look.
_BLIND_SHARE_MAX: Final = 0.5


class VerticalView(NamedTuple):
    """What a frame says of heights, as in `DetectionFrame`."""

    vertical_field_of_view_deg: tuple[float, float]
    reported_height_m: tuple[float, float] | None = None


NO_HEIGHTS: Final = VerticalView((0.0, 0.0))


class BlindAheadError(DecodeError):
    """A scan does not show what lies ahead: a frame without boxes would say that nothing does."""


class ScanFrames:
    """Makes the frames of one sensor.

    Args:
        config: of the sensor.
    """

    def __init__(self, config: SensorSource) -> None:
        self._config = config
        self._boxes = ScanBoxes(config)
        self._sequence = 0

    def frame(
        self,
        beams: LevelledBeams,
        pose: Pose,
        stamp_unix_s: float,
        generation: int,
        lasting_s: float = 0.0,
    ) -> DetectionFrame:
        """Return the frame of a scan, seen from the levelled body.

        Args:
            beams: in the order of their bearings.
            pose: of the body at the stamp.
            stamp_unix_s: when the scan began.
            generation: of the local frame.
            lasting_s: how long it took.

        Raises:
            BlindAheadError: the beams do not cover the nose, or most of them measured nothing.
        """
        config = self._config
        view = free_view(
            beams,
            range_m=config.range_m,
            view_max_rad=math.radians(config.field_of_view_deg),
            own_radius_m=config.own_radius_m,
        )
        if view is None:
            raise BlindAheadError("does not look ahead")
        in_view = np.abs(beams.bearing_rad) <= view.half_view_rad
        blind = float((beams.width_rad * beams.blocked)[in_view].sum())
        if blind > _BLIND_SHARE_MAX * float(beams.width_rad[in_view].sum()):
            raise BlindAheadError("mostly blind")
        boxes = self._boxes.find(beams, pose, generation)
        free_m = np.floor(np.maximum(view.free_m, 0.0) / _STEP_M) * _STEP_M
        return self.frame_of(
            self._in_body(boxes, pose),
            stamp_unix_s,
            range_m=view.range_m,
            field_of_view_deg=min(math.degrees(2.0 * view.half_view_rad), 360.0),
            free_range_m=tuple(free_m.tolist()),
            lasting_s=lasting_s,
        )

    def frame_of(
        self,
        obstacles: list[dict[str, Any]],
        stamp_unix_s: float,
        *,
        range_m: float,
        field_of_view_deg: float,
        free_range_m: tuple[float, ...],
        vertical_view: VerticalView = NO_HEIGHTS,
        lasting_s: float = 0.0,
        kind: type[MovingFrame] = ReturnsFrame,
    ) -> DetectionFrame:
        """Return the next frame with given content: returns, unless its kind says more of it.

        A scan takes everything within its band of heights for pillars, so that by itself it shows
        none of the heights between its beams.
        """
        self._sequence += 1
        return kind.model_validate(
            {
                "version": 2,
                "source": self._config.name,
                "sequence": self._sequence,
                "stamp_unix_s": stamp_unix_s,
                "frame": "body_frd",
                "range_m": max(range_m, _NO_RANGE_M),
                "field_of_view_deg": field_of_view_deg,
                "obstacles": obstacles,
                "free_range_m": free_range_m,
                "frame_complete": True,
                "exposure_s": max(lasting_s, self._config.measured_within_s),
                **vertical_view._asdict(),
            }
        )

    def _in_body(self, boxes: list[NamedBox], pose: Pose) -> list[dict[str, Any]]:
        body = LegFrame(pose.position_ned_m, pose.yaw_rad)
        return [
            {
                "id": box.name,
                "center_m": body.position_leg((*box.center_ned_m, 0.0))[:2],
                "size_m": box.size_m,
                "yaw_deg": math.degrees(box.yaw_rad - pose.yaw_rad),
                "uncertainty_m": self._config.uncertainty_m,
                "partial": box.partial,
            }
            for box in boxes
        ]
