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
from dataclasses import dataclass
from typing import Any, Final

from onboard.agility import InputSet
from onboard.clearance import ClearanceGate
from onboard.config import Contract, Mission
from onboard.contract import Assessment, assess
from onboard.events import Event, Severity
from onboard.guidance import Phase
from onboard.mavlink import TELEMETRY_RATE_HZ, MavlinkEndpoint, Pose, Setpoint
from onboard.monitor import Assumption, Violation, check_frame, check_obstacle
from onboard.navigator import Navigator
from onboard.obstacles import (
    Detection,
    DetectionFrame,
    Obstacle,
    PoseHistory,
    corners_ned,
    parse_frame,
)
from onboard.payload import MalformedPayloadError, parse
from onboard.planner import Planner
from onboard.watches import (
    CLOCK_TOLERANCE_S,
    DetectionWatch,
    PositionWatch,
    RivalWatch,
    TickWatch,
    TiltWatch,
    TrackingWatch,
)

log = logging.getLogger(__name__)

# At 20 Hz a tick sees one frame; a burst beyond this is a fault, and the oldest are dropped.
MAX_PENDING_FRAMES: Final = 32
AUTOPILOT_SILENCE_S: Final = 3.0
# Events that nobody fetches are kept this long, the latest of them.
MAX_EVENTS: Final = 10_000
# Somebody else's setpoint this recent means that two are flying.
RIVAL_MEMORY_S: Final = 0.5
# Setpoints are remembered this long: the autopilot's echo of them lags by up to half a second.
SENT_MEMORY_S: Final = 0.6
# How far apart the times of a pose between two others and of a frame from the body may be.
POSE_TIMING_S: Final = 0.5 / TELEMETRY_RATE_HZ
# What this displaces by less than this share of a sensor's error is seen sharply.
SHARP_SHARE: Final = 0.1
# Holding without knowing where for longer than this is left to the autopilot.
HANDOVER_AFTER_S: Final = 2.0


@dataclass
class DetectionCounters:
    """What arrived from the sensors and was not used; nothing of it ever raises."""

    malformed_frames: int = 0
    unplaced_frames: int = 0
    dropped_frames: int = 0


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
        self.detections = DetectionCounters()
        self.clearance = ClearanceGate(contract.sha256, preflight_age_max_s)
        self._complies = assessment.compliant or fly_outside_contract
        self._fly_outside_contract = fly_outside_contract
        self._detection_watch = DetectionWatch()
        self._position_watch = PositionWatch(stale_after_s)
        self._tracking_watch, self._tilt_watch = TrackingWatch(), TiltWatch()
        self._tick_watch, self._rival_watch = TickWatch(), RivalWatch()
        self._poses = PoseHistory()
        self._pending: deque[bytes] = deque()
        self._pending_mission: bytes | None = None
        self._malformed_missions = 0
        self._log_ended = False
        # What happened in this tick, and all that nobody has asked for yet.
        self._news: list[Event] = []
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._reported: set[tuple[Assumption, str]] = set()
        self._hold: Setpoint | None = None
        self._refusal: tuple[str, ...] = ()
        self._watched_pose: Pose | None = None
        self._sent: deque[tuple[float, Setpoint]] = deque()
        self._left = False
        self._held = False

    @property
    def assessment(self) -> Assessment:
        """The contract as it is flown now: as declared, or solved again for what was seen."""
        return self.navigator.assessment

    # ------------------------------------------------------------------ inputs, latched

    def receive_mavlink(self, data: bytes, now_s: float) -> None:
        """Take bytes from the autopilot's link."""
        before = self.link.pose
        self.link.receive(data, now_s)
        if self.link.pose is not None and self.link.pose is not before:
            self._poses.add(self.link.pose)

    def receive_detection(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take one detection frame; it is read in the next tick."""
        if len(self._pending) == MAX_PENDING_FRAMES:
            self._pending.popleft()
            self.detections.dropped_frames += 1
        self._pending.append(payload)

    def receive_clearance(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take the outcome of a pre-flight check; it is asked for when control is granted."""
        self.clearance.receive(payload)

    def receive_mission(self, payload: bytes, now_s: float) -> None:  # noqa: ARG002  latched
        """Take a mission to be flown instead of the present one; it is read in the next tick."""
        self._pending_mission = payload

    def set_epoch(self, epoch_unix_s: float) -> bool:
        """Read stamps by a clock that has been set; refused while the vehicle may fly.

        Every sensor has to be seen anew: ages by the old time mean nothing by the new one.

        Args:
            epoch_unix_s: Unix time at ``now_s`` zero by the clock as it is now.

        Returns:
            Whether it was taken.
        """
        status = self.link.status
        if status.armed or status.airborne is True or self.navigator.phase is not Phase.STANDBY:
            return False
        self.epoch_unix_s = epoch_unix_s
        self._detection_watch.forget_stamps()
        return True

    def emit(self, event: Event) -> None:
        """Take an event of the daemon's own, to be logged and sent like those of the service."""
        self._news.append(event)

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
        self._take_frames(now_s)
        self._take_mission(now_s)
        pose = self.link.pose
        if pose is not None:
            self._follow_mode(pose, now_s)
            self._watch(pose, now_s)
            self.navigator.advance(pose, now_s)

    def _take_frames(self, now_s: float) -> None:
        while self._pending:
            payload = self._pending.popleft()
            try:
                frame = parse_frame(payload)
            except MalformedPayloadError as error:
                self.detections.malformed_frames += 1
                log.debug("dropped a malformed detection frame: %s", error)
            else:
                self._take_frame(frame, now_s)

    def _take_frame(self, frame: DetectionFrame, now_s: float) -> None:
        stamp_s = frame.stamp_unix_s - self.epoch_unix_s
        pose = self._poses.at(stamp_s) if frame.frame == "body_frd" else None
        ahead = stamp_s > now_s + CLOCK_TOLERANCE_S
        if frame.frame == "body_frd" and pose is None and not ahead:
            # Seen, but nobody knows from where: as good as not seen.
            self.detections.unplaced_frames += 1
            return
        terms = self.assessment.terms
        blurs_m = {} if pose is None else self._blurs_m(frame, stamp_s)
        if any(blur_m > terms.position_error_m for blur_m in blurs_m.values()):
            self.detections.unplaced_frames += 1
            return
        lateness = self._detection_watch.on_frame(frame.source, stamp_s, now_s, terms)
        for violation in lateness + check_frame(frame, terms):
            self._broken(violation, now_s)
        if ahead:
            return
        for detection in frame.obstacles:
            track_id = _track_id(frame, detection)
            if pose is None or track_id in blurs_m:
                self._take_detection(track_id, detection, pose, now_s)

    def _blurs_m(self, frame: DetectionFrame, stamp_s: float) -> dict[str, float]:
        """How far off a turning body sees what is to be taken from a frame, by track.

        Pose and frame belong together only as exactly as their times do.  What is hardly blurred
        counts as sharp; of the rest what is known already has been seen better, and what is far, or
        seen at rest before the departure, will be: only what is new and near has to be taken as it
        is, or makes the frame as good as none.
        """
        turn_rad = abs(self._poses.yaw_rate_radps(stamp_s)) * POSE_TIMING_S
        sharp_m = SHARP_SHARE * self.assessment.terms.position_error_m
        blurs_m = {}
        for detection in frame.obstacles:
            track_id, blur_m = (
                _track_id(frame, detection),
                math.hypot(*detection.center_m) * turn_rad,
            )
            if blur_m <= sharp_m:
                blurs_m[track_id] = 0.0
            elif self._moving and self._must_be_known(track_id, detection):
                blurs_m[track_id] = blur_m
        return blurs_m

    def _must_be_known(self, track_id: str, detection: Detection) -> bool:
        """Tell whether what is seen is new, and so near that the contract counts on it."""
        counted_on_m = self.assessment.inflated.required_detection_range_m
        near_m = math.hypot(*detection.center_m) - math.hypot(*detection.size_m) / 2.0
        return self.navigator.obstacles.of_track(track_id) is None and near_m <= counted_on_m

    @property
    def _moving(self) -> bool:
        return self.navigator.cruising_freely or self.navigator.phase is Phase.AVOID

    def _take_detection(
        self, obstacle_id: str, detection: Detection, pose: Pose | None, now_s: float
    ) -> None:
        obstacles = self.navigator.obstacles
        corners = corners_ned(detection, pose)
        if not obstacles.add(obstacle_id, corners, detection.uncertainty_m):
            return
        obstacle = obstacles.of_track(obstacle_id)
        if obstacle is not None:
            self.navigator.recheck_plan(obstacle, now_s)

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
            self._refusal = ()
        elif navigator.phase is Phase.STANDBY:
            # A daemon that restarts in flight finds itself in control: it holds where it is.
            self._hold = self._hold or _hold_at(pose)
            self._depart(pose, now_s)

    def _depart(self, pose: Pose, now_s: float) -> None:
        failures = tuple(self._departure_failures(pose, now_s))
        if not failures:
            self._reported.clear()
            self._tracking_watch, self._tilt_watch = TrackingWatch(), TiltWatch()
            self._rival_watch = RivalWatch()
            self.navigator.take_control(pose, now_s)
        elif failures != self._refusal:
            text = "not leaving standby: " + "; ".join(failures)
            self._news.append(Event(now_s, "refused", Severity.WARNING, text))
        self._refusal = failures

    def _departure_failures(self, pose: Pose, now_s: float) -> list[str]:
        failures = []
        if self._held:
            failures.append("holding: the pilot has to take over first")
        if not self._complies:
            broken = [clause.name for clause in self.assessment.clauses if not clause.holds]
            failures.append(f"the contract does not comply ({', '.join(broken)})")
        uncleared = self.clearance.refusal(self.epoch_unix_s + now_s)
        if uncleared is not None:
            failures.append(uncleared)
        if self._detection_watch.check(now_s, self.assessment.terms) is not None:
            failures.append("no fresh detection frames")
        if self._position_watch.check_age(pose, now_s) is not None:
            failures.append("no fresh telemetry")
        failures += self.navigator.departure_failures(pose)
        if not self._fly_outside_contract:
            failures += map(str, self._environment_violations(now_s))
        return failures

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
        silent = self._detection_watch.check(now_s, self.assessment.terms)
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
        if self.navigator.flying and key not in self._reported:
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

    def snapshot(self, now_s: float) -> dict[str, Any]:
        """Return the state of this tick as it is logged and published; JSON values only."""
        pose, status, watch = self.link.pose, self.link.status, self._tracking_watch
        setpoint = self.navigator.setpoint(now_s)
        age_s = self._detection_watch.age_s(now_s)
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
            "detection_age_s": age_s if math.isfinite(age_s) else None,
            "telemetry_age_s": None if pose is None else now_s - pose.time_s,
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


def _track_id(frame: DetectionFrame, detection: Detection) -> str:
    return f"{frame.source}/{detection.id}"


def _in_heading(vector_ned: tuple[float, float, float], yaw_rad: float) -> tuple[float, float]:
    """Return the forward and right components of a horizontal vector."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    north, east, _ = vector_ned
    return cosine * north + sine * east, cosine * east - sine * north


def _hold_at(pose: Pose) -> Setpoint:
    still = (0.0, 0.0, 0.0)
    return Setpoint(pose.position_ned_m, still, still, pose.yaw_rad)
