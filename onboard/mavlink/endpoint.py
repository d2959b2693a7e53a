"""MAVLink 2 without I/O: bytes in, telemetry out; setpoints in, bytes out.

Clearway is component 196 (MAV_COMP_ID_OBSTACLE_AVOIDANCE) on the vehicle's own system id.  PX4 and
ArduPilot differ only in how a heartbeat spells its mode; `_mode_of` knows both.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

# EKF_STATUS_REPORT is ArduPilot's; its dialect contains the common one.
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.mavlink_frames import FrameReader
from onboard.mavlink.autopilot_facts import POSITION_RATE_HZ, facts_of
from onboard.mavlink.heading_drift import Attitude, HeadingDrift
from onboard.mavlink.message_requests import MessageRequests
from onboard.mavlink.position_reports import (
    EstimatorReport,
    GpsReport,
    HealthReport,
    PositionReports,
)
from onboard.mavlink.status_text import chunks
from onboard.vehicle_state import Pose, Setpoint, Target, VehicleStatus

COMPONENT_ID: Final = mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE
HEARTBEAT_PERIOD_S: Final = 1.0
TELEMETRY_RATE_HZ: Final = POSITION_RATE_HZ
# A position without an attitude this recent is no pose.
ATTITUDE_AGE_MAX_S: Final = 0.2
# Beyond these a position is garbage, and what would follow from it fits no message.
_COORDINATE_MAX_M: Final = 1e6
_SPEED_MAX_MPS: Final = 1e3

# Every field of the setpoint is meant except the yaw rate.
_TYPE_MASK: Final = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_POSITION_IGNORED: Final = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_VELOCITY_IGNORED: Final = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
_PX4_MAIN_MODE_OFFBOARD: Final = 6
_COPTER_MODE_GUIDED: Final = 4
# Of STATUSTEXT: together a tenth of what a serial line at 57,600 baud carries.
_TEXT_PERIOD_S: Final = 0.1
_TEXTS_MAX: Final = 100
_TEXT_ID_MAX: Final = 0xFFFF

_FAILSAFE_STATES: Final = (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY)
_SETPOINT_MESSAGES: Final = (
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
)


@dataclass
class LinkCounters:
    """What arrived and was not used; nothing of it ever raises.

    Attributes:
        garbage_bytes: no part of an intact frame.
        malformed_messages: with values that are no numbers, or absurd.
        foreign_messages: of the kinds that are read, but not from our autopilot.
    """

    garbage_bytes: int = 0
    malformed_messages: int = 0
    foreign_messages: int = 0


class MavlinkEndpoint:
    """Our end of the link to one autopilot.

    Args:
        system_id: MAVLink id of the vehicle, and ours.
    """

    def __init__(self, system_id: int) -> None:
        self.status = VehicleStatus()
        self.pose: Pose | None = None
        self.counters = LinkCounters()
        # What the autopilot says of its position.
        self.position_reports = PositionReports()
        # When somebody else last told the vehicle where to go, and who.
        self.rival_heard_s = -math.inf
        self.rival = ""
        # Where the autopilot says it is going and how fast, and when it said so.
        self.target_heard_s = -math.inf
        self.target: Target = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        # How far the magnetometer is off, as a share of the estimator's gate; None until known.
        self.compass_ratio: float | None = None
        self._system_id = system_id
        self._attitude_rad: tuple[float, float, float] | None = None
        self._attitude_s = -math.inf
        self._outgoing: deque[bytes] = deque(maxlen=1000)
        self._mavlink = mavlink.MAVLink(_Sink(self._outgoing), system_id, COMPONENT_ID)
        self._handlers: dict[int, Callable[[Any, float], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._on_position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._on_attitude,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._on_extended_state,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self._on_target,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self._on_estimator_status,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._on_ekf_status,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._on_gps,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._on_health,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._on_text,
        }
        wanted = frozenset((*self._handlers, *_SETPOINT_MESSAGES))
        self._reader = FrameReader(mavlink, wanted, trusts_unknown=True)
        self.heading_drift = HeadingDrift()
        self._heartbeat_due_s = -math.inf
        # Severity, chunk, id of the text, number of the chunk.
        self._texts: deque[tuple[int, bytes, int, int]] = deque(maxlen=_TEXTS_MAX)
        self._text_due_s = -math.inf
        self._text_id = 0
        self._requests = MessageRequests()

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the link; malformed ones are counted and dropped."""
        for message in self._reader.read(data):
            self._handle(message, now_s)
        self.counters.garbage_bytes = self._reader.bytes_dropped

    def bytes_to_send(self) -> bytes:
        """Return and forget what is to be sent."""
        data = b"".join(self._outgoing)
        self._outgoing.clear()
        return data

    def keep_alive(self, now_s: float, *, active: bool) -> None:
        """Send the heartbeat and a text that waits; ask for telemetry that is missing or slow."""
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + HEARTBEAT_PERIOD_S
            state = mavlink.MAV_STATE_ACTIVE if active else mavlink.MAV_STATE_STANDBY
            self._mavlink.heartbeat_send(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state
            )
        if self._texts and now_s >= self._text_due_s:
            self._text_due_s = now_s + _TEXT_PERIOD_S
            self._mavlink.statustext_send(*self._texts.popleft())
        if math.isfinite(self.status.heard_s):
            wanted_hz = self.position_reports.facts.requested_hz
            for message_id, rate_hz in self._requests.due(wanted_hz, now_s):
                self._request(message_id, rate_hz)

    def send_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """Queue one SET_POSITION_TARGET_LOCAL_NED."""
        self._mavlink.set_position_target_local_ned_send(
            int(now_s * 1000.0) & 0xFFFFFFFF,
            self._system_id,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            _TYPE_MASK,
            *setpoint.position_ned_m,
            *setpoint.velocity_ned_mps,
            *setpoint.acceleration_ned_mps2,
            setpoint.yaw_ned_rad,
            0.0,
        )

    def send_text(self, severity: int, text: str) -> None:
        """Queue a text for the operator; ``severity`` is a MAV_SEVERITY.

        It leaves chunk by chunk with `keep_alive`: a burst of texts must not crowd set-points out
        of a slow link.
        """
        parts = chunks(text)
        text_id = 0
        if len(parts) > 1:
            self._text_id = text_id = self._text_id % _TEXT_ID_MAX + 1
        self._texts.extend((severity, part, text_id, n) for n, part in enumerate(parts))

    def _request(self, message_id: int, rate_hz: float) -> None:
        self._mavlink.command_long_send(
            self._system_id,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            0,
            message_id,
            1e6 / rate_hz,
            *(0,) * 5,
        )

    def _handle(self, message: Any, now_s: float) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender != (self._system_id, mavlink.MAV_COMP_ID_AUTOPILOT1):
            self.counters.foreign_messages += 1
            self._note_rival(message, now_s)
        elif (handler := self._handlers.get(message.get_msgId())) is not None:
            self._requests.heard(message.get_msgId())
            handler(message, now_s)

    def _note_rival(self, message: Any, now_s: float) -> None:
        tells_where_to_go = message.get_msgId() in _SETPOINT_MESSAGES
        if tells_where_to_go and message.target_system in (0, self._system_id):
            self.rival_heard_s = now_s
            self.rival = f"{message.get_srcSystem()}/{message.get_srcComponent()}"

    def _on_heartbeat(self, message: Any, now_s: float) -> None:
        mode, external_control = _mode_of(message)
        self.status = replace(
            self.status,
            heard_s=now_s,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            ardupilot=message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            external_control=external_control,
            mode=mode,
            failsafe=message.system_status in _FAILSAFE_STATES,
        )
        self.position_reports.facts = facts_of(message.autopilot)

    def _on_position(self, message: Any, now_s: float) -> None:
        position_ned_m = (message.x, message.y, message.z)
        velocity_ned_mps = (message.vx, message.vy, message.vz)
        # NaN compares false.
        sane = all(abs(p_m) <= _COORDINATE_MAX_M for p_m in position_ned_m) and all(
            abs(v_mps) <= _SPEED_MAX_MPS for v_mps in velocity_ned_mps
        )
        if not sane:
            self.counters.malformed_messages += 1
        elif self._attitude_rad is not None and now_s - self._attitude_s <= ATTITUDE_AGE_MAX_S:
            measured_s = message.time_boot_ms / 1e3
            self.pose = Pose(
                now_s, position_ned_m, velocity_ned_mps, *self._attitude_rad, measured_s
            )

    def _on_attitude(self, message: Any, now_s: float) -> None:
        attitude_rad = (message.roll, message.pitch, message.yaw)
        rates_radps = (message.rollspeed, message.pitchspeed, message.yawspeed)
        if all(map(math.isfinite, attitude_rad)):
            self._attitude_rad, self._attitude_s = attitude_rad, now_s
            if all(map(math.isfinite, rates_radps)):
                measured_s = message.time_boot_ms / 1e3
                self.heading_drift.add(Attitude(measured_s, *attitude_rad, *rates_radps))
        else:
            self.counters.malformed_messages += 1

    def _on_target(self, message: Any, now_s: float) -> None:
        position_ned_m = (message.x, message.y, message.z)
        velocity_ned_mps = (message.vx, message.vy, message.vz)
        nowhere = (math.nan, math.nan, math.nan)
        if message.type_mask & _POSITION_IGNORED:
            position_ned_m = nowhere
        if message.type_mask & _VELOCITY_IGNORED:
            velocity_ned_mps = nowhere
        self.target_heard_s, self.target = now_s, (position_ned_m, velocity_ned_mps)

    def _on_extended_state(self, message: Any, _: float) -> None:
        known = message.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
        airborne = message.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
        self.status = replace(self.status, airborne=airborne if known else None)

    def _on_estimator_status(self, message: Any, now_s: float) -> None:
        report = EstimatorReport(
            "ESTIMATOR_STATUS",
            message.flags,
            message.vel_ratio,
            message.pos_horiz_ratio,
            message.pos_vert_ratio,
            message.pos_horiz_accuracy,
        )
        self.compass_ratio = message.mag_ratio
        self.position_reports.estimator.hear(report, now_s)

    def _on_ekf_status(self, message: Any, now_s: float) -> None:
        report = EstimatorReport(
            "EKF_STATUS_REPORT",
            message.flags,
            message.velocity_variance,
            message.pos_horiz_variance,
            message.pos_vert_variance,
            math.nan,
        )
        self.compass_ratio = message.compass_variance
        self.position_reports.estimator.hear(report, now_s)

    def _on_gps(self, message: Any, now_s: float) -> None:
        self.position_reports.hear_gps(GpsReport(message.fix_type), now_s)

    def _on_health(self, message: Any, now_s: float) -> None:
        report = HealthReport(
            message.onboard_control_sensors_present,
            message.onboard_control_sensors_enabled,
            message.onboard_control_sensors_health,
        )
        self.position_reports.health.hear(report, now_s)

    def _on_text(self, message: Any, now_s: float) -> None:
        if message.severity <= mavlink.MAV_SEVERITY_WARNING:
            self.position_reports.hear_text(message.text, now_s)


class _Sink:
    """The write-only file that pymavlink wants."""

    def __init__(self, queue: deque[bytes]) -> None:
        self._queue = queue

    def write(self, data: bytes) -> None:
        self._queue.append(bytes(data))


_PX4_MAIN_MODES: Final = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
}
_PX4_AUTO_MODES: Final = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND"}


def _mode_of(heartbeat: Any) -> tuple[str, bool]:
    """Return the mode's name and whether it obeys external setpoints."""
    if heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        guided = heartbeat.custom_mode == _COPTER_MODE_GUIDED
        return ("GUIDED" if guided else f"COPTER {heartbeat.custom_mode}"), guided
    main = heartbeat.custom_mode >> 16 & 0xFF
    sub = heartbeat.custom_mode >> 24 & 0xFF
    name = _PX4_MAIN_MODES.get(main, f"PX4 {main}")
    if name == "AUTO":
        name = _PX4_AUTO_MODES.get(sub, f"AUTO {sub}")
    return name, main == _PX4_MAIN_MODE_OFFBOARD
