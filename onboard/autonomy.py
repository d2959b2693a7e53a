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
from typing import Any, Final

from onboard.agility import InputSet
from onboard.clearance import ClearanceGate
from onboard.config import Contract, Mission
from onboard.contract import Assessment, assess
from onboard.departure import Refusal, RefusalKind, RefusalReport
from onboard.detection_intake import DetectionCounters, DetectionIntake
from onboard.event_limiter import EventLimiter
from onboard.events import Event, Severity
from onboard.guidance import Phase
from onboard.mavlink import MavlinkEndpoint, Pose, Setpoint
from onboard.monitor import Assumption, Violation, check_obstacle
from onboard.navigator import Navigator
from onboard.obstacles import Obstacle
from onboard.payload import MalformedPayloadError, parse
from onboard.planner import Planner
from onboard.pose_history import PoseHistory
from onboard.watches import (
    PositionWatch,
    RivalWatch,
    TickWatch,
    TiltWatch,
    TrackingWatch,
)

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
        assessment = assess(contract, input_set)
        self.link = MavlinkEndpoint(system_id)
        self.navigator = Navigator(
            assessment,
            mission,
            planner or Planner(),
            stopwatch,
            adaptive=not fly_outside_contract,
        )
        self.clearance = ClearanceGate(contract.sha256, preflight_age_max_s)
        self._complies = assessment.compliant or fly_outside_contract
        self._fly_outside_contract = fly_outside_contract
        self._position_watch = PositionWatch(stale_after_s)
        self._tracking_watch, self._tilt_watch = TrackingWatch(), TiltWatch()
        self._tick_watch, self._rival_watch = TickWatch(), RivalWatch()
        self._poses = PoseHistory()
        self._intake = DetectionIntake(self.navigator, self._poses)
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
        self._left = False
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
        if self.link.pose is not None and self.link.pose is not before:
            self._poses.add(self.link.pose)

    def receive_detection(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take one detection frame; it is read in the next tick."""
        self._intake.receive(payload)

    def receive_clearance(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take the outcome of a pre-flight check; it is asked for when control is granted."""
        self.clearance.receive(payload)

    def receive_mission(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take a mission to be flown instead of the present one; it is read in the next tick."""
        self._pending_mission = payload

    def report_log_end(self, reason: str, now_s: float) -> None:
        """Say, once, that the flight goes on without a log."""
        if not self._log_ended:
            self._log_ended = True
            text = f"flying on without a log: {reason}"
            self._news.append(Event(now_s, "log_ended", Severity.WARNING, text))

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
        overrun = self._tick_watch.check(now_s)
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
        for violation in self._intake.take(now_s, self.epoch_unix_s):
            self._broken(violation, now_s)
        self._take_mission(now_s)
        pose = self.link.pose
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
            # Only the pilot ends a hold: a silent autopilot has not handed anything back.
            self._held = (self._held or navigator.phase is Phase.HOLD) and not heard
            if navigator.phase is not Phase.STANDBY:
                navigator.release_control(now_s)
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
            self._tracking_watch, self._tilt_watch = TrackingWatch(), TiltWatch()
            self._rival_watch = RivalWatch()
            self._refusals.end()
            self.navigator.take_control(pose, now_s)
        elif (said := self._refusals.news(refusals, now_s)) is not None:
            self._news.append(said)

    def _departure_refusals(self, pose: Pose, now_s: float) -> list[Refusal]:
        found = []
        if self._held:
            text = "holding: the pilot has to take over first"
            found.append(Refusal(RefusalKind.HOLDING, text))
        if not self._complies:
            broken = [clause.name for clause in self.assessment.clauses if not clause.holds]
            text = f"the contract does not comply ({', '.join(broken)})"
            found.append(Refusal(RefusalKind.CONTRACT, text))
        uncleared = self.clearance.refusal(self.epoch_unix_s + now_s)
        if uncleared is not None:
            found.append(Refusal(RefusalKind.PREFLIGHT, uncleared))
        found += self._detection_refusals(now_s)
        if self._position_watch.check_age(pose, now_s) is not None:
            found.append(Refusal(RefusalKind.TELEMETRY, "no fresh telemetry"))
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
        jump, moved = None, pose is not self._watched_pose
        self._watched_pose = pose
        if moved:
            jump = self._position_watch.check_jump(pose)
        if not self.navigator.flying:
            if jump is not None:
                self._hold = _hold_at(pose)
                self.navigator.hover_at(pose, now_s)
            if moved and self.navigator.phase is not Phase.STANDBY:
                self._watch_hover(pose, now_s)
            return
        if jump is not None:
            self._broken(jump, now_s, measured=pose)
        silent = self._intake.monitor.check(now_s, self.assessment.terms)
        stale = self._position_watch.check_age(pose, now_s)
        for violation in (silent, stale, self._rival(now_s), *self._environment_violations(now_s)):
            if violation is not None:
                self._broken(violation, now_s)
        if moved:
            self._watch_tracking(pose, now_s)

    def _watch_tracking(self, pose: Pose, now_s: float) -> None:
        """Answer for tracking, as far as the autopilot follows us.

        If it does not, the next heartbeat tells whom it follows: the pilot, and we are out, or a
        second commander.  Until then what is seen is only said.
        """
        for violation in self._tracking_violations(pose):
            if self._rival_watch.suspects(now_s):
                self._report_suspicion(violation, now_s)
            else:
                self._broken(violation, now_s)

    def _watch_hover(self, pose: Pose, now_s: float) -> None:
        """Say that somebody else commands what we hold still; there is no more that we could do."""
        rival = self._rival(now_s)
        if rival is not None:
            self._report(rival, now_s)
        self._watch_tracking(pose, now_s)

    def _report_suspicion(self, violation: Violation, now_s: float) -> None:
        """Say, once in a flight, that the vehicle goes astray and not by our setpoints."""
        key = (Assumption.SECOND_COMMANDER, "suspected")
        if key not in self._reported:
            self._reported.add(key)
            text = f"not going where we say ({violation}): pilot or second commander?"
            self._news.append(Event(now_s, "suspicion", Severity.WARNING, text))

    def _rival(self, now_s: float) -> Violation | None:
        link = self.link
        if now_s - link.rival_heard_s <= RIVAL_MEMORY_S:
            return Violation(Assumption.SECOND_COMMANDER, 2.0, 1.0, "commanders", link.rival)
        newest_first = reversed(self._sent)
        ours = ((sent.position_ned_m, sent.velocity_ned_mps) for _, sent in newest_first)
        return self._rival_watch.check(link.target_heard_s, link.target, ours)

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
                Event(now_s, "merged", Severity.WARNING, f"avoiding {obstacle.id} as one"),
            ]

    def _tracking_violations(self, pose: Pose) -> list[Violation]:
        reference = self.navigator.reference(pose.time_s)
        if reference is None:
            return []
        leg = self.navigator.leg
        x_m, y_m, _ = leg.position_leg(pose.position_ned_m)
        vx_mps, vy_mps, _ = leg.vector_leg(pose.velocity_ned_mps)
        terms = self.assessment.terms
        found = self._tracking_watch.check(
            (x_m - reference.position_leg_m[0], y_m - reference.position_leg_m[1]),
            (vx_mps, vy_mps),
            (reference.velocity_leg_mps[0], reference.velocity_leg_mps[1]),
            terms,
            cruising=self.navigator.cruising_freely,
        )
        # Looked up among what was sent: the reference of before may have been replaced since.
        acting_s = pose.time_s - terms.attitude_lag_s
        since = bisect.bisect_left(self._sent, (acting_s,))
        if since < len(self._sent):
            asked = self._sent[since][1]
            forward_right_mps2 = _in_heading(asked.acceleration_ned_mps2, pose.yaw_rad)
            lacking = self._tilt_watch.check(pose, forward_right_mps2, terms)
            found += [] if lacking is None else [lacking]
        return found

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
        """Tell whether we hover blind: then the autopilot's own failsafe does better than we."""
        pose = self.link.pose
        blind = pose is None or now_s - pose.time_s > HANDOVER_AFTER_S
        left, self._left = self._left, blind and not self.navigator.flying
        if self._left and not left and self.navigator.phase is not Phase.STANDBY:
            text = "no position: leaving the vehicle to the autopilot"
            self._news.append(Event(now_s, "handed_over", Severity.CRITICAL, text))
        return self._left

    def _collect_events(self) -> None:
        self._news += self.navigator.events
        self.navigator.events.clear()
        for event in self._news:
            if event.severity <= Severity.WARNING or event.name == "phase":
                self.link.send_text(event.severity, f"Clearway: {event.text}")
        self._events.extend(self._news)
        self._news.clear()

    # ------------------------------------------------------------------ what others may know

    def _sensors(self, now_s: float) -> dict[str, Any]:
        """Age of what each sensor saw and said, and how far its stamps are ahead, in seconds."""
        return {
            source: {
                "age_s": _finite(now_s - sensor.newest_stamp_s),
                "heard_age_s": now_s - sensor.heard_s,
                "stamp_ahead_s": sensor.ahead_s,
            }
            for source, sensor in self._intake.monitor.sensors.items()
        }

    def snapshot(self, now_s: float) -> dict[str, Any]:
        """Return the state of this tick as it is logged and published; JSON values only."""
        pose, status, watch = self.link.pose, self.link.status, self._tracking_watch
        setpoint = self.navigator.setpoint(now_s)
        age_s = self._intake.monitor.age_s(now_s)
        return {
            "phase": self.navigator.phase.value,
            "mode": status.mode,
            "armed": status.armed,
            "airborne": status.airborne,
            "position_ned_m": None if pose is None else pose.position_ned_m,
            "velocity_ned_mps": None if pose is None else pose.velocity_ned_mps,
            "roll_rad": None if pose is None else pose.roll_rad,
            "pitch_rad": None if pose is None else pose.pitch_rad,
            "yaw_rad": None if pose is None else pose.yaw_rad,
            "reference_position_ned_m": None if setpoint is None else setpoint.position_ned_m,
            "reference_velocity_ned_mps": None if setpoint is None else setpoint.velocity_ned_mps,
            "reference_acceleration_ned_mps2": (
                None if setpoint is None else setpoint.acceleration_ned_mps2
            ),
            "tracking_error_m": watch.position_error_m,
            "velocity_error_mps": watch.velocity_error_mps,
            "cruising": self.navigator.cruising_freely,
            "leg_heading_rad": self.navigator.leg.heading_rad,
            "detection_age_s": _finite(age_s),
            "telemetry_age_s": None if pose is None else now_s - pose.time_s,
            "sensors": self._sensors(now_s),
            "cleared": self.clearance.refusal(self.epoch_unix_s + now_s) is None,
            "log_ended": self._log_ended,
            "obstacles_known": len(self.navigator.obstacles),
            "dropped": {
                "mavlink_garbage_bytes": self.link.counters.garbage_bytes,
                "mavlink_malformed": self.link.counters.malformed_messages,
                "mavlink_foreign": self.link.counters.foreign_messages,
                "frames_malformed": self.detections.malformed_frames,
                "frames_unplaced": self.detections.unplaced_frames,
                "frames_dropped": self.detections.dropped_frames,
                "clearances_malformed": self.clearance.malformed,
                "missions_malformed": self._malformed_missions,
            },
        }


def _in_heading(vector_ned: tuple[float, float, float], yaw_rad: float) -> tuple[float, float]:
    """Return the forward and right components of a horizontal vector."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    north, east, _ = vector_ned
    return cosine * north + sine * east, cosine * east - sine * north


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if math.isfinite(value) else None


def _hold_at(pose: Pose) -> Setpoint:
    still = (0.0, 0.0, 0.0)
    return Setpoint(pose.position_ned_m, still, still, pose.yaw_rad)
