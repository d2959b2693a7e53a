"""A scripted operator over MAVLink: arms, takes off, hands over, lands; no I/O.

It does in virtual time what `gcs_tools` does with MAVSDK in real time, with the same commands, for
both flavours.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import FrameReader
from onboard.geometry.rest import RestDetector

REPEAT_S: Final = 0.5
HEALTH: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
OFFBOARD: Final = (6.0, 0.0)
HOLD: Final = (4.0, 3.0)
GUIDED: Final = (4.0, 0.0)
BRAKE: Final = (17.0, 0.0)
# What an operator watches, by the interval [us]; ArduPilot sends nothing else, PX4 less than usual.
# After the take-off heartbeats are enough.
TAKE_OFF_STREAMS: Final = {
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 500_000,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 100_000,
}
STREAMS: Final = {
    **TAKE_OFF_STREAMS,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: -1,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: -1,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: -1,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: -1,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: -1,
}
_HEARD: Final = (mavlink.MAVLINK_MSG_ID_HEARTBEAT, *TAKE_OFF_STREAMS)
# The operator gives up on a vehicle that cannot be armed for this long, or climbs more slowly.
PATIENCE_S: Final = 30.0
CLIMB_MIN_MPS: Final = 0.2
OFF_THE_GROUND_M: Final = 0.15
# PX4 ends its climb up to 0.35 m off the height asked for.
HEIGHT_TOLERANCE_M: Final = 0.5


class Step(Enum):
    """What the operator is doing."""

    ARM = auto()
    TAKE_OFF = auto()
    CLIMB = auto()
    HAND_OVER = auto()
    WATCH = auto()
    INTERVENE = auto()
    LAND = auto()
    DONE = auto()


class Operator:
    """Fly one mission from the ground and back to it.

    Args:
        system_id: MAVLink id of the vehicle.
        altitude_m: height above the local origin to take off to.

    Attributes:
        step: what it is doing.
        gave_up: why it never handed the vehicle over; None otherwise.
    """

    def __init__(self, system_id: int, altitude_m: float) -> None:
        self.step = Step.ARM
        self.gave_up: str | None = None
        self._system_id = system_id
        self._altitude_m = altitude_m
        self._outgoing = _Outgoing()
        self._mavlink = mavlink.MAVLink(self._outgoing, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._reader = FrameReader(mavlink, _HEARD, trusts_unknown=False)
        self._armed = self._ready = False
        self._offboard = self._copter = False
        self._streams_asked = False
        self._height_m = 0.0
        self._rest = RestDetector()
        self._repeat_s = 0.0
        self._climbs_until_s = 0.0

    def receive(self, data: bytes) -> None:
        """Take bytes from the vehicle."""
        for message in self._reader.read(data):
            # The autopilot forwards messages of other components, heartbeats included.
            if message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                self._handle(message)

    def bytes_to_send(self) -> bytes:
        """Return and clear the bytes for the vehicle."""
        return self._outgoing.take()

    def land(self) -> None:
        """End the mission from wherever it is."""
        if self.step in (Step.HAND_OVER, Step.WATCH, Step.INTERVENE):
            self.step, self._repeat_s = Step.LAND, 0.0

    def take_over(self) -> None:
        """Take the vehicle from the service: hold where it is."""
        if self.step is Step.WATCH:
            self.step, self._repeat_s = Step.INTERVENE, 0.0

    def hand_back(self) -> None:
        """Give the vehicle back to the service."""
        if self.step is Step.INTERVENE:
            self.step, self._repeat_s = Step.HAND_OVER, 0.0

    def advance(self, now_s: float) -> None:
        """Continue the script."""
        self._change_step(now_s)
        if now_s < self._repeat_s:
            return
        self._repeat_s = now_s + REPEAT_S
        self._mavlink.heartbeat_send(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
        )
        if not self._streams_asked:
            self._streams_asked = True
            self._ask_for(STREAMS)
        match self.step:
            case Step.ARM if self._ready and self._copter and not self._offboard:
                self._set_mode(OFFBOARD)
            case Step.ARM if self._ready:
                self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            case Step.TAKE_OFF:
                # Without a height PX4 climbs to MIS_TAKEOFF_ALT, which the scenario sets.
                nan = float("nan")
                height_m = self._altitude_m if self._copter else nan
                self._command(mavlink.MAV_CMD_NAV_TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, height_m)
            case Step.HAND_OVER:
                self._set_mode(OFFBOARD)
            case Step.INTERVENE:
                self._set_mode(HOLD)
            case Step.LAND:
                self._command(mavlink.MAV_CMD_NAV_LAND)

    def _change_step(self, now_s: float) -> None:
        before = self.step
        match self.step:
            case Step.ARM if self._armed:
                self.step = Step.TAKE_OFF
                self._climbs_until_s = now_s + PATIENCE_S + self._altitude_m / CLIMB_MIN_MPS
            case Step.ARM if now_s > PATIENCE_S:
                self.step, self.gave_up = Step.DONE, "the vehicle cannot be armed"
            case Step.TAKE_OFF if self._height_m > OFF_THE_GROUND_M:
                self.step = Step.CLIMB
            case Step.CLIMB if self._settled:
                self.step = Step.HAND_OVER
            case Step.TAKE_OFF | Step.CLIMB if now_s > self._climbs_until_s:
                self.step, self.gave_up = Step.LAND, "the vehicle does not climb"
            case Step.HAND_OVER if self._offboard:
                self.step = Step.WATCH
            case Step.LAND if not self._armed:
                self.step = Step.DONE
        if self.step is not before:
            self._repeat_s = 0.0
            if before is Step.CLIMB:
                self._ask_for(dict.fromkeys(TAKE_OFF_STREAMS, -1))

    @property
    def _settled(self) -> bool:
        # GUIDED is handed over from the start: the service flies on as soon as it can.
        near = abs(self._height_m - self._altitude_m) < HEIGHT_TOLERANCE_M
        return near and (self._copter or self._rest.at_rest)

    def _handle(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT":
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self._copter = message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
                if self._copter:
                    self._offboard = message.custom_mode == GUIDED[0]
                else:
                    self._offboard = message.custom_mode >> 16 & 0xFF == OFFBOARD[0]
            case "SYS_STATUS":
                self._ready = bool(message.onboard_control_sensors_health & HEALTH)
            case "LOCAL_POSITION_NED":
                self._height_m = -message.z
                self._rest.add(message.time_boot_ms / 1e3, (message.x, message.y, message.z))

    def _ask_for(self, intervals_us: dict[int, int]) -> None:
        for message_id, interval_us in intervals_us.items():
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)

    def _set_mode(self, mode: tuple[float, float]) -> None:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self._armed else 0
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed
        if self._copter:
            mode = {OFFBOARD: GUIDED, HOLD: BRAKE}[mode]
        self._command(mavlink.MAV_CMD_DO_SET_MODE, base_mode, *mode)

    def _command(self, command: int, *parameters: float) -> None:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._mavlink.command_long_send(
            self._system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, command, 0, *padded
        )


class _Outgoing:
    """The write-only file that pymavlink needs."""

    def __init__(self) -> None:
        self._data = bytearray()

    def write(self, data: bytes) -> None:
        self._data += data

    def take(self) -> bytes:
        data = bytes(self._data)
        self._data.clear()
        return data
