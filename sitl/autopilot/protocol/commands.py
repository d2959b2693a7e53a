"""MAVLink commands: from a MAV_CMD number to a request of the commander, and its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.commander import Commander
from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.standard_modes import (
    AVAILABLE_MODES_ID,
    AvailableMode,
    mode_of_standard,
)
from sitl.autopilot.geodesy import GeographicPosition, ned_from_geographic
from sitl.autopilot.mission import ABSOLUTE_FRAMES, RELATIVE_FRAMES
from sitl.autopilot.modes import Mode
from sitl.autopilot.protocol.files.file_transfer import FileServer, crc32
from sitl.autopilot.protocol.files.onboard_files import GENERAL_METADATA
from sitl.autopilot.protocol.identity_messages import (
    COMPONENT_METADATA_ID,
    PROTOCOL_VERSION_ID,
    ComponentMetadata,
    ProtocolVersion,
)
from sitl.autopilot.protocol.link import MavlinkLink
from sitl.autopilot.protocol.snapshot import Snapshot
from sitl.autopilot.protocol.streams import StreamSchedule
from sitl.autopilot.protocol.telemetry import BUILDERS
from sitl.config import HomeConfig

_ARM_FORCE = 21196.0  # the magic number of MAV_CMD_COMPONENT_ARM_DISARM
_INT32_MAX = 2**31 - 1  # nan in a COMMAND_INT
_REPOSITION_MAX_M = 100_000.0
_MESSAGE_ID_MAX = 0xFFFF  # of MESSAGE_INTERVAL


@dataclass(frozen=True)
class Command:
    """One COMMAND_LONG or COMMAND_INT, in common form.

    Attributes:
        number: MAV_CMD.
        parameters: param1 to param7; latitude and longitude in degrees.
        frame: MAV_FRAME of the position; COMMAND_LONG has none and means global.
    """

    number: int
    parameters: tuple[float, ...]
    frame: int

    @property
    def arms(self) -> bool:
        """Whether it arms, and not by force."""
        switch, force = self.parameters[:2]
        arming = self.number == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and switch == 1.0
        return arming and force != _ARM_FORCE

    @classmethod
    def of(cls, message: Any) -> Command:
        """Return the command that a COMMAND_LONG or COMMAND_INT carries."""
        first = (message.param1, message.param2, message.param3, message.param4)
        if message.get_type() == "COMMAND_LONG":
            last = (message.param5, message.param6, message.param7)
            return cls(message.command, (*first, *last), mavlink.MAV_FRAME_GLOBAL)
        last = (_degrees(message.x), _degrees(message.y), message.z)
        return cls(message.command, (*first, *last), message.frame)


@dataclass(frozen=True)
class CommandContext:
    """What a command may act on: the vehicle, and the link it came by."""

    commander: Commander
    flavour: Flavour
    home: HomeConfig
    snapshot: Snapshot
    link: MavlinkLink
    streams: StreamSchedule
    files: FileServer


def execute(command: Command, context: CommandContext) -> Verdict:
    """Carry out a command and return the result for its COMMAND_ACK."""
    handler = _HANDLERS.get(command.number)
    return Verdict.UNSUPPORTED if handler is None else handler(command, context)


def _arm_disarm(command: Command, context: CommandContext) -> Verdict:
    force = command.parameters[1] == _ARM_FORCE
    if command.parameters[0] == 1.0:
        return context.commander.arm(force=force)
    if command.parameters[0] == 0.0:
        return context.commander.disarm(force=force)
    return Verdict.DENIED


def _set_mode(command: Command, context: CommandContext) -> Verdict:
    base_mode, main, sub = command.parameters[:3]
    if not all(map(math.isfinite, (base_mode, main, sub))):
        return Verdict.DENIED
    if not int(base_mode) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return Verdict.DENIED
    mode = context.flavour.mode_of_command(int(main), int(sub))
    return Verdict.DENIED if mode is None else context.commander.set_mode(mode)


def _take_off(command: Command, context: CommandContext) -> Verdict:
    """Altitude is above mean sea level, or above home; ``nan`` means the parameter's."""
    altitude_m = command.parameters[6]
    if math.isnan(altitude_m):
        return context.commander.take_off(None)
    if not context.flavour.take_off_above_sea:
        return context.commander.take_off(altitude_m)
    ground_m = context.home.altitude_m - context.snapshot.truth.position_ned_m[2]
    return context.commander.take_off(altitude_m - ground_m)


def _land(_: Command, context: CommandContext) -> Verdict:
    return context.commander.set_mode(Mode.LAND)


def _return(_: Command, context: CommandContext) -> Verdict:
    return context.commander.set_mode(Mode.RTL)


def _reposition(command: Command, context: CommandContext) -> Verdict:
    """Go to a global position; ``nan`` keeps a coordinate where it is."""
    speed_mps, _, _, yaw_rad, latitude_deg, longitude_deg, altitude_m = command.parameters
    here_ned_m = context.snapshot.truth.position_ned_m
    if command.frame in RELATIVE_FRAMES:
        altitude_m += context.home.altitude_m - context.commander.home_ned_m[2]
    elif command.frame not in ABSOLUTE_FRAMES:
        return Verdict.DENIED
    position = GeographicPosition(latitude_deg, longitude_deg, altitude_m)
    target = ned_from_geographic(context.home, position)
    north_m, east_m, down_m = (
        here if math.isnan(there) else there for here, there in zip(here_ned_m, target, strict=True)
    )
    if not math.dist((north_m, east_m), here_ned_m[:2]) < _REPOSITION_MAX_M:
        return Verdict.DENIED
    return context.commander.go_to(
        (north_m, east_m, down_m), yaw_rad, speed_mps if speed_mps > 0.0 else None
    )


def _change_speed(command: Command, context: CommandContext) -> Verdict:
    return context.commander.set_speed(command.parameters[1])


def _start_mission(command: Command, context: CommandContext) -> Verdict:
    first = _whole(command.parameters[0])
    return Verdict.DENIED if first < 0 else context.commander.start_mission(first)


def _set_mission_current(command: Command, context: CommandContext) -> Verdict:
    selected = context.commander.mission.select(_whole(command.parameters[0]))
    return Verdict.ACCEPTED if selected else Verdict.DENIED


def _inject_failure(command: Command, context: CommandContext) -> Verdict:
    unit, kind, instance = command.parameters[:3]
    commander = context.commander
    if not commander.settings.failure_injection:
        return Verdict.DENIED
    known = commander.failures.inject(unit, kind, instance, context.snapshot.truth.time_s)
    return Verdict.ACCEPTED if known else Verdict.UNSUPPORTED


def _terminate(command: Command, context: CommandContext) -> Verdict:
    if not command.parameters[0] > 0.5:
        return Verdict.DENIED
    return context.commander.disarm(force=True, reason="flight terminated")


def _set_message_interval(command: Command, context: CommandContext) -> Verdict:
    message_id, interval_us = command.parameters[:2]
    if message_id not in BUILDERS or math.isnan(interval_us):
        return Verdict.DENIED
    now_s = context.snapshot.truth.time_s
    if interval_us == 0.0:
        context.streams.reset_interval(int(message_id), now_s)
    elif interval_us < 0.0:
        context.streams.set_interval(int(message_id), math.inf, now_s)
    else:
        context.streams.set_interval(int(message_id), interval_us * 1e-6, now_s)
    return Verdict.ACCEPTED


def _get_message_interval(command: Command, context: CommandContext) -> Verdict:
    return _send_message_interval(_whole(command.parameters[0]), context)


def _send_message_interval(message_id: int, context: CommandContext) -> Verdict:
    """Send MESSAGE_INTERVAL: -1 for a message that is switched off, 0 for one that is not sent."""
    if not 0 <= message_id <= _MESSAGE_ID_MAX:
        return Verdict.DENIED
    known = message_id in BUILDERS
    interval_s = context.streams.interval_s(message_id)
    streamed_us = round(interval_s * 1e6) if math.isfinite(interval_s) else -1
    interval_us = streamed_us if known else 0
    context.link.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
    return Verdict.ACCEPTED if known else context.flavour.unknown_interval


def _set_standard_mode(command: Command, context: CommandContext) -> Verdict:
    mode = mode_of_standard(command.parameters[0])
    if mode is None or mode not in context.flavour.modes:
        return Verdict.DENIED
    return context.commander.set_mode(mode)


def _send_available_modes(index: int, context: CommandContext) -> Verdict:
    """Send one of the modes, counted from 1, or all of them for 0."""
    modes, flavour = context.flavour.modes, context.flavour
    if not 0 <= index <= len(modes):
        return Verdict.DENIED
    for number, mode in enumerate(modes, 1):
        if index in {0, number}:
            custom_mode = flavour.custom_mode(mode)
            context.link.send(AvailableMode(mode, custom_mode, number, len(modes)))
    return Verdict.ACCEPTED


def _send_component_metadata(_: int, context: CommandContext) -> Verdict:
    content = context.files.content(GENERAL_METADATA)
    if content is None:
        return Verdict.UNSUPPORTED
    context.link.send(ComponentMetadata(context.snapshot.boot_ms, crc32(content), GENERAL_METADATA))
    return Verdict.ACCEPTED


def _send_protocol_version(_: int, context: CommandContext) -> Verdict:
    if not context.flavour.describes_itself:
        return Verdict.UNSUPPORTED
    context.link.send(ProtocolVersion())
    return Verdict.ACCEPTED


# Messages that exist on request only; the second parameter of the request says which one.
_ON_REQUEST: dict[int, Callable[[int, CommandContext], Verdict]] = {
    AVAILABLE_MODES_ID: _send_available_modes,
    COMPONENT_METADATA_ID: _send_component_metadata,
    PROTOCOL_VERSION_ID: _send_protocol_version,
    mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL: _send_message_interval,
}


def _request_message(command: Command, context: CommandContext) -> Verdict:
    message_id = _whole(command.parameters[0])
    if message_id in _ON_REQUEST:
        return _ON_REQUEST[message_id](_whole(command.parameters[1]), context)
    builder = BUILDERS.get(message_id)
    if builder is None:
        return Verdict.UNSUPPORTED
    message = builder(context.snapshot)
    if message is None:
        return Verdict.TEMPORARILY_REJECTED
    context.link.send(message)
    return Verdict.ACCEPTED


def _request_capabilities(_: Command, context: CommandContext) -> Verdict:
    if not context.snapshot.realism.legacy_requests:
        return Verdict.UNSUPPORTED
    context.link.send(BUILDERS[mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION](context.snapshot))
    return Verdict.ACCEPTED


def _request_protocol_version(_: Command, context: CommandContext) -> Verdict:
    if not context.snapshot.realism.legacy_requests:
        return Verdict.UNSUPPORTED
    return _send_protocol_version(0, context)


def _set_home(command: Command, context: CommandContext) -> Verdict:
    """Move home here, or to a global position."""
    here_m = context.snapshot.truth.position_ned_m
    if command.parameters[0] == 1.0:
        context.commander.home_ned_m = here_m
        return Verdict.ACCEPTED
    if command.frame not in ABSOLUTE_FRAMES:
        return Verdict.DENIED
    home_m = ned_from_geographic(context.home, GeographicPosition(*command.parameters[4:]))
    if not math.dist(home_m, here_m) < _REPOSITION_MAX_M:  # nan, too
        return Verdict.DENIED
    context.commander.home_ned_m = home_m
    return Verdict.ACCEPTED


def _check_before_arming(_: Command, context: CommandContext) -> Verdict:
    """Say what keeps the vehicle from arming."""
    commander = context.commander
    if commander.armed:
        return Verdict.TEMPORARILY_REJECTED
    for reason in commander.prearm_failures():
        commander.say(mavlink.MAV_SEVERITY_WARNING, f"Preflight: {reason}")
    return Verdict.ACCEPTED


def _get_home(_: Command, context: CommandContext) -> Verdict:
    if not context.snapshot.realism.legacy_requests:
        return Verdict.UNSUPPORTED
    context.link.send(BUILDERS[mavlink.MAVLINK_MSG_ID_HOME_POSITION](context.snapshot))
    return Verdict.ACCEPTED


def _degrees(scaled: int) -> float:
    """Return a latitude or longitude of a COMMAND_INT; ``nan`` where none is given."""
    return math.nan if scaled == _INT32_MAX else scaled * 1e-7


def _whole(value: float) -> int:
    """Return a whole-numbered float parameter as an integer; -1 if it is not whole."""
    return int(value) if math.isfinite(value) and value.is_integer() else -1


_HANDLERS: dict[int, Callable[[Command, CommandContext], Verdict]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_DO_SET_STANDARD_MODE: _set_standard_mode,
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_NAV_LAND: _land,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_current,
    mavlink.MAV_CMD_INJECT_FAILURE: _inject_failure,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_capabilities,
    mavlink.MAV_CMD_GET_HOME_POSITION: _get_home,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: _request_protocol_version,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _check_before_arming,
}

SUPPORTED: Final = frozenset(_HANDLERS)
