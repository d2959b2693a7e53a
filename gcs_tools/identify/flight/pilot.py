"""Flies a programme, without I/O: bytes in by the daemon's MAVLink endpoint, setpoints out.

The mode is the pilot's, as it is for the daemon (`onboard.guidance.authority`): setpoints are flown
only while the vehicle is airborne, armed and in a mode that takes them, and the flight ends at
once, for good, when one of these ends.  Whatever else speaks against going on leads to rest, and to
a hover until the pilot takes over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs_tools.identify.flight.free_air import PlacedBox
from gcs_tools.identify.flight.programme import Pass, Programme, braking
from onboard.events import Severity
from onboard.geometry.fence import Fence
from onboard.geometry.frames import LegFrame, wrap_angle
from onboard.geometry.rest import RestDetector
from onboard.guidance.authority import HANDOVER_AFTER_S, hovering_at
from onboard.guidance.envelope import HEADING_TOLERANCE_RAD
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.monitoring.estimator.position_quality import DEAD_RECKONING_S, PositionQualityMonitor
from onboard.motion.trajectory import State, Trajectory
from onboard.vehicle_state import AUTOPILOT_SILENCE_S, Pose, Setpoint

# Between passes the vehicle rests, long enough to see when it has come to rest.
REST_S: Final = 3.0
# The nose must point along a pass for this long: what is left of a turn counts as heading error.
ALIGNED_S: Final = 3.0
# A turn, or a run after the end of the stream, that takes longer is over.
PATIENCE_S: Final = 20.0
# A setpoint from another commander within this time keeps the flight from going on.
_HEARD_S: Final = 1.0
_LOWEST_M: Final = 2.0
_REFUSAL_PERIOD_S: Final = 5.0


class Stage(StrEnum):
    """What the flight is doing, as it is logged."""

    WAITING = "waiting"
    RESTING = "resting"
    TURNING = "turning"
    PASSING = "passing"
    SILENT = "silent"
    BRAKING = "braking"
    HOLDING = "holding"
    ENDED = "ended"


IN_PROGRAMME: Final = (Stage.RESTING, Stage.TURNING, Stage.PASSING, Stage.SILENT)


@dataclass(frozen=True)
class Notice:
    """One line for operator and log."""

    time_s: float
    severity: Severity
    text: str


class IdentificationPilot:
    """Flies the passes of a programme one after another.

    Args:
        link: what the autopilot reports, and takes the setpoints.
        programme: to fly.
        fence: that the free air has to lie within; None for none.
        telemetry_timeout_s: older telemetry ends the flight.

    Attributes:
        stage: what it is doing.
        complete: whether every pass was flown to its end.
        ended: why the programme is over; empty while it is not.
        frame: of the present pass.
    """

    def __init__(
        self,
        link: MavlinkEndpoint,
        programme: Programme,
        fence: Fence | None = None,
        telemetry_timeout_s: float = 0.5,
    ) -> None:
        self.stage, self.complete, self.ended = Stage.WAITING, False, ""
        self._link, self._programme, self._fence = link, programme, fence
        self._timeout_s = telemetry_timeout_s
        self._quality = PositionQualityMonitor(link.position_reports)
        self._passes = list(programme.passes)
        self._notices: list[Notice] = []
        self._box: PlacedBox | None = None
        self.frame = LegFrame((0.0, 0.0, 0.0), 0.0)
        self._trajectory: Trajectory | None = None
        self._silent_from_s: float | None = None
        self._since_s = self._said_s = -math.inf
        self._aligned_s = math.inf
        self._hover: Setpoint | None = None
        self._rest, self._rest_pose_s = RestDetector(), -math.inf

    @property
    def over(self) -> bool:
        """Whether nothing more is commanded."""
        return self.stage is Stage.ENDED

    def take_notices(self) -> list[Notice]:
        """Return and forget what has happened."""
        notices, self._notices = self._notices, []
        return notices

    def stop(self, now_s: float, reason: str = "interrupted") -> None:
        """Come to rest and hover until the pilot takes over; before the flight, end at once."""
        if self.stage is Stage.WAITING:
            self.end(now_s, reason)
        elif self.stage in IN_PROGRAMME:
            self._brake(now_s, reason)

    def end(self, now_s: float, reason: str) -> None:
        """Command nothing more."""
        if not self.ended:
            self.ended = reason
            self._say(now_s, Severity.WARNING, f"identification ended: {reason}")
        self._enter(Stage.ENDED, now_s)

    def tick(self, now_s: float) -> None:
        """Decide what is flown until the next tick, 20 ms later, and queue its setpoint."""
        link = self._link
        if self.stage is not Stage.ENDED:
            self._decide(now_s)
        link.keep_alive(now_s, active=self.stage not in (Stage.WAITING, Stage.ENDED))
        setpoint = self.setpoint(now_s)
        if setpoint is not None:
            link.send_setpoint(setpoint, now_s)

    def setpoint(self, now_s: float) -> Setpoint | None:
        """Return what is commanded now; None where nothing is."""
        on_ground = self._link.status.airborne is not True
        if on_ground or self.stage in (Stage.SILENT, Stage.ENDED) or self._is_lost(now_s):
            return None
        if self.stage in (Stage.PASSING, Stage.BRAKING) and self._trajectory is not None:
            return self._sampled(self._trajectory, now_s - self._since_s)
        return self._hover

    # ------------------------------------------------------------------ what follows what

    def _decide(self, now_s: float) -> None:
        pose = self._link.pose
        if pose is not None and pose.time_s != self._rest_pose_s:
            self._rest_pose_s = pose.time_s
            self._rest.add(pose.time_s, pose.position_ned_m)
        if self.stage is Stage.WAITING:
            self._wait(pose, now_s)
            return
        withdrawn = self._withdrawn(now_s)
        if withdrawn is not None:
            self.end(now_s, withdrawn)
            return
        if self.stage in IN_PROGRAMME:
            objection = self._objection(pose, now_s)
            if objection is not None:
                self._brake(now_s, objection)
        self._go_on(pose, now_s)

    def _go_on(self, pose: Pose | None, now_s: float) -> None:
        match self.stage:
            case Stage.RESTING if now_s - self._since_s >= REST_S:
                self._begin_next(now_s)
            case Stage.TURNING:
                self._turn(pose, now_s)
            case Stage.PASSING:
                self._pass_on(now_s)
            case Stage.SILENT:
                self._listen(pose, now_s)
            case Stage.BRAKING if self._trajectory_is_over(now_s):
                self._enter(Stage.HOLDING, now_s)

    def _wait(self, pose: Pose | None, now_s: float) -> None:
        """Hover where the vehicle is, until control is granted and nothing speaks against it."""
        status = self._link.status
        granted = status.armed and status.external_control and status.airborne is True
        if pose is None or not granted or now_s - status.heard_s > AUTOPILOT_SILENCE_S:
            self._hover = None if pose is None else hovering_at(pose)
            return
        self._hover = self._hover or hovering_at(pose)
        box = PlacedBox(
            LegFrame(self._hover.position_ned_m, self._hover.yaw_ned_rad),
            self._programme.air,
            self._programme.margin_m,
        )
        refusals = self._refusals(box, pose, now_s)
        if refusals:
            if now_s - self._said_s >= _REFUSAL_PERIOD_S:
                self._said_s = now_s
                self._say(now_s, Severity.WARNING, f"not flying: {'; '.join(refusals)}")
            return
        self._box, self.frame = box, box.frame
        self._quality.depart(now_s)
        self._say(now_s, Severity.NOTICE, "control taken: identification begins")
        self._enter(Stage.RESTING, now_s)

    def _refusals(self, box: PlacedBox, pose: Pose, now_s: float) -> list[str]:
        found = self._quality.departure_failures(now_s)
        if now_s - pose.time_s > self._timeout_s:
            found.append("no fresh telemetry")
        if -pose.position_ned_m[2] < _LOWEST_M:
            height_m = -pose.position_ned_m[2]
            found.append(f"the vehicle is {height_m:.1f} m high, expected {_LOWEST_M:g} m or more")
        if self._fence is not None and box.leaves_fence(self._fence):
            found.append("the free air reaches beyond the geofence")
        return found

    def _withdrawn(self, now_s: float) -> str | None:
        """Return by what the pilot, or the autopilot, has taken control; None while it is ours."""
        status, modes = self._link.status, self._link.profile.modes
        if now_s - status.heard_s > AUTOPILOT_SILENCE_S:
            return None  # it has handed nothing back: `_objection` ends the programme
        if status.airborne is not True or not status.armed:
            return "the vehicle has landed" if self.ended else "landed before the end"
        if status.external_control:
            return None
        expected = None if modes.hold is None else modes.hold.name
        if self.stage is Stage.SILENT and status.mode == expected:
            return None  # the autopilot's own response to the end of the stream
        if status.failsafe:
            return f"the autopilot's failsafe has taken over ({status.mode})"
        return f"the pilot has taken over ({status.mode})"

    def _objection(self, pose: Pose | None, now_s: float) -> str | None:
        """Return what speaks against going on; None if nothing does."""
        link = self._link
        if pose is None or now_s - pose.time_s > self._timeout_s:
            return "telemetry is missing"
        if now_s - link.status.heard_s > AUTOPILOT_SILENCE_S:
            return "the autopilot is silent"
        if now_s - link.second_commander_heard_s <= _HEARD_S:
            return f"another commander sends setpoints ({link.second_commander})"
        sign = self._quality.check(now_s)
        if sign is not None:
            return sign.sentence
        return None if self._box is None else self._box.leaves(pose.position_ned_m)

    # ------------------------------------------------------------------ passes

    def _begin_next(self, now_s: float) -> None:
        if not self._passes:
            self.complete = True
            self._finish(now_s, "every pass was flown")
            return
        nose_rad = self._heading_of(self._passes[0])
        if self._hover is not None:
            self._hover = self._hover._replace(yaw_ned_rad=nose_rad)
        self._aligned_s = math.inf
        self._enter(Stage.TURNING, now_s)

    def _heading_of(self, flown: Pass) -> float:
        ahead_rad = 0.0 if self._box is None else self._box.frame.heading_rad
        return wrap_angle(ahead_rad + math.pi) if flown.back else ahead_rad

    def _turn(self, pose: Pose | None, now_s: float) -> None:
        flown = self._passes[0]
        heading_rad = self._heading_of(flown)
        off_rad = math.inf if pose is None else abs(wrap_angle(pose.yaw_rad - heading_rad))
        if off_rad > HEADING_TOLERANCE_RAD:
            self._aligned_s = math.inf
        else:
            self._aligned_s = min(self._aligned_s, now_s)
        # A nose that turns fast swings beyond.
        if now_s - self._aligned_s >= ALIGNED_S and self._rest.at_rest:
            self.frame = LegFrame(self._resting_place, heading_rad)
            self._trajectory = self._passes.pop(0).trajectory
            self._silent_from_s = flown.silent_from_s
            number = len(self._programme.passes) - len(self._passes)
            text = f"pass {number} of {len(self._programme.passes)}: {flown.name}"
            self._say(now_s, Severity.INFO, text)
            self._enter(Stage.PASSING, now_s)
        elif now_s - self._since_s > PATIENCE_S:
            self._brake(now_s, "the vehicle does not turn its nose")

    def _pass_on(self, now_s: float) -> None:
        into_s = now_s - self._since_s
        if self._silent_from_s is not None and into_s >= self._silent_from_s:
            self._say(now_s, Severity.NOTICE, "the stream of setpoints ends")
            self._enter(Stage.SILENT, now_s)
        elif self._trajectory_is_over(now_s):
            self._enter(Stage.RESTING, now_s)

    def _listen(self, pose: Pose | None, now_s: float) -> None:
        """Watch the vehicle run on without setpoints until it rests."""
        silent_s = now_s - self._since_s
        # A vehicle that has only just begun to brake is not at rest.
        if silent_s >= REST_S and self._rest.at_rest and pose is not None:
            self._hover = hovering_at(pose)
            self.complete = not self._passes
            self._finish(now_s, "the vehicle has come to rest without setpoints")
        elif silent_s > PATIENCE_S:
            self._brake(now_s, "the vehicle does not come to rest without setpoints")

    # ------------------------------------------------------------------ ends

    def _brake(self, now_s: float, reason: str) -> None:
        """Come to rest from the reference, or, where it was silent, from where the vehicle is."""
        state, pose = self._state(now_s), self._link.pose
        if self.stage is Stage.SILENT and pose is not None:
            moving = self.frame.vector_leg(pose.velocity_ned_mps)
            state = State(self.frame.position_leg(pose.position_ned_m), moving)
        self._trajectory = braking(state, self._programme.envelope)
        self._finish(now_s, reason, Stage.BRAKING)

    def _finish(self, now_s: float, reason: str, stage: Stage = Stage.HOLDING) -> None:
        self.ended = reason
        severity = Severity.NOTICE if self.complete else Severity.CRITICAL
        self._say(now_s, severity, f"identification over: {reason}; take over and land")
        self._enter(stage, now_s)

    def _enter(self, stage: Stage, now_s: float) -> None:
        moved = self.stage in (Stage.PASSING, Stage.BRAKING)
        if stage in (Stage.RESTING, Stage.HOLDING) and moved and self._trajectory is not None:
            self._hover = self._sampled(self._trajectory, math.inf)
        self.stage, self._since_s = stage, now_s

    # ------------------------------------------------------------------ the reference

    def _trajectory_is_over(self, now_s: float) -> bool:
        return self._trajectory is None or now_s - self._since_s >= self._trajectory.end_s

    def _state(self, now_s: float) -> State:
        if self.stage in (Stage.PASSING, Stage.BRAKING) and self._trajectory is not None:
            return self._trajectory.sample(now_s - self._since_s)
        return State(self.frame.position_leg(self._resting_place), (0.0, 0.0, 0.0))

    def _sampled(self, trajectory: Trajectory, into_s: float) -> Setpoint:
        state, frame = trajectory.sample(min(into_s, trajectory.end_s)), self.frame
        return Setpoint(
            frame.position_ned(state.position_leg_m),
            frame.vector_ned(state.velocity_leg_mps),
            frame.vector_ned(state.acceleration_leg_mps2),
            frame.heading_rad,
        )

    @property
    def _resting_place(self) -> tuple[float, float, float]:
        return self.frame.origin_ned_m if self._hover is None else self._hover.position_ned_m

    def _is_lost(self, now_s: float) -> bool:
        """Tell whether the position is gone, so that the autopilot's own failsafe does better."""
        pose = self._link.pose
        if pose is None or now_s - pose.time_s > HANDOVER_AFTER_S:
            return True
        sign = self._quality.check(now_s)
        return sign is not None and self._quality.lost_for_s(sign, now_s) > DEAD_RECKONING_S

    def _say(self, now_s: float, severity: Severity, text: str) -> None:
        self._notices.append(Notice(now_s, severity, text))
        self._link.send_text(severity, f"Clearway: {text}")
