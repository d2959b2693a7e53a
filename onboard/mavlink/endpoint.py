"""MAVLink 2 without I/O: bytes in, telemetry out; setpoints in, bytes out.

Clearway is component 196 (MAV_COMP_ID_OBSTACLE_AVOIDANCE) on the vehicle's own system id.  What
differs between autopilots comes from the profile that fits the heartbeat
(`onboard.mavlink.profiles`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

# EKF_STATUS_REPORT is ArduPilot's; its dialect contains the common one.
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.mavlink_frames import FrameReader
from onboard.mavlink.battery import BatteryReports
from onboard.mavlink.heading_drift import Attitude, HeadingDrift
from onboard.mavlink.link_security import LinkSecurity
from onboard.mavlink.message_requests import MessageRequests
from onboard.mavlink.mission_reader import MissionReader
from onboard.mavlink.position_reports import (
    EstimatorReport,
    GpsReport,
    HealthReport,
    PositionReports,
)
from onboard.mavlink.profiles.profile import (
    ESTIMATOR_MESSAGES,
    POSITION_RATE_HZ,
    AutopilotProfile,
    EstimatorMessage,
)
from onboard.mavlink.profiles.registry import OTHER, profile_of
from onboard.mavlink.signing import LinkSigning
from onboard.mavlink.transmitter import COMPONENT_ID, Transmitter
from onboard.vehicle_state import Pose, Setpoint, Target, VehicleStatus

TELEMETRY_RATE_HZ: Final = POSITION_RATE_HZ
# Another daemon that has not been heard for so long has gone; a few heartbeats may be lost.
OTHER_DAEMON_SILENCE_S: Final = 5.0
# Each says so once a second: one that has just begun to listen does not know yet.
LISTENED_MIN_S: Final = 1.5
# A position makes a pose only with an attitude this recent.
ATTITUDE_AGE_MAX_S: Final = 0.2
# Beyond these a position is garbage, and what would follow from it fits no message.
_COORDINATE_MAX_M: Final = 1e6
_SPEED_MAX_MPS: Final = 1e3

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
_FAILSAFE_STATES: Final = (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY)
_SETPOINT_MESSAGES: Final = (
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
)
# Ranges come from the autopilot or from any other component of the vehicle, but not from us: our
# own OBSTACLE_DISTANCE tells what we know, and is no measurement.
_RANGE_MESSAGES: Final = (
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR,
)
_MISSION_MESSAGES: Final = (
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
)
# Of other vehicles; these the vehicle itself sends about itself.
_OF_OWN_POSITION: Final = (
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mavlink.MAVLINK_MSG_ID_UTM_GLOBAL_POSITION,
)
_RANGES_HZ: Final = 10.0
_BATTERY_HZ: Final = 1.0
# By which a change of the mission on board shows.
_MISSION_HZ: Final = 1.0
# A tick sees one or two; a burst beyond this is a fault: the oldest are dropped.
_RANGES_PENDING_MAX: Final = 32
# Of others there may be many.
_TRAFFIC_PENDING_MAX: Final = 256
_NOWHERE: Final = (math.nan, math.nan, math.nan)


@dataclass
class LinkCounters:
    """What arrived and was not used; nothing of it ever raises.

    Attributes:
        garbage_bytes: bytes outside any intact frame.
        malformed_messages: with values that are NaN, infinite or absurd.
        foreign_messages: of the kinds that are read, but not from our autopilot, or our own.
    """

    garbage_bytes: int = 0
    malformed_messages: int = 0
    foreign_messages: int = 0


class MavlinkEndpoint:
    """Our end of the link to one autopilot.

    Args:
        system_id: MAVLink id of the vehicle, and ours.
        signing: signs what is sent, and refuses what is not signed alike; None for neither.
        instance: a number of this process that no other daemon has, below 2**32.

    Attributes:
        profile: of the autopilot whose heartbeat came last; `OTHER` before the first.
        status: what it says of itself.
        pose: the newest; None before the first.
        counters: what arrived and was not used.
        position_reports: what it says of its position.
        second_commander_heard_s, second_commander: when another node last told the vehicle where
            to go, and which ("system id/component id").
        target_heard_s, target: when the autopilot last said where it is going, and where.
        compass_ratio: innovation ratio of the magnetometer; None until known.
        transmitter: queues what is sent.
        heading_drift: of the estimated heading against the gyros.
        battery: what it says of its batteries.
        wants_battery: whether BATTERY_STATUS is requested.
        missions: reads the mission on board, where that is wanted.
        security: what is refused because of its signature.
        range_messages: ids of the messages of ranges that are wanted, to be taken by `take_ranges`.
        traffic_messages: ids of those of other vehicles, to be taken by `take_traffic`.
    """

    def __init__(
        self, system_id: int, signing: LinkSigning | None = None, instance: int = 0
    ) -> None:
        self.profile: AutopilotProfile = OTHER
        self.status = VehicleStatus()
        self.pose: Pose | None = None
        self.counters = LinkCounters()
        self.position_reports = PositionReports()
        self.second_commander_heard_s = -math.inf
        self.second_commander = ""
        self.target_heard_s = -math.inf
        self.target: Target = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self.compass_ratio: float | None = None
        self.heading_drift = HeadingDrift()
        self.battery, self.wants_battery = BatteryReports(), False
        self.missions = MissionReader()
        self.range_messages: frozenset[int] = frozenset()
        self._ranges: deque[tuple[int, bytes]] = deque(maxlen=_RANGES_PENDING_MAX)
        self.traffic_messages: frozenset[int] = frozenset()
        self._traffic: deque[tuple[int, bytes]] = deque(maxlen=_TRAFFIC_PENDING_MAX)
        self._system_id = system_id
        self._attitude_rad: tuple[float, float, float] | None = None
        self._attitude_s = -math.inf
        self.security = LinkSecurity(signing)
        self.transmitter = Transmitter(system_id, signing, instance)
        self._instance, self._other_daemon_s = instance, -math.inf
        self._listens_since_s = math.inf
        self._requests = MessageRequests()
        self._handlers: dict[int, Callable[[Any, float], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._on_position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._on_attitude,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._on_extended_state,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self._on_target,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._on_gps,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._on_health,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery.hear_battery,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._on_text,
            **dict.fromkeys(_MISSION_MESSAGES, self._on_mission),
            **{each.message_id: partial(self._on_estimator, each) for each in ESTIMATOR_MESSAGES},
        }
        self._reader = self._new_reader()

    def _new_reader(self) -> FrameReader:
        own = (*self._handlers, *_SETPOINT_MESSAGES, *_RANGE_MESSAGES)
        return FrameReader(mavlink, {*own, *self.traffic_messages}, trusts_unknown=True)

    def listen_to_traffic(self, messages: frozenset[int]) -> None:
        """Hear other vehicles, too; before anything is received.

        Args:
            messages: ids of what they send, and of what the vehicle says that places them.
        """
        self.traffic_messages = messages
        self._reader = self._new_reader()

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the link; malformed ones are counted and dropped."""
        for message in self._reader.read(data):
            of_vehicle = self._is_vehicle(message)
            if self.security.admits(message, now_s, of_vehicle=of_vehicle):
                self._handle(message, now_s, of_vehicle=of_vehicle)
        self.counters.garbage_bytes = self._reader.bytes_dropped

    def bytes_to_send(self) -> bytes:
        """Return and forget what is to be sent."""
        return self.transmitter.bytes_to_send()

    def keep_alive(self, now_s: float, *, active: bool) -> None:
        """Send the heartbeat and a text that waits; request telemetry that is missing or slow."""
        self.transmitter.keep_alive(now_s, active=active)
        if math.isfinite(self.status.heard_s):
            ranges_hz = ((message_id, _RANGES_HZ) for message_id in self.range_messages)
            battery_hz = ((mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, _BATTERY_HZ),)
            wanted_hz = (*self.profile.requested_hz, *ranges_hz)
            if self.wants_battery:
                wanted_hz += battery_hz
            if self.missions.wanted:
                wanted_hz += ((mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, _MISSION_HZ),)
            self.transmitter.request(self._requests.due(wanted_hz, now_s))
            if (request := self.missions.due(now_s)) is not None:
                self.transmitter.send_mission_request(request)

    def take_ranges(self) -> list[tuple[int, bytes]]:
        """Return and forget the messages of ranges that have arrived: id, and the whole frame."""
        taken = list(self._ranges)
        self._ranges.clear()
        return taken

    def take_traffic(self) -> list[tuple[int, bytes]]:
        """Return and forget the messages of other vehicles that have arrived, as `take_ranges`."""
        taken = list(self._traffic)
        self._traffic.clear()
        return taken

    def send_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """Queue one SET_POSITION_TARGET_LOCAL_NED."""
        self.transmitter.send_setpoint(setpoint, now_s)

    def send_text(self, severity: int, text: str) -> None:
        """Queue a text for the operator; ``severity`` is a MAV_SEVERITY."""
        self.transmitter.send_text(severity, text)

    def _is_vehicle(self, message: Any) -> bool:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return bool(sender == (self._system_id, mavlink.MAV_COMP_ID_AUTOPILOT1))

    def _handle(self, message: Any, now_s: float, *, of_vehicle: bool) -> None:
        message_id = message.get_msgId()
        if message_id in self.traffic_messages and self._is_of_others(message, of_vehicle):
            self._traffic.append((message_id, bytes(message.get_msgbuf())))
            if not of_vehicle:
                return
        if message_id in _RANGE_MESSAGES:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            if sender == (self._system_id, COMPONENT_ID):
                self.counters.foreign_messages += 1  # our own, routed back to us
            elif sender[0] == self._system_id and message_id in self.range_messages:
                self._requests.heard(message_id)
                self._ranges.append((message_id, bytes(message.get_msgbuf())))
        elif not of_vehicle:
            self.counters.foreign_messages += 1
            self._note_second_commander(message, now_s)
            self._note_other_daemon(message, now_s)
        elif (handler := self._handlers.get(message_id)) is not None:
            self._requests.heard(message_id)
            handler(message, now_s)

    def _is_of_others(self, message: Any, of_vehicle: bool) -> bool:
        """Tell whether a message is of other vehicles, or says where our own local frame is."""
        message_id, own = message.get_msgId(), message.get_srcSystem() == self._system_id
        if message_id == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            return of_vehicle
        return not (own and message_id in _OF_OWN_POSITION)

    def _note_second_commander(self, message: Any, now_s: float) -> None:
        tells_where_to_go = message.get_msgId() in _SETPOINT_MESSAGES
        if tells_where_to_go and message.target_system in (0, self._system_id):
            self.second_commander_heard_s = now_s
            self.second_commander = f"{message.get_srcSystem()}/{message.get_srcComponent()}"

    def _note_other_daemon(self, message: Any, now_s: float) -> None:
        """Tell another daemon from ourselves, whose messages a router may send back."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        beats = message.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT
        as_we_are = sender == (self._system_id, COMPONENT_ID)
        if beats and as_we_are and message.custom_mode != self._instance:
            self._other_daemon_s = now_s

    def hears_other_daemon(self, now_s: float) -> bool:
        """Whether another daemon of the same ids is on the link."""
        return now_s - self._other_daemon_s <= OTHER_DAEMON_SILENCE_S

    def other_daemon(self, now_s: float) -> str | None:
        """Return why another daemon may be on the link; None if none is."""
        if self.hears_other_daemon(now_s):
            return "another Clearway daemon is on the vehicle's link: stop one of both"
        if self._instance != 0 and not now_s - self._listens_since_s >= LISTENED_MIN_S:
            return "listening for another Clearway daemon on the vehicle's link"
        return None

    def _on_heartbeat(self, message: Any, now_s: float) -> None:
        self._listens_since_s = min(self._listens_since_s, now_s)
        self.profile = profile_of(message.autopilot)
        self.position_reports.facts = self.profile.estimator
        modes = self.profile.modes
        self.status = replace(
            self.status,
            heard_s=now_s,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            external_control=modes.is_external_control(message.custom_mode),
            mode=modes.name_of(message.custom_mode),
            failsafe=message.system_status in _FAILSAFE_STATES,
        )
        self.missions.hear_armed(now_s, armed=self.status.armed)

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
        if message.type_mask & _POSITION_IGNORED:
            position_ned_m = _NOWHERE
        if message.type_mask & _VELOCITY_IGNORED:
            velocity_ned_mps = _NOWHERE
        self.target_heard_s, self.target = now_s, (position_ned_m, velocity_ned_mps)

    def _on_extended_state(self, message: Any, _: float) -> None:
        known = message.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
        airborne = message.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
        self.status = replace(self.status, airborne=airborne if known else None)

    def _on_estimator(self, kind: EstimatorMessage, message: Any, now_s: float) -> None:
        report = EstimatorReport(
            kind.name,
            message.flags,
            getattr(message, kind.velocity),
            getattr(message, kind.position),
            getattr(message, kind.height),
            math.nan if kind.accuracy is None else getattr(message, kind.accuracy),
        )
        self.compass_ratio = getattr(message, kind.heading)
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
        self.battery.hear_system(message, now_s)

    def _on_mission(self, message: Any, now_s: float) -> None:
        target = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
        for_us = target == (self._system_id, COMPONENT_ID)
        self.missions.hear(message, now_s, for_us=for_us)

    def _on_text(self, message: Any, now_s: float) -> None:
        if message.severity <= mavlink.MAV_SEVERITY_WARNING:
            self.position_reports.hear_text(message.text, now_s)
