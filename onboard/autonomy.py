"""The whole service without I/O: bytes and time in, bytes and events out.

Time, `now_s`, runs from the service's start and is never adjusted; `epoch_unix_s` is the Unix time
at its zero, needed only to read the stamps of detection frames.

Inputs are latched as they come; every decision is made in `Autonomy.tick`.  The daemon calls it
with real bytes and the real clock, the simulation with virtual time: what is tested is what flies.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Final

from onboard.contract.assessment import Assessment, assess
from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.files.contract_file import Contract, InputSet
from onboard.files.daemon_config import VehicleMission
from onboard.files.geofence_file import FenceAreaFile, Geofence
from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.mission_file import Mission
from onboard.files.resume_payload import Command
from onboard.files.sensor_sources import (
    AnySource,
    excludes_real_sensors,
    only_adds_movers,
    shows_virtual_obstacles,
)
from onboard.fleet.membership import FleetMembership
from onboard.geometry.fence import Fence
from onboard.guidance.authority import ControlAuthority
from onboard.guidance.departure import Refusal, refused
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.signing import LinkSigning
from onboard.missions.fences import fence_area
from onboard.missions.fleet_flight import FleetFlight
from onboard.missions.from_vehicle import MissionFromVehicle
from onboard.missions.progress import MissionProgress, mission_sha256
from onboard.monitoring.flight_authorization import FlightAuthorizationGate
from onboard.monitoring.supervisor import MonitorSupervisor
from onboard.perception.intake import DetectionCounters, DetectionIntake
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.detection_source import DetectionSource
from onboard.perception.sources.json_v1 import JsonV1Source
from onboard.perception.sources.sensor_input import PosesByStamp
from onboard.planning.planner import Planner

log = logging.getLogger(__name__)

# Events wait this many deep to be fetched; beyond that the oldest are dropped.
MAX_EVENTS: Final = 10_000
# Takes every reason for not resuming; none if the flight goes on.
AnswerResume = Callable[[list[Refusal]], None]


class Autonomy:
    """The onboard service.

    Args:
        contract: what the vehicle guarantees and assumes.
        mission: where to fly.
        epoch_unix_s: Unix time at ``now_s`` zero.
        system_id: MAVLink id of the vehicle.
        telemetry_timeout_s: telemetry older than this is ignored.
        input_set: which set of accelerations to plan on.
        fly_outside_contract: leave STANDBY although the contract does not comply; the response to
            what then fails is to brake, since there is no contract to solve again.
        preflight_age_max_s: leave STANDBY only with a passed pre-flight check of this contract
            that is no older; None to need none.
        stopwatch: reads a clock in seconds, only to report how long plans took.
        planner: what plans avoidances.
        detection_source: decodes detection messages; JSON, version 1, by default.
        sensors: that the vehicle has besides; the flight relies on each.
        signing: of MAVLink messages; None while it is off.
        instance: a number of this process that no other daemon has; 0 where there is no other.

    Attributes:
        sensors: what has arrived from them.
        malformed_missions: missions that could not be read.
        refused_commands: operator commands that were not authentic.
        fleet: has the vehicle fly by leave of others; None where it is of no fleet.
        vehicle_mission: follows the mission on board; None where a file states it.
        progress: how far the mission was flown.
        log_ended: whether the flight goes on without a log.
        virtual_obstacles: whether a sensor shows obstacles that are not there.
    """

    malformed_missions = refused_commands = 0
    log_ended = False
    fleet: FleetFlight | None = None
    vehicle_mission: MissionFromVehicle | None = None
    _fenced: tuple[FenceAreaFile, ...] = ()
    _pending_mission: bytes | None = None
    _home_ned_m: tuple[float, float] | None = None

    def __init__(
        self,
        contract: Contract,
        mission: Mission,
        *,
        epoch_unix_s: float,
        system_id: int = 1,
        telemetry_timeout_s: float = 0.5,
        input_set: InputSet = "inner",
        fly_outside_contract: bool = False,
        preflight_age_max_s: float | None = None,
        stopwatch: Callable[[], float] = lambda: 0.0,
        planner: Planner | None = None,
        detection_source: DetectionSource | None = None,
        sensors: Sequence[AnySource] = (),
        signing: LinkSigning | None = None,
        instance: int = 0,
    ) -> None:
        self.epoch_unix_s, self._command_limiter = epoch_unix_s, EventLimiter()
        self.link = MavlinkEndpoint(system_id, signing, instance)
        assessment = assess(contract, input_set, mission_altitude_m=mission.altitude_m)
        planner, adaptive = planner or Planner(), not fly_outside_contract
        self.navigator = Navigator(assessment, mission, planner, stopwatch, adaptive=adaptive)
        self.flight_authorization = FlightAuthorizationGate(contract.sha256, preflight_age_max_s)
        self._intake = DetectionIntake(detection_source or JsonV1Source())
        self.supervisor = MonitorSupervisor(
            self.link,
            self.navigator,
            self.emit,
            telemetry_timeout_s=telemetry_timeout_s,
            counters=self._intake.counters,
        )
        self.sensors, self.progress = self._channels(sensors), self._progress(contract)
        self.navigator.see_by(self.supervisor.seen, self.supervisor.detections.movers)
        self.authority = ControlAuthority(
            self.link,
            self.navigator,
            self.supervisor,
            self.flight_authorization,
            self.emit,
            fly_outside_contract=fly_outside_contract,
        )
        self._pending_commands: list[tuple[Command, AnswerResume]] = []
        self._news: list[Event] = []  # of this tick
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)  # not fetched yet

    def _progress(self, contract: Contract) -> MissionProgress:
        link, navigator = self.link, self.navigator
        return MissionProgress(navigator, link, contract.sha256, self._identity, self.emit)

    def _channels(self, sensors: Sequence[AnySource]) -> SensorChannels:
        """Listen to the vehicle's sensors, and rely on each that shows what is free."""
        poses = PosesByStamp(self.supervisor.poses, lambda: self.epoch_unix_s)
        channels = SensorChannels(sensors, poses, self._intake.counters)
        self._intake.names_taken = frozenset(channels.sensors)
        self._intake.virtual_only = excludes_real_sensors(sensors)
        self.virtual_obstacles = shows_virtual_obstacles(sensors)
        relied_on = (each.name for each in sensors if not only_adds_movers(each))
        self.supervisor.detections.monitor.expected = frozenset(relied_on)
        self.link.range_messages = channels.mavlink_ids
        self.link.listen_to_traffic(channels.traffic_ids)
        return channels

    @property
    def assessment(self) -> Assessment:
        """The contract as it is flown now: as declared, or solved again for what was seen."""
        return self.navigator.assessment

    @property
    def detections(self) -> DetectionCounters:
        """What arrived from the sensors and was not used."""
        return self._intake.counters

    def keep_in(self, geofence: Geofence) -> None:
        """Fly within a geofence only; before the first flight."""
        self._fenced = geofence.areas
        self._keep_in_areas(())

    def _keep_in_areas(self, on_board: tuple[FenceAreaFile, ...]) -> None:
        """Fly within the areas of our geofence and of that on board."""
        areas = tuple(map(fence_area, (*self._fenced, *on_board)))
        fence = Fence(areas) if areas else None
        self.navigator.situation.fence = fence
        self.supervisor.seen.keep_in(fence)

    def fly_mission_on_board(self, stated: VehicleMission) -> None:
        """Fly the mission that the autopilot has on board; before the first tick.

        Args:
            stated: what that mission does not state.
        """
        self.vehicle_mission = MissionFromVehicle(
            self.link, self.navigator, stated, self._keep_in_areas, self.emit
        )

    def join_fleet(self, membership: FleetMembership, boot: str) -> None:
        """Fly only by leave of the other vehicles of a fleet; before the first tick.

        Args:
            membership: of the fleet.
            boot: of this run: 16 hexadecimal digits, random, never used before.

        Raises:
            ValueError: the contract does not require that every way ends at rest.
        """
        self.fleet = FleetFlight(membership, boot, self.link, self.navigator, self.supervisor)

    def _identity(self, mission: Mission) -> str:
        on_board = self.vehicle_mission
        return (on_board and on_board.identity(mission)) or mission_sha256(mission)

    def set_epoch(self, epoch_unix_s: float) -> bool:
        """Read stamps by a clock that has been set; refused while the vehicle may fly.

        In flight a step of the clock must not move what is seen in time: stamps then disagree, and
        the monitor of detections names the clock.

        Args:
            epoch_unix_s: Unix time at ``now_s`` zero by the clock as it is now.

        Returns:
            Whether it was taken.
        """
        status = self.link.status
        if status.armed or status.airborne is True or self.navigator.phase is not Phase.STANDBY:
            return False
        self.epoch_unix_s = epoch_unix_s
        self.supervisor.detections.monitor.forget_stamps()
        return True

    # ------------------------------------------------------------------ inputs, latched

    def receive_mavlink(self, data: bytes, now_s: float) -> None:
        """Take bytes from the autopilot's link."""
        before = self.link.pose
        self.link.receive(data, now_s)
        pose = self.link.pose
        if pose is not None and pose is not before:
            self.supervisor.take_pose(pose)
        for message_id, frame in (*self.link.take_ranges(), *self.link.take_traffic()):
            self.sensors.receive_mavlink(message_id, frame, now_s)

    def receive_detection(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take one detection message; the next tick reads it."""
        self._intake.receive(payload)

    def receive_flight_authorization(
        self,
        payload: bytes,
        now_s: float,  # noqa: ARG002  latched
    ) -> None:
        """Take the outcome of a pre-flight check; it counts when control is granted."""
        self.flight_authorization.receive(payload)

    def receive_mission(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take a mission to be flown instead of the present one; the next tick reads it."""
        self._pending_mission = payload

    def receive_fleet(self, key: str, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take a message of the fleet, with the Zenoh key that it came under."""
        if self.fleet is not None:
            self.fleet.member.receive(key, payload)

    def receive_resume(self, answer: AnswerResume, command: Command = "resume") -> None:
        """Take the operator's command to end a hold, or to return; the next tick answers it."""
        self._pending_commands.append((command, answer))

    def emit(self, event: Event) -> None:
        """Take an event to be logged and sent; the daemon's own are welcome too."""
        self._news.append(event)

    def report_log_end(self, reason: str, now_s: float) -> None:
        """Say, once, that the flight goes on without a log."""
        if not self.log_ended:
            self.log_ended = True
            text = f"flying on without a log: {reason}"
            self.emit(Event(now_s, EventName.LOG_ENDED, Severity.WARNING, text))

    def report_refused_command(self, kind: str, reason: str, now_s: float) -> None:
        """Say that an operator command was not authentic; one of a kind in five seconds."""
        self.refused_commands += 1
        if self._command_limiter.allows(kind, now_s):
            text = f"operator command refused: {kind}: {reason}"
            self.emit(Event(now_s, EventName.COMMAND_REFUSED, Severity.WARNING, text))

    # ------------------------------------------------------------------ outputs

    def mavlink_to_send(self) -> bytes:
        """Return and forget the bytes for the autopilot's link."""
        return self.link.bytes_to_send()

    def fleet_to_send(self) -> list[tuple[str, bytes]]:
        """Return and forget what is to be published for the fleet: Zenoh keys and payloads."""
        return [] if self.fleet is None else self.fleet.member.take_to_send()

    def events(self) -> list[Event]:
        """Return and forget what happened since the last call, in order."""
        happened = list(self._events)
        self._events.clear()
        return happened

    # ------------------------------------------------------------------ the tick

    def tick(self, now_s: float) -> None:
        """Decide what is flown until the next tick, and queue its setpoint."""
        if self.link.security.signing is not None:
            self.link.security.signing.follow_clock(self.epoch_unix_s + now_s)
        self._news += self.link.security.take_news()
        self.link.keep_alive(now_s, active=self.navigator.phase is not Phase.STANDBY)
        self.supervisor.check_loop(now_s)
        try:
            self._decide(now_s)
        except Exception:
            # A defect of ours must not end the stream while a hover is possible.
            log.exception("deciding failed")
            self.supervisor.report_defect(now_s)
        setpoint = self.authority.setpoint(now_s)
        if setpoint is not None:
            self.link.send_setpoint(setpoint, now_s)
            self.supervisor.response.sent.add(setpoint, now_s)
        self._collect_events()

    def _decide(self, now_s: float) -> None:
        """Process resets, frames, missions, the pilot's mode and the monitors; then advance."""
        now_unix_s = self.epoch_unix_s + now_s
        was_reset, pose = self.supervisor.respond_to_resets(now_s), self.link.pose
        if was_reset and pose is not None:
            self.authority.follow_reset(pose)
        self._measure_virtual(now_s)
        frames = chain(self._intake.take(now_unix_s), self.sensors.take(self.epoch_unix_s))
        self.supervisor.take_frames(frames, now_s, self.epoch_unix_s)
        for name, reason in (*self.sensors.take_news(), *self._intake.take_news()):
            text = f"sensor {name}: messages dropped: {reason}"
            self.emit(Event(now_s, EventName.SENSOR_REFUSED, Severity.WARNING, text))
        self._take_mission(now_s)
        self.supervisor.check_position(now_s)
        if pose is not None:
            waited = self.navigator.phase is Phase.STANDBY
            self.authority.follow_mode(pose, now_s, now_unix_s)
            if self.virtual_obstacles and waited and self.navigator.phase is not Phase.STANDBY:
                text = "VIRTUAL OBSTACLES: real ones are not seen"
                self.emit(Event(now_s, EventName.VIRTUAL_OBSTACLES, Severity.WARNING, text))
            self.supervisor.check(pose, now_s)
        self._take_commands(now_s, now_unix_s)
        if self.fleet is not None:
            self.fleet.advance(pose, now_s)
        self.authority.keep_energy(pose, now_s, now_unix_s)
        if pose is not None:
            self.navigator.advance(pose, now_s)
        self.progress.note(pose, now_s, now_unix_s)

    def _measure_virtual(self, now_s: float) -> None:
        """Have virtual obstacles be seen, around where the vehicle was armed."""
        if not self.virtual_obstacles:
            return
        status, pose = self.link.status, self.link.pose
        # As both autopilots do, the home moves along while the vehicle is disarmed.
        if pose is not None and math.isfinite(status.heard_s) and not status.armed:
            self._home_ned_m = pose.position_ned_m[:2]
        self.sensors.measure_virtual(now_s, self._home_ned_m)

    def _take_mission(self, now_s: float) -> None:
        if self.vehicle_mission is not None:
            self.vehicle_mission.follow(now_s)
        payload, self._pending_mission = self._pending_mission, None
        if payload is None:
            return
        try:
            mission = parse(payload, Mission)
        except MalformedPayloadError as error:
            self.malformed_missions += 1
            log.debug("dropped a malformed mission: %s", error)
        else:
            self.navigator.change_mission(mission, now_s)

    def _take_commands(self, now_s: float, now_unix_s: float) -> None:
        commands, self._pending_commands = self._pending_commands, []
        for command, answer in commands:
            if command == "resume" and self.navigator.phase is Phase.STANDBY:
                answer(self._resume_left_flight(now_s))
                continue
            obey = self.authority.fly_back if command == "return" else self.authority.resume
            answer(obey(self.link.pose, now_s, now_unix_s))

    def _resume_left_flight(self, now_s: float) -> list[Refusal]:
        refusals = self.progress.resume(self.link.pose, now_s)
        if refusals:
            self.emit(refused("not resuming", refusals, now_s))
        return refusals

    def _collect_events(self) -> None:
        self._news += self.navigator.events
        self.navigator.events.clear()
        for event in self._news:
            if event.severity <= Severity.WARNING or event.name == EventName.PHASE:
                self.link.send_text(event.severity, f"Clearway: {event.text}")
        self._events.extend(self._news)
        self._news.clear()
