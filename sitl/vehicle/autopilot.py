"""The autopilot as its peers see it: MAVLink bytes in, bytes out; no socket, no clock.

Messages for this autopilot are handled; messages for others (a companion's STATUSTEXT for the
ground station, say) are forwarded to the other links, as PX4 and ArduPilot do.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.decisions import Actuation, Verdict
from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.protocol.arm_authorization import ArmAuthorization
from sitl.autopilot.protocol.commands import Command, CommandContext, execute
from sitl.autopilot.protocol.files.file_transfer import FileServer
from sitl.autopilot.protocol.files.onboard_files import metadata_files, packed_parameter_file
from sitl.autopilot.protocol.link import MavlinkLink
from sitl.autopilot.protocol.mission_transfer import ItemStore, MissionTransfer
from sitl.autopilot.protocol.parameter_protocol import ParameterProtocol
from sitl.autopilot.protocol.signing import TIMESTAMP_MAX, Signing, signing_key
from sitl.autopilot.protocol.snapshot import Snapshot
from sitl.autopilot.protocol.status_messages import status_texts
from sitl.autopilot.protocol.streams import StreamSchedule, messages_of_data_stream
from sitl.autopilot.protocol.telemetry import BUILDERS
from sitl.autopilot.protocol.timesync import MisaddressedTimesync
from sitl.config import VehicleConfig
from sitl.plant.battery import BatteryReading
from sitl.plant.estimator import Estimator
from sitl.plant.truth import VehicleTruth

logger = logging.getLogger(__name__)

COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
_TEXT_NUMBER_MAX = 0xFFFF
_FENCE, _RALLY = mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY
FLAVOURS: dict[str, type[Flavour]] = {"px4": Px4, "ardupilot": Copter}


class _Peer:
    """One link's codec, its streams, and whether a ground station uses it."""

    def __init__(
        self, system_id: int, rates_hz: Mapping[int, float], signing: Signing | None
    ) -> None:
        self.link = MavlinkLink(system_id, COMPONENT_ID)
        self.link.sign_with(signing)
        self.streams = StreamSchedule(rates_hz)
        self.has_ground_station = False


class Autopilot:
    """One autopilot on any number of links.

    Attributes:
        flavour: which autopilot this is.
        commander: modes, arming and failsafes.
        parameters: the values behind the parameter protocol.
        realism: how it differs from an ideal autopilot.
        estimator: its estimate of its own motion.
        signing: key and memory of every link; None while signing is off.
    """

    def __init__(
        self,
        config: VehicleConfig,
        truth: VehicleTruth,
        battery: BatteryReading,
        start_unix_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        """Start up; ``seed`` seeds the errors of the estimator.

        Raises:
            ParameterError: a configured parameter does not exist or is out of range.
        """
        self.flavour = FLAVOURS[config.flavour]()
        self.realism = self.flavour.field if config.realism == "field" else self.flavour.ideal
        self.parameters = ParameterStore(
            self.flavour.parameter_specs(config.system_id),
            {**self.realism.parameters, **config.parameters},
        )
        self.estimator = Estimator(config.estimator.applied_to(self.realism.estimator), seed)
        self.commander = self.flavour.commander(
            self.flavour.settings(self.parameters), truth, config.home, self.estimator
        )
        places: dict[int, ItemStore] = {_FENCE: self.commander.fence, _RALLY: self.commander.rally}
        partial = self.flavour.partial_missions
        self._missions = MissionTransfer(self.commander.mission, places, partial=partial)
        described = metadata_files if self.flavour.describes_itself else packed_parameter_file
        self._files = FileServer(described(self.parameters))
        self._texts = 0
        self._arm_authorization = ArmAuthorization()
        self._parameter_protocol = ParameterProtocol(
            self.parameters, bytewise=self.flavour.integers_bytewise
        )
        key = signing_key(config)
        self.signing = None if key is None else Signing(key, start_unix_s)
        self._system_id = config.system_id
        self._home = config.home
        self._start_unix_s = start_unix_s
        self._peers: dict[int, _Peer] = {}
        self._estimate, self._battery = truth, battery
        self._handlers = self._handlers_by_message()

    @property
    def handled(self) -> tuple[str, ...]:
        """Names of the messages that the autopilot handles."""
        return tuple(self._handlers)

    def _handlers_by_message(self) -> dict[str, Callable[[Any, _Peer, float], None]]:
        return {
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "SET_POSITION_TARGET_GLOBAL_INT": self._on_setpoint,
            "SET_ATTITUDE_TARGET": self._on_setpoint,
            "MANUAL_CONTROL": self._on_manual_control,
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "COMMAND_ACK": self._on_command_ack,
            "SET_MODE": self._on_set_mode,
            "HEARTBEAT": self._on_heartbeat,
            "TIMESYNC": self._on_timesync,
            "PING": self._on_ping,
            "SETUP_SIGNING": self._on_setup_signing,
            "REQUEST_DATA_STREAM": self._on_request_data_stream,
            "FILE_TRANSFER_PROTOCOL": self._on_file_transfer,
            **dict.fromkeys(self._parameter_protocol.messages, self._on_parameter),
            **dict.fromkeys(self._missions.messages, self._on_mission),
        }

    # --- bytes ----------------------------------------------------------------------------

    def open_link(self, link: int) -> None:
        """Start to stream on a link; receiving on it does so too."""
        if link not in self._peers:
            rates_hz = {**self.flavour.default_rates_hz, **self.realism.rates_hz}
            self._peers[link] = _Peer(self._system_id, rates_hz, self.signing)

    def close_link(self, link: int) -> None:
        """Close a link and drop what was queued for it."""
        self._peers.pop(link, None)

    def receive(self, data: bytes, link: int, now_s: float) -> None:
        """Take bytes that arrived on a link; count and drop bytes outside valid messages."""
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
        """How many received bytes did not belong to a valid frame."""
        peer = self._peers.get(link)
        return 0 if peer is None else peer.link.bytes_dropped

    # --- time -----------------------------------------------------------------------------

    def step(
        self, truth: VehicleTruth, battery: BatteryReading, thrust_share: float, period_s: float
    ) -> Actuation:
        """Decide what the controller flies next, and queue the telemetry that is due.

        Args:
            truth: state at this instant, which the estimator observes.
            battery: reading of the pack.
            thrust_share: rotor thrust over weight.
            period_s: time until the next call.
        """
        failures = self.commander.failures
        estimate = self.estimator.update(
            truth,
            failures.gps_lost_for_s(truth.time_s),
            failures.gps_wrong_m,
        )
        if failures.battery_failed:
            battery = replace(battery, remaining=0.0)
        actuation = self.commander.update(estimate, battery, thrust_share, period_s)
        self._missions.step(truth.time_s)
        self._arm_authorization.step(truth.time_s)
        self._estimate, self._battery = estimate, battery
        self._announce()
        for peer in self._peers.values():
            if due := peer.streams.due(truth.time_s):
                snapshot = self._snapshot()
                for message_id in due:
                    message = BUILDERS[message_id](snapshot)
                    if message is not None:
                        peer.link.send(message)
        return actuation

    def _snapshot(self) -> Snapshot:
        """Return everything that telemetry reports, now."""
        return Snapshot(
            self._estimate,
            self._battery,
            self.commander,
            self._home,
            self.flavour,
            self._start_unix_s,
            self.realism,
            self.estimator,
        )

    def _announce(self) -> None:
        """Send queued texts and mission progress to the operators."""
        for severity, text in self.commander.announcements:
            logger.info("%s", text)
            self._texts = self._texts % _TEXT_NUMBER_MAX + 1
            for message in status_texts(severity, text, self._texts):
                for peer in self._peers.values():
                    if peer.has_ground_station or not self.flavour.texts_need_ground_station:
                        peer.link.send(message)
        self.commander.announcements.clear()
        mission = self.commander.mission
        for number in mission.reached:
            self._broadcast(mavlink.MAVLink_mission_item_reached_message(number))
        mission.reached.clear()
        if mission.announce_current:
            mission.announce_current = False
            self._broadcast(BUILDERS[mavlink.MAVLINK_MSG_ID_MISSION_CURRENT](self._snapshot()))

    def _broadcast(self, message: Any) -> None:
        for peer in self._peers.values():
            peer.link.send(message)

    def send_ranges(self, message: Any) -> None:
        """Send what an obstacle sensor measured on every link."""
        self._broadcast(message)

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
        self.commander.receive_setpoint(message, now_s)

    def _on_manual_control(self, message: Any, _: _Peer, now_s: float) -> None:
        if message.target == self._system_id:
            self.commander.receive_sticks(message, now_s)

    def _on_command(self, message: Any, peer: _Peer, now_s: float) -> None:
        command = Command.of(message)
        sender = message.get_srcSystem(), message.get_srcComponent()

        def acknowledge(result: int) -> None:
            peer.link.send(
                mavlink.MAVLink_command_ack_message(command.number, result, 0, 0, *sender)
            )

        authorizer = self.commander.settings.arm_authorizer
        if authorizer is None or not self._needs_authorization(command, now_s):
            acknowledge(execute(command, self._context(peer)))
            return

        def answer(permitted: bool) -> None:
            if permitted:
                acknowledge(execute(command, self._context(peer)))
                return
            self.commander.say(mavlink.MAV_SEVERITY_CRITICAL, "Arming denied: not authorized")
            acknowledge(Verdict.TEMPORARILY_REJECTED)

        timeout_s = self.commander.settings.arm_authorization_timeout_s
        self._broadcast(self._arm_authorization.ask(authorizer, timeout_s, answer, now_s))

    def _needs_authorization(self, command: Command, now_s: float) -> bool:
        """Return whether the authorizer has to be asked: every other check of arming passes."""
        may_be_asked = not self.commander.armed and not self.commander.prearm_failures()
        return command.arms and may_be_asked and not self._arm_authorization.permits(now_s)

    def _on_command_ack(self, message: Any, _: _Peer, now_s: float) -> None:
        authorizer = self.commander.settings.arm_authorizer
        if authorizer is not None:
            self._arm_authorization.receive(message, authorizer, now_s)

    def _on_set_mode(self, message: Any, _: _Peer, __: float) -> None:
        """SET_MODE, the old message: as MAV_CMD_DO_SET_MODE, but without an acknowledgement."""
        mode = self.flavour.mode_of_custom(message.custom_mode)
        if mode is not None and message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.commander.set_mode(mode)

    def _on_heartbeat(self, message: Any, peer: _Peer, now_s: float) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            peer.has_ground_station = True
            self.commander.hear_ground_station(now_s)

    def _on_timesync(self, message: Any, peer: _Peer, now_s: float) -> None:
        if message.tc1 == 0:
            stamp_ns = round(now_s * 1e9)
            if self.realism.timesync_misaddressed:
                peer.link.send(MisaddressedTimesync(stamp_ns, message.ts1))
            else:
                peer.link.send(mavlink.MAVLink_timesync_message(stamp_ns, message.ts1))

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

    def _on_parameter(self, message: Any, peer: _Peer, _: float) -> None:
        """Answer the asking link; every link learns a new value."""
        answers = self._parameter_protocol.receive(message)
        changed = message.get_type() == "PARAM_SET" and answers[0].get_type() == "PARAM_VALUE"
        for answer in answers:
            if changed:
                self._broadcast(answer)
            else:
                peer.link.send(answer)
        if changed:
            self.commander.settings = self.flavour.settings(self.parameters)

    def _on_mission(self, message: Any, peer: _Peer, now_s: float) -> None:
        self._missions.receive(message, peer.link.send, now_s)

    def _on_request_data_stream(self, message: Any, peer: _Peer, now_s: float) -> None:
        """REQUEST_DATA_STREAM, the old way to ask; only ArduPilot still answers it."""
        if self.flavour.default_rates_hz.keys() - {mavlink.MAVLINK_MSG_ID_HEARTBEAT}:
            return
        rate_hz = message.req_message_rate if message.start_stop else 0
        for message_id in messages_of_data_stream(message.req_stream_id):
            interval_s = 1.0 / rate_hz if rate_hz else float("inf")
            peer.streams.set_interval(message_id, interval_s, now_s)

    def _on_file_transfer(self, message: Any, peer: _Peer, _: float) -> None:
        client = message.get_srcSystem(), message.get_srcComponent()
        for answer in self._files.receive(bytes(message.payload), client):
            peer.link.send(mavlink.MAVLink_file_transfer_protocol_message(0, *client, answer))

    def _on_setup_signing(self, message: Any, _: _Peer, now_s: float) -> None:
        """Take a new key, all zeros for none; where signing is on, only a signed one gets here."""
        key = bytes(message.secret_key)
        signing = Signing(key, self._start_unix_s + now_s) if any(key) else None
        if signing is not None:
            newest = max(signing.outgoing.timestamp, message.initial_timestamp)
            signing.outgoing.timestamp = min(newest, TIMESTAMP_MAX)
        self.signing = signing
        for peer in self._peers.values():
            peer.link.sign_with(signing)

    def _context(self, peer: _Peer) -> CommandContext:
        return CommandContext(
            self.commander,
            self.flavour,
            self._home,
            self._snapshot(),
            peer.link,
            peer.streams,
            self._files,
        )
