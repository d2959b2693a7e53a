"""The whole service without I/O: bytes and time in, bytes and events out.

Time, `now_s`, runs from the service's start and is never adjusted; `epoch_unix_s` is the Unix time
at its zero, needed only to read the stamps of detection frames.

Inputs are latched as they come; every decision is made in `Autonomy.tick`.  The daemon calls it
with real bytes and the real clock, the simulation with virtual time: what is tested is what flies.
"""

from __future__ import annotations

import bisect
import logging
import math
from collections import deque
from collections.abc import Callable
from typing import Final

from onboard.contract.assessment import Assessment, assess
from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.models import Contract, InputSet, Mission
from onboard.guidance.departure import Refusal, RefusalKind, RefusalReport
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.assumptions import Assumption, Violation, check_obstacle
from onboard.monitoring.detections import DetectionMonitor
from onboard.monitoring.estimator.heading import HeadingMonitor
from onboard.monitoring.estimator.position_quality import (
    DEAD_RECKONING_S,
    PositionQualityMonitor,
    Sign,
)
from onboard.monitoring.estimator.resets import EstimatorReset, PoseMonitor, ResetLedger
from onboard.monitoring.flight_authorization import ClearanceGate
from onboard.monitoring.loop_overrun import LoopOverrunMonitor
from onboard.monitoring.response.second_commander import PX4_GAIN_MAX_PER_S, SecondCommanderMonitor
from onboard.monitoring.response.tilt import TiltResponseMonitor
from onboard.monitoring.response.tracking import TrackingMonitor
from onboard.monitoring.response.trim import TrimEstimator
from onboard.monitoring.response.wind import WindMonitor
from onboard.perception.intake import DetectionCounters, DetectionIntake
from onboard.perception.obstacle_map import Obstacle
from onboard.perception.pose_history import PoseHistory
from onboard.planning.planner import Planner
from onboard.vehicle_state import Pose, Setpoint

log = logging.getLogger(__name__)

AUTOPILOT_SILENCE_S: Final = 3.0
# Events that nobody fetches are kept this long, the latest of them.
MAX_EVENTS: Final = 10_000
# Somebody else's setpoint this recent means that two are flying.
RIVAL_MEMORY_S: Final = 0.5
# Setpoints are remembered this long: the autopilot's echo of them lags by up to half a second.
SENT_MEMORY_S: Final = 0.6
# Holding without knowing where for longer than this is left to the autopilot.
HANDOVER_AFTER_S: Final = 2.0
# And is taken back once the position has been there for so long: it may flicker.
TAKE_BACK_AFTER_S: Final = 1.0
# A reference slower than this has come to rest, but for round-off.
STOPPED_MPS: Final = 0.01


class Autonomy:
    """The onboard service.

    Args:
        contract: what the vehicle guarantees and assumes.
        mission: where to fly.
        epoch_unix_s: Unix time at ``now_s`` zero.
        system_id: MAVLink id of the vehicle.
        stale_after_s: older telemetry is no telemetry.
        input_set: which set of accelerations to plan on.
        fly_outside_contract: leave STANDBY although the contract does not comply; what then
            fails is answered by braking, since there is no contract to solve again.
        preflight_age_max_s: leave STANDBY only with a passed pre-flight check of this contract
            that is no older; None to need none.
        stopwatch: reads a clock in seconds, only to report how long plans took.
        planner: what plans avoidances.
    """

    def __init__(
        self,
        contract: Contract,
        mission: Mission,
        *,
        epoch_unix_s: float,
        system_id: int = 1,
        stale_after_s: float = 0.5,
        input_set: InputSet = "inner",
        fly_outside_contract: bool = False,
        preflight_age_max_s: float | None = None,
        stopwatch: Callable[[], float] = lambda: 0.0,
        planner: Planner | None = None,
    ) -> None:
        self.epoch_unix_s = epoch_unix_s
        assessment = assess(contract, input_set, mission_altitude_m=mission.altitude_m)
        self.link = MavlinkEndpoint(system_id)
        self.navigator = Navigator(
            assessment,
            mission,
            planner or Planner(),
            stopwatch,
            adaptive=not fly_outside_contract,
        )
        self.clearance = ClearanceGate(contract.sha256, preflight_age_max_s)
        self._fly_outside_contract = fly_outside_contract
        self._quality_monitor = PositionQualityMonitor(self.link.position_reports)
        self._doubt: Sign | None = None
        self._pose_monitor, self._resets = PoseMonitor(stale_after_s), ResetLedger()
        self._loop_monitor = LoopOverrunMonitor()
        self._trim = TrimEstimator()
        self._tilt_monitor = TiltResponseMonitor(self._trim)
        self._wind_monitor = WindMonitor(self._trim)
        self._tracking_monitor, self._heading_monitor = TrackingMonitor(), HeadingMonitor()
        self._second_commander_monitor = SecondCommanderMonitor()
        self._wind: Violation | None = None
        self._poses = PoseHistory()
        self._intake = DetectionIntake(self.navigator, self._poses, self._resets.placements_m)
        self._pending_mission: bytes | None = None
        self._malformed_missions = 0
        self._log_ended = False
        # What happened in this tick, and all that nobody has asked for yet.
        self._news: list[Event] = []
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._reported: set[tuple[Assumption, str]] = set()
        self._hold: Setpoint | None = None
        self._refusals, self._limiter = RefusalReport(), EventLimiter()
        self._watched_pose: Pose | None = None
        self._sent: deque[tuple[float, Setpoint]] = deque()
        self._left, self._blind_s = False, -math.inf
        self._held = False

    @property
    def assessment(self) -> Assessment:
        """The contract as it is flown now: as declared, or solved again for what was seen."""
        return self.navigator.assessment

    @property
    def detections(self) -> DetectionCounters:
        """What arrived from the sensors and was not used."""
        return self._intake.counters

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
        self._intake.monitor.forget_stamps()
        return True

    # ------------------------------------------------------------------ inputs, latched

    def receive_mavlink(self, data: bytes, now_s: float) -> None:
        """Take bytes from the autopilot's link."""
        before = self.link.pose
        self.link.receive(data, now_s)
        pose = self.link.pose
        if pose is None or pose is before:
            return
        reset = self._pose_monitor.check_jump(pose)
        if reset is not None:
            self._resets.add(reset)
            if reset.measured:
                self._poses.shift(reset.shift_ned_m)
        self._poses.add(pose)

    def receive_detection(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take one detection frame; it is read in the next tick."""
        self._intake.receive(payload)

    def receive_clearance(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take the outcome of a pre-flight check; it is asked for when control is granted."""
        self.clearance.receive(payload)

    def receive_mission(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take a mission to be flown instead of the present one; it is read in the next tick."""
        self._pending_mission = payload

    def emit(self, event: Event) -> None:
        """Take an event of the daemon's own, to be logged and sent like those of the service."""
        self._news.append(event)

    def report_log_end(self, reason: str, now_s: float) -> None:
        """Say, once, that the flight goes on without a log."""
        if not self._log_ended:
            self._log_ended = True
            text = f"flying on without a log: {reason}"
            self._news.append(Event(now_s, EventName.LOG_ENDED, Severity.WARNING, text))

    # ------------------------------------------------------------------ outputs

    def mavlink_to_send(self) -> bytes:
        """Return and forget the bytes for the autopilot's link."""
        return self.link.bytes_to_send()

    def events(self) -> list[Event]:
        """Return and forget what happened since the last call, in order."""
        happened = list(self._events)
        self._events.clear()
        return happened

    # ------------------------------------------------------------------ the tick

    def tick(self, now_s: float) -> None:
        """Decide what is flown until the next tick, and queue its setpoint."""
        self.link.keep_alive(now_s, active=self.navigator.phase is not Phase.STANDBY)
        overrun = self._loop_monitor.check(now_s)
        if overrun is not None:
            self._broken(overrun, now_s)
        try:
            self._decide(now_s)
        except Exception:
            # A defect of ours must not end the stream while a hover is possible.
            log.exception("deciding failed")
            self._broken(Violation(Assumption.SELF_CHECK, 1.0, 0.0, "exceptions"), now_s)
        self._stream(now_s)
        self._collect_events()

    def _decide(self, now_s: float) -> None:
        for reset in self._resets.take_unanswered():
            self._answer_reset(reset, now_s)
        for violation in self._intake.take(now_s, self.epoch_unix_s, self._heading_monitor):
            self._broken(violation, now_s)
        self._take_mission(now_s)
        pose = self.link.pose
        self._doubt = self._quality_monitor.check(now_s)
        if pose is not None:
            self._follow_mode(pose, now_s)
            self._watch(pose, now_s)
            self.navigator.advance(pose, now_s)

    def _take_mission(self, now_s: float) -> None:
        payload, self._pending_mission = self._pending_mission, None
        if payload is None:
            return
        try:
            mission = parse(payload, Mission)
        except MalformedPayloadError as error:
            self._malformed_missions += 1
            log.debug("dropped a malformed mission: %s", error)
        else:
            self.navigator.change_mission(mission, now_s)

    def _follow_mode(self, pose: Pose, now_s: float) -> None:
        """Fly only while the pilot lets us: the mode is theirs."""
        status, navigator = self.link.status, self.navigator
        heard = now_s - status.heard_s <= AUTOPILOT_SILENCE_S
        granted = status.armed and status.external_control and status.airborne is True and heard
        if not granted:
            # Only the pilot ends a hold, or a flight on a bad position: neither a silent autopilot
            # has handed anything back, nor one whose failsafe acts.
            stays = navigator.phase is Phase.HOLD or (navigator.flying and self._doubt is not None)
            self._held = (self._held or stays) and (not heard or status.failsafe)
            if navigator.phase is not Phase.STANDBY:
                if heard and status.failsafe:
                    text = f"the autopilot's failsafe has taken over ({status.mode})"
                    self._news.append(Event(now_s, EventName.FAILSAFE, Severity.WARNING, text))
                navigator.release_control(now_s)
            if status.airborne is not True:
                self._quality_monitor.forget_flight()
            self._hold = _hold_at(pose)
            self._refusals.end()
        elif navigator.phase is Phase.STANDBY:
            # A daemon that restarts in flight finds itself in control: it holds where it is.
            self._hold = self._hold or _hold_at(pose)
            self._depart(pose, now_s)

    def _depart(self, pose: Pose, now_s: float) -> None:
        refusals = self._departure_refusals(pose, now_s)
        if not refusals:
            self._reported.clear()
            self._resets.begin_flight()
            self._quality_monitor.depart(now_s)
            self._doubt = None
            self._tracking_monitor, self._heading_monitor = TrackingMonitor(), HeadingMonitor()
            self._second_commander_monitor = SecondCommanderMonitor()
            # The estimator may have aligned its heading since: in the climb, magnetometers recover.
            self._intake.bearings.forget()
            self._refusals.end()
            self.navigator.take_control(pose, now_s)
        elif (said := self._refusals.news(refusals, now_s)) is not None:
            self._news.append(said)

    def _departure_refusals(self, pose: Pose, now_s: float) -> list[Refusal]:
        found = []
        if self._held:
            text = "holding: the pilot has to take over first"
            found.append(Refusal(RefusalKind.HOLDING, text))
        if not (self.assessment.compliant or self._fly_outside_contract):
            broken = [clause.name for clause in self.assessment.clauses if not clause.holds]
            text = f"the contract does not comply ({', '.join(broken)})"
            found.append(Refusal(RefusalKind.CONTRACT, text))
        uncleared = self.clearance.refusal(self.epoch_unix_s + now_s)
        if uncleared is not None:
            found.append(Refusal(RefusalKind.PREFLIGHT, uncleared))
        found += self._detection_refusals(now_s)
        if self._pose_monitor.check_age(pose, now_s) is not None:
            found.append(Refusal(RefusalKind.TELEMETRY, "no fresh telemetry"))
        found += [
            Refusal(RefusalKind.POSITION, text)
            for text in self._quality_monitor.departure_failures(now_s)
        ]
        if self._wind is not None:
            text = f"more wind than {self.assessment.terms.wind_max_mps:g} m/s"
            found.append(Refusal(RefusalKind.WIND, text))
        found += self.navigator.departure_refusals(pose)
        if not self._fly_outside_contract:
            found += [
                Refusal(RefusalKind.ENVIRONMENT, str(violation), violation.key)
                for violation in self._environment_violations(now_s)
            ]
        return found

    def _detection_refusals(self, now_s: float) -> list[Refusal]:
        found = []
        blind = self._intake.monitor.check(now_s, self.assessment.terms)
        if blind is not None:
            text = f"no fresh detection frames: {blind.note}"
            found.append(Refusal(RefusalKind.DETECTIONS, text, blind.key))
        found += [
            Refusal(RefusalKind.CONTRADICTION, f"sightings of {track} contradict each other", track)
            for track in self._intake.consistency.contradicted(now_s)
        ]
        return found

    def _watch(self, pose: Pose, now_s: float) -> None:
        """Hold every assumption against what is seen."""
        moved = pose is not self._watched_pose
        self._watched_pose = pose
        tilt = self._check_tilt(pose) if moved else None
        doubted = None if self._doubt is None else self._doubt.violation()
        self._wind = self._wind_monitor.check(now_s, self.assessment.terms)
        if not self.navigator.flying:
            if doubted is not None and self.navigator.phase is not Phase.STANDBY:
                self._report(doubted, now_s)
            if moved and self.navigator.phase is not Phase.STANDBY:
                self._watch_hover(pose, tilt, now_s)
            return
        terms = self.assessment.terms
        heading = self._heading_violations(pose, now_s) if moved else []
        for violation in (
            doubted,
            self._intake.monitor.check(now_s, terms),
            self._pose_monitor.check_age(pose, now_s),
            self._rival(pose, now_s),
            self._wind,
            *heading,
            *self._environment_violations(now_s),
        ):
            if violation is not None:
                self._broken(violation, now_s)
        if moved:
            self._watch_tracking(pose, tilt, now_s)

    def _answer_reset(self, reset: EstimatorReset, now_s: float) -> None:
        """Move what is remembered with the estimate, then fly on if the contract declares it.

        After a silence the vector is unknown: the vehicle stops, or hovers, where it is said to be.
        """
        navigator, pose = self.navigator, self.link.pose
        assert pose is not None  # noqa: S101  a reset is seen on one
        self._intake.bearings.forget()
        if reset.measured:
            navigator.shift(reset.shift_ned_m)
        if not navigator.flying:
            self._hold = _hold_at(pose)
            if not reset.measured:
                navigator.hover_at(pose, now_s)
            if navigator.phase is not Phase.STANDBY:
                self._report(reset.violation(), now_s)
            return
        ended = self._resets.count(reset, self.assessment.terms.estimator_reset_max_m)
        if ended is not None:
            self._broken(ended, now_s, measured=None if reset.measured else pose)
            return
        self._news.append(self._resets.event(reset, len(navigator.obstacles), now_s))
        navigator.fly_on_after_shift(reset.violation(), now_s)

    def _heading_violations(self, pose: Pose, now_s: float) -> list[Violation | None]:
        """Check the heading: by its command where that is steady, magnetometer and gyros."""
        monitor = self._heading_monitor
        drift = monitor.check_drift(self.link.heading_drift, now_s, self.assessment.terms)
        compass = monitor.check_compass(self.link.compass_ratio, now_s)
        leg_heading_rad = self.navigator.leg.heading_rad
        pointed_at_rad = leg_heading_rad if self.navigator.moving else None
        return [compass, drift, monitor.check_pointing(pose, pointed_at_rad)]

    def _check_tilt(self, pose: Pose) -> Violation | None:
        """Learn the trim, and check the tilt against what was asked for one attitude lag ago.

        Asked for means sent: the reference of before may have been replaced since.  While the pilot
        flies that is a hover, so the trim is learnt before the vehicle departs.
        """
        if self.link.status.airborne is not True:
            self._trim.forget()
            return None
        terms = self.assessment.terms
        since = bisect.bisect_left(self._sent, (pose.time_s - terms.attitude_lag_s,))
        still = since == len(self._sent)
        asked_ned_mps2 = (0.0, 0.0, 0.0) if still else self._sent[since][1].acceleration_ned_mps2
        return self._tilt_monitor.check(pose, asked_ned_mps2[:2], terms)

    def _watch_tracking(self, pose: Pose, tilt: Violation | None, now_s: float) -> None:
        """Answer for tracking, as far as the autopilot follows us.

        If it does not, the next heartbeat tells whom it follows: the pilot, and we are out, or a
        second commander.  Until then what is seen is only said.
        """
        for violation in (*self._tracking_violations(pose), *((tilt,) if tilt else ())):
            if self._second_commander_monitor.suspects(now_s):
                self._report_suspicion(violation, now_s)
            else:
                self._broken(violation, now_s)

    def _watch_hover(self, pose: Pose, tilt: Violation | None, now_s: float) -> None:
        """Report a second commander of what hovers; nothing more can be done about it."""
        rival = self._rival(pose, now_s)
        if rival is not None:
            self._report(rival, now_s)
        self._watch_tracking(pose, tilt, now_s)

    def _report_suspicion(self, violation: Violation, now_s: float) -> None:
        """Report, once in a flight, that the vehicle deviates and not by our set-points."""
        key = (Assumption.SECOND_COMMANDER, "suspected")
        if key not in self._reported:
            self._reported.add(key)
            text = f"vehicle deviates from set-point ({violation}): pilot or second commander?"
            self._news.append(Event(now_s, EventName.SUSPICION, Severity.WARNING, text))

    def _rival(self, pose: Pose, now_s: float) -> Violation | None:
        link = self.link
        if now_s - link.rival_heard_s <= RIVAL_MEMORY_S:
            return Violation(Assumption.SECOND_COMMANDER, 2.0, 1.0, "commanders", link.rival)
        newest_first = reversed(self._sent)
        ours = ((sent.position_ned_m, sent.velocity_ned_mps) for _, sent in newest_first)
        gain_per_s = 0.0 if link.status.ardupilot else PX4_GAIN_MAX_PER_S
        return self._second_commander_monitor.check(
            link.target_heard_s, link.target, ours, pose, gain_max_per_s=gain_per_s
        )

    def _environment_violations(self, now_s: float) -> list[Violation]:
        """Check the obstacles that the flight is about to meet; others may be as they like."""
        obstacles = self.navigator.obstacles
        found: list[Violation] = []
        for obstacle in self.navigator.obstacles_to_meet(now_s):
            conflict = next(obstacles.conflicts(obstacle), None)
            found += check_obstacle(obstacle, conflict, self.assessment.terms)
            if len(obstacle.members) > 1:
                self._report_merger(obstacle, now_s)
        return found

    def _report_merger(self, obstacle: Obstacle, now_s: float) -> None:
        """Say that regions intersect; avoiding the obstacles as one has answered it already."""
        key = (Assumption.ROI_INTERSECTION, obstacle.id)
        if not self.navigator.flying or key in self._reported:
            return
        if self._limiter.allows("merged", now_s):
            self._reported.add(key)
            limit_m = self.assessment.terms.obstacle_separation_min_m
            broken = Violation(key[0], 0.0, limit_m, "m", obstacle.id)
            self._news += [
                broken.event(now_s),
                Event(now_s, EventName.MERGED, Severity.WARNING, f"avoiding {obstacle.id} as one"),
            ]

    def _tracking_violations(self, pose: Pose) -> list[Violation]:
        reference = self.navigator.reference(pose.time_s)
        if reference is None:
            return []
        leg = self.navigator.leg
        x_m, y_m, z_m = leg.position_leg(pose.position_ned_m)
        vx_mps, vy_mps, _ = leg.vector_leg(pose.velocity_ned_mps)
        reference_x_m, reference_y_m, reference_z_m = reference.position_leg_m
        return self._tracking_monitor.check(
            (x_m - reference_x_m, y_m - reference_y_m, z_m - reference_z_m),
            (vx_mps, vy_mps),
            (reference.velocity_leg_mps[0], reference.velocity_leg_mps[1]),
            self.assessment.terms,
            cruising=self.navigator.cruising_freely,
        )

    def _broken(self, violation: Violation, now_s: float, measured: Pose | None = None) -> None:
        """Report a violation once per flight, and answer it if we are the ones flying."""
        if self.navigator.flying:
            self._report(violation, now_s)
            self.navigator.answer(violation, now_s, measured)

    def _report(self, violation: Violation, now_s: float) -> None:
        key = (violation.assumption, violation.subject)
        if key not in self._reported:
            self._reported.add(key)
            self._news.append(violation.event(now_s))

    def _stream(self, now_s: float) -> None:
        """Send this tick's setpoint; on the ground none, or ArduPilot would not take off."""
        if self.link.status.airborne is not True or self._left_to_the_autopilot(now_s):
            return
        setpoint = self.navigator.setpoint(now_s) or self._hold
        if setpoint is not None:
            self.link.send_setpoint(setpoint, now_s)
            self._sent.append((now_s, setpoint))
            while self._sent[0][0] < now_s - SENT_MEMORY_S:
                self._sent.popleft()

    def _left_to_the_autopilot(self, now_s: float) -> bool:
        """Tell whether we hover without a position: then the autopilot's failsafe does better."""
        reason = None if self.navigator.flying else self._blindness(now_s)
        if reason is not None:
            self._blind_s = now_s
        lately = now_s - self._blind_s < TAKE_BACK_AFTER_S
        left, self._left = self._left, lately and not self.navigator.flying
        if reason and self._left and not left and self.navigator.phase is not Phase.STANDBY:
            text = f"{reason}: leaving the vehicle to the autopilot"
            self._news.append(Event(now_s, EventName.HANDED_OVER, Severity.CRITICAL, text))
        if left and not self._left and self.link.pose is not None:
            # Where the autopilot has taken the vehicle meanwhile, rather than back in one step.
            self._hold = _hold_at(self.link.pose)
            self.navigator.hover_at(self.link.pose, now_s)
        return self._left

    def _blindness(self, now_s: float) -> str | None:
        """Return why the position is gone, or None.

        Dead reckoning is good for a stop; once that is over, or has had its time, it is not.
        """
        pose, sign = self.link.pose, self._doubt
        if pose is None or now_s - pose.time_s > HANDOVER_AFTER_S:
            return "no position"
        if sign is None:
            return None
        setpoint = self.navigator.setpoint(now_s)
        speed_mps = 0.0 if setpoint is None else math.hypot(*setpoint.velocity_ned_mps)
        allowed_s = DEAD_RECKONING_S * (2.0 if speed_mps > STOPPED_MPS else 1.0)
        return sign.sentence if self._quality_monitor.lost_for_s(sign, now_s) > allowed_s else None

    def _collect_events(self) -> None:
        self._news += self.navigator.events
        self.navigator.events.clear()
        for event in self._news:
            if event.severity <= Severity.WARNING or event.name == EventName.PHASE:
                self.link.send_text(event.severity, f"Clearway: {event.text}")
        self._events.extend(self._news)
        self._news.clear()

    # ------------------------------------------------------------------ for the record

    @property
    def tracking_monitor(self) -> TrackingMonitor:
        """How far the vehicle is from its reference."""
        return self._tracking_monitor

    @property
    def detection_monitor(self) -> DetectionMonitor:
        """When each sensor was heard."""
        return self._intake.monitor

    @property
    def position_doubt(self) -> Sign | None:
        """Why the position is not trusted; None while it is."""
        return self._doubt

    @property
    def malformed_missions(self) -> int:
        """How many missions were dropped because they could not be read."""
        return self._malformed_missions

    @property
    def log_ended(self) -> bool:
        """Whether the flight goes on without a log."""
        return self._log_ended


def _hold_at(pose: Pose) -> Setpoint:
    still = (0.0, 0.0, 0.0)
    return Setpoint(pose.position_ned_m, still, still, pose.yaw_rad)
