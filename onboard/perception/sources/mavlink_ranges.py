"""MAVLink OBSTACLE_DISTANCE and DISTANCE_SENSOR as detection frames.

Their stamps count from the sender's start or are of no known clock: a message counts as measured a
declared latency before it arrived (https://mavlink.io/en/messages/common.html).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import FrameReader
from onboard.files.sensor_sources import (
    DistanceSensorSource,
    MavlinkSource,
    ObstacleDistanceSource,
)
from onboard.geometry.frames import FloatArray
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.keys import REPLACED_AFTER_S
from onboard.perception.scan.levelling import BodyMotion
from onboard.perception.scan.range_beams import BeamDirections, levelled_beams
from onboard.perception.scan.scan_frames import ScanFrames
from onboard.perception.sources.laser_scan import ConeFrames
from onboard.perception.sources.sensor_input import PastPoses, SensorInput

_UNKNOWN: Final = 65535
_NORTH_ALIGNED: Final = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_LOCAL_NED)
_INVALID_QUALITY: Final = 1


class OneSender:
    """Lets through OBSTACLE_DISTANCE of one sender and kind of sensor at a time: two are two.

    An autopilot may send on, later and merged with more, what it has heard from a sensor.
    """

    def __init__(self) -> None:
        self._sender: tuple[int, int, int] | None = None
        self._heard_s = -math.inf

    def check(self, message: Any, time_s: float) -> None:
        """Check who sent a message.

        Raises:
            DecodeError: another one is still heard.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent(), int(message.sensor_type))
        silent = time_s - self._heard_s > REPLACED_AFTER_S
        if self._sender not in (None, sender) and not silent:
            raise DecodeError("two senders")
        self._sender, self._heard_s = sender, time_s


class MavlinkRanges(SensorInput):
    """Reads one kind of message; each payload is one MAVLink frame.

    Args:
        message_id: of the kind.
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, message_id: int, config: MavlinkSource, poses: PastPoses) -> None:
        super().__init__()
        self._latency_s, self._poses = config.latency_s, poses
        self._reader = FrameReader(mavlink, {message_id}, trusts_unknown=False)

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message."""
        messages = self._reader.read(payload)
        stamp_unix_s = now_unix_s - self._latency_s
        return [frame for each in messages for frame in self._frames_of(each, stamp_unix_s)]

    @abstractmethod
    def _frames_of(self, message: Any, stamp_unix_s: float) -> Sequence[DetectionFrame]: ...


class ObstacleDistanceInput(MavlinkRanges):
    """Reads OBSTACLE_DISTANCE: 72 sectors, each with its nearest obstacle.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: ObstacleDistanceSource, poses: PastPoses) -> None:
        super().__init__(mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, config, poses)
        self._config, self._frames = config, ScanFrames(config)
        self._sender = OneSender()

    def _frames_of(self, message: Any, stamp_unix_s: float) -> Sequence[DetectionFrame]:
        self._sender.check(message, stamp_unix_s)
        step_deg = message.increment_f or float(message.increment)
        offset_deg = message.angle_offset
        if not (math.isfinite(step_deg) and 0.0 < abs(step_deg) <= 90.0):
            raise DecodeError("increment")
        if not (math.isfinite(offset_deg) and abs(offset_deg) <= 360.0):
            raise DecodeError("angle offset")
        if not 0 <= message.min_distance < message.max_distance:
            raise DecodeError("range limits")
        pose = self._poses.at(stamp_unix_s)
        angle_rad = np.radians(offset_deg + step_deg * np.arange(72.0))
        if message.frame in _NORTH_ALIGNED:
            angle_rad -= pose.yaw_rad
            level = pose._replace(roll_rad=0.0, pitch_rad=0.0)
        elif message.frame == mavlink.MAV_FRAME_BODY_FRD:
            level = pose
        else:
            raise DecodeError("coordinate frame")
        ranges_m, given = _sector_ranges_m(message)
        directions = BeamDirections.of_plane(
            angle_rad[given], math.radians(abs(step_deg)), self._config, thin=False
        )
        limits_m = (message.min_distance / 100.0, (message.max_distance + 0.5) / 100.0)
        motion = BodyMotion.of([level], None)
        beams = levelled_beams(
            ranges_m[given], limits_m, directions, motion, pose.position_ned_m[2], self._config
        )
        return (self._frames.frame(beams, pose, stamp_unix_s, self._poses.generation),)


class DistanceSensorInput(MavlinkRanges):
    """Reads DISTANCE_SENSOR of one sensor that looks forward; one that looks down sees the ground.

    Args:
        config: of the sensor.
        poses: of the body.
    """

    def __init__(self, config: DistanceSensorSource, poses: PastPoses) -> None:
        super().__init__(mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, config, poses)
        self._sensor_id, self._width_rad = config.sensor_id, math.radians(config.beam_width_deg)
        self._cone = ConeFrames(config, poses)

    def _frames_of(self, message: Any, stamp_unix_s: float) -> Sequence[DetectionFrame]:
        if message.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270:
            return ()
        if message.orientation != mavlink.MAV_SENSOR_ROTATION_NONE:
            raise DecodeError("does not look ahead")
        if self._sensor_id is None:
            self._sensor_id = message.id
        if message.id != self._sensor_id:
            raise DecodeError("another sensor id")
        if not 0 <= message.min_distance < message.max_distance:
            raise DecodeError("range limits")
        width_rad = message.horizontal_fov
        if not (math.isfinite(width_rad) and 0.0 <= width_rad < math.pi):
            raise DecodeError("field of view")
        invalid = message.signal_quality == _INVALID_QUALITY
        range_m = math.nan if invalid else message.current_distance / 100.0
        limits_m = (message.min_distance / 100.0, (message.max_distance + 0.5) / 100.0)
        width_rad = max(width_rad, self._width_rad)
        return (self._cone.frame(range_m, limits_m, width_rad, stamp_unix_s),)


def _sector_ranges_m(message: Any) -> tuple[FloatArray, Any]:
    """Return the ranges of all sectors, and which of them the sensor has.

    One beyond the greatest distance says that nothing is there.  65535 says that nothing is known,
    or that there is no such sector: it is as if the sensor did not look there.
    """
    centimetres = np.array(message.distances, np.float64)
    given = np.flatnonzero(centimetres != _UNKNOWN)
    if given.size == 0:
        raise DecodeError("no sector is known")
    return centimetres / 100.0, given
