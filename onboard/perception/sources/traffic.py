"""Reports of other vehicles over MAVLink: ADS-B, UTM, positions of other systems, Remote ID.

https://mavlink.io/en/messages/common.html.  Reports add movers: who reports nothing may be there.
Remote ID is off by up to tens of metres and seconds, and its errors are classes without a bound: it
is logged, and nothing relies on it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import FrameReader
from onboard.files.sensor_sources import TrafficSource
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import SPEED_MAX_MPS, ReportsFrame
from onboard.perception.movers.tracker import MEMORY_S
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.sources.remote_id import describe
from onboard.perception.sources.sensor_input import PastPoses, SensorInput
from onboard.vehicle_state import Pose

log = logging.getLogger(__name__)

ORIGIN: Final = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
REMOTE_ID: Final = mavlink.MAVLINK_MSG_ID_OPEN_DRONE_ID_LOCATION
TRAFFIC_IDS: Final = {
    "adsb_vehicle": mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE,
    "utm_global_position": mavlink.MAVLINK_MSG_ID_UTM_GLOBAL_POSITION,
    "global_position_int": mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    "open_drone_id_location": REMOTE_ID,
}
# Whole seconds are cut off.
_WHOLE_SECOND_S: Final = 1.0
# An older report tells nothing that a track would keep.
AGE_MAX_S: Final = MEMORY_S
_CLOCK_TOLERANCE_S: Final = 0.1
# The autopilots' local frames differ by 0.11 % of the distance from the origin.
_FRAMES_APART: Final = 0.0012
# An ellipsoid's height and one above the sea differ by up to this.
_GEOID_MAX_M: Final = 110.0
_ERROR_MAX_M: Final = 100.0
_UNKNOWN_16: Final = 65535
_LOGGED_MAX: Final = 100


class Report(NamedTuple):
    """What one message says of one vehicle.

    Attributes:
        id: of the vehicle.
        place: where it is; altitude NaN where that is not known.
        error_m: how far that may be off horizontally.
        altitude_error_m: and vertically.
        stamp_unix_s: when it was there, or later.
        velocity_mps: north and east; None where that is not known.
    """

    id: str
    place: GeographicPoint
    error_m: float
    altitude_error_m: float
    stamp_unix_s: float
    velocity_mps: tuple[float, float] | None


class TrafficInput(SensorInput):
    """Reads reports; each payload is one MAVLink frame.

    Args:
        config: which count, and how far they may be off.
        poses: of the body.

    Attributes:
        remote_ids: vehicles that Remote ID has told of.
    """

    def __init__(self, config: TrafficSource, poses: PastPoses) -> None:
        super().__init__()
        self._config, self._poses = config, poses
        ids = {ORIGIN, *(TRAFFIC_IDS[each] for each in config.messages)}
        self._reader = FrameReader(mavlink, ids, trusts_unknown=False)
        self._frame: LocalFrame | None = None
        self._sequence = 0
        self.remote_ids: set[str] = set()
        self._read: dict[int, Callable[[Any, float], Report]] = {
            mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE: self._of_adsb,
            mavlink.MAVLINK_MSG_ID_UTM_GLOBAL_POSITION: self._of_utm,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._of_position,
        }

    def frames(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        """Decode one message."""
        found: list[DetectionFrame] = []
        for message in self._reader.read(payload):
            number = message.get_msgId()
            if number == ORIGIN:
                self._take_origin(message)
            elif number == REMOTE_ID:
                self._log_remote_id(message)
            elif (read := self._read.get(number)) is not None and not self._is_own(message):
                found += self._frames_of(read(message, now_unix_s), now_unix_s)
        return found

    # ------------------------------------------------------------------ kinds of messages

    def _of_adsb(self, message: Any, now_unix_s: float) -> Report:
        flags = message.flags
        if not flags & mavlink.ADSB_FLAGS_VALID_COORDS:
            raise DecodeError("no position")
        geometric = message.altitude_type == mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC
        # A pressure altitude is that of a standard day.
        known = geometric and bool(flags & mavlink.ADSB_FLAGS_VALID_ALTITUDE)
        moves = mavlink.ADSB_FLAGS_VALID_VELOCITY | mavlink.ADSB_FLAGS_VALID_HEADING
        velocity_mps = None
        if flags & moves == moves:
            course_rad, speed_mps = (
                math.radians(message.heading / 100.0),
                message.hor_velocity / 1e2,
            )
            velocity_mps = speed_mps * math.cos(course_rad), speed_mps * math.sin(course_rad)
        return Report(
            f"icao-{message.ICAO_address:06x}",
            _place(message, message.altitude if known else None),
            self._config.accuracy_m or math.inf,
            _GEOID_MAX_M + (self._config.accuracy_m or math.inf),
            now_unix_s - self._config.latency_s - message.tslc - _WHOLE_SECOND_S,
            velocity_mps,
        )

    def _of_utm(self, message: Any, now_unix_s: float) -> Report:
        config, flags = self._config, message.flags
        if not flags & mavlink.UTM_DATA_AVAIL_FLAGS_POSITION_AVAILABLE:
            raise DecodeError("no position")
        stamp_unix_s = now_unix_s - config.latency_s
        if flags & mavlink.UTM_DATA_AVAIL_FLAGS_TIME_VALID:
            # Of a clock that may be off as much as it may seem to be ahead.
            stamp_unix_s = message.time / 1e6 - _CLOCK_TOLERANCE_S
            if stamp_unix_s > now_unix_s:
                raise DecodeError("stamp in the future")
        named = flags & mavlink.UTM_DATA_AVAIL_FLAGS_UAS_ID_AVAILABLE
        name = bytes(message.uas_id).hex() if named else f"system-{message.get_srcSystem()}"
        known = flags & mavlink.UTM_DATA_AVAIL_FLAGS_ALTITUDE_AVAILABLE
        moves = flags & mavlink.UTM_DATA_AVAIL_FLAGS_HORIZONTAL_VELO_AVAILABLE
        return Report(
            f"utm-{name}",
            _place(message, message.alt if known else None),
            self._error_m(message.h_acc),
            _GEOID_MAX_M + self._error_m(message.v_acc),
            stamp_unix_s,
            (message.vx / 100.0, message.vy / 100.0) if moves else None,
        )

    def _of_position(self, message: Any, now_unix_s: float) -> Report:
        """Take GLOBAL_POSITION_INT, whose stamp counts from its sender's start."""
        accuracy_m = self._config.accuracy_m or math.inf
        return Report(
            f"system-{message.get_srcSystem()}",
            _place(message, message.alt),
            accuracy_m,
            accuracy_m,
            now_unix_s - self._config.latency_s,
            (message.vx / 100.0, message.vy / 100.0),
        )

    def _error_m(self, sigma_mm: int) -> float:
        """Return how far a value with a stated standard deviation may be off, as declared."""
        config = self._config
        stated = config.sigmas is not None and 0 < sigma_mm < _UNKNOWN_16
        if stated and config.sigmas is not None:
            return config.sigmas * sigma_mm / 1000.0
        return config.accuracy_m or math.inf

    # ------------------------------------------------------------------ from a report to a mover

    def _frames_of(self, report: Report, now_unix_s: float) -> Sequence[DetectionFrame]:
        config, frame = self._config, self._frame
        if frame is None:
            raise DecodeError("local origin not known yet")
        if not now_unix_s - report.stamp_unix_s <= AGE_MAX_S:
            raise DecodeError("too old")
        pose = self._poses.at(now_unix_s)
        north_m, east_m = frame.north_east_m(report.place.latitude_deg, report.place.longitude_deg)
        away_m = math.hypot(north_m, east_m)
        error_m = report.error_m + config.uncertainty_m + _FRAMES_APART * away_m
        here_m = pose.position_ned_m
        if math.dist((north_m, east_m), here_m[:2]) - error_m > config.range_m:
            return ()
        if self._is_at_another_height(report, frame, pose):
            return ()
        if error_m > _ERROR_MAX_M:
            raise DecodeError("accuracy unknown, or too bad")
        self._sequence += 1
        # Values that stand for "unknown" are beyond any speed: the report counts without them.
        velocity_mps = report.velocity_mps
        if velocity_mps is not None and max(map(abs, velocity_mps)) > SPEED_MAX_MPS:
            velocity_mps = None
        seen: dict[str, Any] = {
            "id": report.id,
            "center_m": (north_m, east_m),
            "size_m": (0.0, 0.0),
            "yaw_deg": 0.0,
            "uncertainty_m": error_m,
            "class": config.mover_class,
            "velocity_mps": velocity_mps,
        }
        return (
            ReportsFrame.model_validate(
                {
                    "version": 2,
                    "source": config.name,
                    "sequence": self._sequence,
                    "stamp_unix_s": report.stamp_unix_s,
                    "frame": "local_ned",
                    "range_m": config.range_m,
                    "field_of_view_deg": 360.0,
                    "obstacles": (seen,),
                }
            ),
        )

    def _is_at_another_height(self, report: Report, frame: LocalFrame, pose: Pose) -> bool:
        """Tell whether a vehicle is surely farther above or below than counts; else it is not."""
        if self._config.height_m is None:
            return False
        down_m = frame.origin.altitude_m - report.place.altitude_m
        apart_m = abs(down_m - pose.position_ned_m[2]) - report.altitude_error_m
        return apart_m > self._config.height_m  # NaN compares false

    def _take_origin(self, message: Any) -> None:
        origin = _place(message, message.altitude, "latitude", "longitude")
        self._frame = LocalFrame(origin)

    def _is_own(self, message: Any) -> bool:
        own = self._config.own_icao_address
        return own is not None and getattr(message, "ICAO_address", None) == own

    def _log_remote_id(self, message: Any) -> None:
        """Log a vehicle that Remote ID tells of, once; nothing relies on it."""
        name, text = describe(message, self._frame)
        if name not in self.remote_ids and len(self.remote_ids) < _LOGGED_MAX:
            self.remote_ids.add(name)
            log.info("%s: Remote ID of %s: %s; shown only", self._config.name, name, text)


def _place(
    message: Any, altitude_mm: int | None, latitude: str = "lat", longitude: str = "lon"
) -> GeographicPoint:
    """Return a place in units of MAVLink.

    Raises:
        DecodeError: it is none.
    """
    latitude_deg, longitude_deg = (
        getattr(message, latitude) / 1e7,
        getattr(message, longitude) / 1e7,
    )
    altitude_m = math.nan if altitude_mm is None else altitude_mm / 1000.0
    place = GeographicPoint(latitude_deg, longitude_deg, altitude_m)
    if place.problem() is not None or latitude_deg == longitude_deg == 0.0:
        raise DecodeError("no position")
    return place
