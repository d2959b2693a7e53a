"""The autopilot as its peers see it: MAVLink bytes in, bytes out; no socket, no clock.

Messages for this autopilot are handled; messages for others (a companion's STATUSTEXT for the
ground station, say) are forwarded to the other links, as PX4 does.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.battery import BatteryReading
from sitl.commander import Actuation, Commander
from sitl.commands import Command, CommandContext, execute
from sitl.config import VehicleConfig
from sitl.mavlink_link import MavlinkLink
from sitl.parameters import ParameterStore, SetResult
from sitl.telemetry import BUILDERS, Snapshot, StreamSchedule
from sitl.truth import VehicleTruth

logger = logging.getLogger(__name__)

COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
_STATUSTEXT_LENGTH = 50
_PARAM_ERRORS = {
    SetResult.UNKNOWN: mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST,
    SetResult.OUT_OF_RANGE: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    SetResult.READ_ONLY: mavlink.MAV_PARAM_ERROR_READ_ONLY,
}


class _Peer:
    """One link's codec, its streams, and whether a ground station speaks on it."""

    def __init__(self, system_id: int) -> None:
        self.link = MavlinkLink(system_id, COMPONENT_ID)
        self.streams = StreamSchedule()
        self.has_ground_station = False


class Autopilot:
    """One autopilot on any number of links.

    Attributes:
        commander: modes, arming and failsafes.
        parameters: the values behind the parameter protocol.
    """

    def __init__(
        self,
        config: VehicleConfig,
        truth: VehicleTruth,
        battery: BatteryReading,
        start_unix_s: float = 0.0,
    ) -> None:
        """Start up.

        Raises:
            ParameterError: a configured parameter does not exist or is out of range.
        """
        self.parameters = ParameterStore(config.system_id, config.parameters)
        self.commander = Commander(self.parameters, truth)
        self._system_id = config.system_id
        self._home = config.home
        self._start_unix_s = start_unix_s
        self._peers: dict[int, _Peer] = {}
        self._snapshot = Snapshot(truth, battery, self.commander, config.home, start_unix_s)
        self._handlers: dict[str, Callable[[Any, _Peer, float], None]] = {
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "SET_MODE": self._on_set_mode,
            "HEARTBEAT": self._on_heartbeat,
            "TIMESYNC": self._on_timesync,
            "PING": self._on_ping,
            "PARAM_REQUEST_LIST": self._on_param_request_list,
            "PARAM_REQUEST_READ": self._on_param_request_read,
            "PARAM_SET": self._on_param_set,
        }

    # --- bytes ----------------------------------------------------------------------------

    def open_link(self, link: int) -> None:
        """Start to stream on a link; receiving on it does so too."""
        if link not in self._peers:
            self._peers[link] = _Peer(self._system_id)

    def close_link(self, link: int) -> None:
        """Forget a link and what was queued for it."""
        self._peers.pop(link, None)

    def receive(self, data: bytes, link: int, now_s: float) -> None:
        """Take bytes that arrived on a link; what is no valid message is counted and dropped."""
        self.open_link(link)
        peer = self._peers[link]
        for message in peer.link.parse(data):
            if self._is_from_self(message):
                continue
            if self._concerns_us(message):
                handler = self._handlers.get(message.get_type())
                if handler is not None:
                    handler(message, peer, now_s)
            if self._concerns_others(message):
                self._forward(message, peer)

    def bytes_to_send(self, link: int) -> bytes:
        """Return and clear what is to go out on a link."""
        peer = self._peers.get(link)
        return b"" if peer is None else peer.link.take()

    def bytes_dropped(self, link: int) -> int:
        """How many received bytes were no part of a valid frame."""
        peer = self._peers.get(link)
        return 0 if peer is None else peer.link.bytes_dropped

    # --- time -----------------------------------------------------------------------------

    def step(
        self, truth: VehicleTruth, battery: BatteryReading, thrust_share: float, period_s: float
    ) -> Actuation:
        """Decide what the controller does for the next period, and queue the telemetry that is due.

        Args:
            truth: state at this instant; the estimator is ideal.
            battery: what the pack shows.
            thrust_share: rotor thrust over weight.
            period_s: time until the next call.
        """
        actuation = self.commander.update(truth, battery, thrust_share, period_s)
        self._snapshot = Snapshot(truth, battery, self.commander, self._home, self._start_unix_s)
        self._announce()
        for peer in self._peers.values():
            for message_id in peer.streams.due(truth.time_s):
                message = BUILDERS[message_id](self._snapshot)
                if message is not None:
                    peer.link.send(message)
        return actuation

    def _announce(self) -> None:
        """Tell the operators; as on PX4 only where a ground station's heartbeat was heard."""
        for severity, text in self.commander.announcements:
            logger.info("%s", text)
            encoded = text.encode()[:_STATUSTEXT_LENGTH]
            for peer in self._peers.values():
                if peer.has_ground_station:
                    peer.link.send(mavlink.MAVLink_statustext_message(severity, encoded))
        self.commander.announcements.clear()

    # --- routing --------------------------------------------------------------------------

    def _is_from_self(self, message: Any) -> bool:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return sender == (self._system_id, COMPONENT_ID)

    def _concerns_us(self, message: Any) -> bool:
        return getattr(message, "target_system", 0) in {0, self._system_id} and getattr(
            message, "target_component", 0
        ) in {0, COMPONENT_ID}

    def _concerns_others(self, message: Any) -> bool:
        target_system = getattr(message, "target_system", 0)
        target_component = getattr(message, "target_component", 0)
        return target_system != self._system_id or target_component != COMPONENT_ID

    def _forward(self, message: Any, source: _Peer) -> None:
        for peer in self._peers.values():
            if peer is not source:
                peer.link.forward(message)

    # --- messages -------------------------------------------------------------------------

    def _on_setpoint(self, message: Any, _: _Peer, now_s: float) -> None:
        self.commander.offboard.receive(
            message, now_s, self._snapshot.truth.yaw_rad, self.parameters["COM_OF_LOSS_T"]
        )

    def _on_command(self, message: Any, peer: _Peer, _: float) -> None:
        command = Command.of(message)
        context = CommandContext(
            self.commander, self._home, self._snapshot, peer.link, peer.streams
        )
        result = execute(command, context)
        peer.link.send(
            mavlink.MAVLink_command_ack_message(
                command.number,
                result,
                0,
                0,
                message.get_srcSystem(),
                message.get_srcComponent(),
            )
        )

    def _on_set_mode(self, message: Any, peer: _Peer, _: float) -> None:
        """SET_MODE, the old message: as MAV_CMD_DO_SET_MODE, but nobody is told the result."""
        main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF
        parameters = (float(message.base_mode), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
        context = CommandContext(
            self.commander, self._home, self._snapshot, peer.link, peer.streams
        )
        execute(Command(mavlink.MAV_CMD_DO_SET_MODE, parameters, 0), context)

    def _on_heartbeat(self, message: Any, peer: _Peer, _: float) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            peer.has_ground_station = True

    def _on_timesync(self, message: Any, peer: _Peer, now_s: float) -> None:
        if message.tc1 == 0:
            peer.link.send(mavlink.MAVLink_timesync_message(round(now_s * 1e9), message.ts1))

    def _on_ping(self, message: Any, peer: _Peer, _: float) -> None:
        if message.target_system == 0:
            peer.link.send(
                mavlink.MAVLink_ping_message(
                    message.time_usec,
                    message.seq,
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                )
            )

    def _on_param_request_list(self, _: Any, peer: _Peer, __: float) -> None:
        for name in self.parameters.names():
            self._send_parameter(name, peer)

    def _on_param_request_read(self, message: Any, peer: _Peer, _: float) -> None:
        names = self.parameters.names()
        if message.param_index < 0:
            name = message.param_id
        else:
            name = names[message.param_index] if message.param_index < len(names) else ""
        if name in self.parameters:
            self._send_parameter(name, peer)
        else:
            self._refuse_parameter(message, message.param_index, SetResult.UNKNOWN, peer)

    def _on_param_set(self, message: Any, peer: _Peer, _: float) -> None:
        """PARAM_SET; every link learns the new value, the asking one also of a refusal."""
        value = float(message.param_value)
        if message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        result = self.parameters.set(message.param_id, value)
        if result is SetResult.DONE:
            for other in self._peers.values():
                self._send_parameter(message.param_id, other)
        else:
            self._refuse_parameter(message, -1, result, peer)

    def _send_parameter(self, name: str, peer: _Peer) -> None:
        """PARAM_VALUE; integers travel byte-wise in the float field, as on PX4."""
        value = self.parameters[name]
        parameter_type = mavlink.MAV_PARAM_TYPE_REAL32
        if self.parameters.spec(name).is_integer:
            parameter_type = mavlink.MAV_PARAM_TYPE_INT32
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        names = self.parameters.names()
        peer.link.send(
            mavlink.MAVLink_param_value_message(
                name.encode(), value, parameter_type, len(names), names.index(name)
            )
        )

    def _refuse_parameter(self, message: Any, index: int, result: SetResult, peer: _Peer) -> None:
        peer.link.send(
            mavlink.MAVLink_param_error_message(
                message.get_srcSystem(),
                message.get_srcComponent(),
                message.param_id.encode()[:16],
                index,
                _PARAM_ERRORS[result],
            )
        )
