"""A scripted operator over MAVLink: arms, takes off, hands over, lands; no I/O.

It does in virtual time what `gcs_tools` does with MAVSDK in real time, with the same commands, by
the same profiles of autopilots.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import FrameReader, FrameWriter
from onboard.geometry.rest import RestDetector
from onboard.mavlink.profiles.profile import AutopilotProfile, Mode
from onboard.mavlink.profiles.registry import OTHER, profile_of
from onboard.mavlink.signing import LinkSigning

REPEAT_S: Final = 0.5
HEALTH: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
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
        signing: signs every message; None for none.

    Attributes:
        step: what it is doing.
        gave_up: why it never handed the vehicle over; None otherwise.
    """

    def __init__(
        self, system_id: int, altitude_m: float, signing: LinkSigning | None = None
    ) -> None:
        self.step = Step.ARM
        self.gave_up: str | None = None
        self._system_id = system_id
        self._altitude_m = altitude_m
        self._outgoing = _Outgoing(signing)
        self._mavlink = FrameWriter(self._outgoing, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._reader = FrameReader(mavlink, _HEARD, trusts_unknown=False)
        self._armed = self._ready = False
        self._profile: AutopilotProfile = OTHER
        self._external_control = False
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
            case Step.ARM if self._ready and self._takes_off_in_external_control:
                self._set_mode(self._profile.modes.external_control)
            case Step.ARM if self._ready:
                self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            case Step.TAKE_OFF:
                # Where a parameter sets the height, the scenario sets that parameter.
                nan = float("nan")
                by_command = self._profile.take_off.height_parameter is None
                height_m = self._altitude_m if by_command else nan
                self._command(mavlink.MAV_CMD_NAV_TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, height_m)
            case Step.HAND_OVER:
                self._set_mode(self._profile.modes.external_control)
            case Step.INTERVENE:
                self._set_mode(self._profile.modes.hold)
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
            case Step.HAND_OVER if self._external_control:
                self.step = Step.WATCH
            case Step.LAND if not self._armed:
                self.step = Step.DONE
        if self.step is not before:
            self._repeat_s = 0.0
            if before is Step.CLIMB:
                self._ask_for(dict.fromkeys(TAKE_OFF_STREAMS, -1))

    @property
    def _settled(self) -> bool:
        # In the mode of our setpoints, the service flies on as soon as the vehicle has climbed.
        near = abs(self._height_m - self._altitude_m) < HEIGHT_TOLERANCE_M
        return near and (self._profile.take_off.in_external_control or self._rest.at_rest)

    @property
    def _takes_off_in_external_control(self) -> bool:
        """Whether the vehicle has to be in the mode of our setpoints before it is armed."""
        return self._profile.take_off.in_external_control and not self._external_control

    def _handle(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT":
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self._profile = profile_of(message.autopilot)
                modes = self._profile.modes
                self._external_control = modes.is_external_control(message.custom_mode)
            case "SYS_STATUS":
                self._ready = bool(message.onboard_control_sensors_health & HEALTH)
            case "LOCAL_POSITION_NED":
                self._height_m = -message.z
                self._rest.add(message.time_boot_ms / 1e3, (message.x, message.y, message.z))

    def _ask_for(self, intervals_us: dict[int, int]) -> None:
        for message_id, interval_us in intervals_us.items():
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)

    def _set_mode(self, mode: Mode | None) -> None:
        if mode is not None:
            armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self._armed else 0
            base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed
            self._command(mavlink.MAV_CMD_DO_SET_MODE, base_mode, mode.main, mode.sub)

    def _command(self, command: int, *parameters: float) -> None:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._mavlink.command_long_send(
            self._system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, command, 0, *padded
        )


class _Outgoing:
    """The write-only file that pymavlink needs."""

    def __init__(self, signing: LinkSigning | None) -> None:
        self._data, self._signing = bytearray(), signing

    def write(self, data: bytes) -> None:
        self._data += data if self._signing is None else self._signing.sign(bytes(data))

    def take(self) -> bytes:
        data = bytes(self._data)
        self._data.clear()
        return data
