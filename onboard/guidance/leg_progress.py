"""From leg to leg: the start at rest, the end, another mission, and the way back."""

from __future__ import annotations

import math
from itertools import pairwise

from onboard.events import Event, EventData, EventName, Severity
from onboard.files.mission_file import Mission
from onboard.geometry.frames import wrap_angle
from onboard.guidance.cruise import Cruise
from onboard.guidance.dense.level import climbing
from onboard.guidance.dense.shield import Shield
from onboard.guidance.dense.thread import Thread
from onboard.guidance.envelope import HEADING_TOLERANCE_RAD, at_rest_speed_mps
from onboard.guidance.fallback import Fallback
from onboard.guidance.movers.mover_passing import MoverPassing
from onboard.guidance.phases import FlightState, Trigger
from onboard.guidance.situation import Situation
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State
from onboard.planning import closed_form
from onboard.vehicle_state import Pose


class LegProgress:
    """Starts and ends legs.

    Args:
        situation: what is flown, and what is known.
        fallback: what is left if a leg ends away from its target.
        cruise: flies the leg once the nose is aligned.
        thread: flies it in the space seen free; None where no way to rest is required.
        shield: certifies the cruise there.
        passing: leads past movers; None where no way to rest is required.
    """

    def __init__(
        self,
        situation: Situation,
        fallback: Fallback,
        cruise: Cruise,
        thread: Thread | None,
        shield: Shield | None = None,
        passing: MoverPassing | None = None,
    ) -> None:
        self._situation, self._fallback, self._cruise = situation, fallback, cruise
        self._thread, self._shield, self._passing = thread, shield, passing
        self._declared = situation.assessment.contract.requirements.progress
        self._aligned_since_s: float | None = None

    def accept_no_progress(self, *, accepted: bool) -> bool:
        """Fly the next time with best effort, or as the contract states again; in STANDBY only.

        Returns:
            Whether that changes anything.
        """
        situation = self._situation
        progress = "best_effort" if accepted else self._declared
        return situation.state is FlightState.STANDBY and situation.require(progress)

    def take_control(self, pose: Pose, now_s: float) -> None:
        """Come to a hover and start, or resume, the current leg (CONTROL_GRANTED)."""
        best_effort = self._situation.best_effort
        granted = Trigger.BEST_EFFORT_GRANTED if best_effort else Trigger.CONTROL_GRANTED
        self._situation.fire(granted, now_s)
        if not self._situation.route.returning:
            self._situation.route.flown.clear()
        self._begin_leg(self._situation.measured_state(pose), pose, now_s)

    def release_control(self, now_s: float) -> None:
        """Stop flying, since another commander flies now (CONTROL_TAKEN)."""
        situation = self._situation
        if situation.state is not FlightState.STANDBY:
            situation.fire(Trigger.CONTROL_TAKEN, now_s)
        situation.reference.clear()
        situation.rest_held = False
        if self._thread is not None:
            self._thread.release()
        if self._shield is not None:
            self._shield.release()
        situation.avoidance = None
        situation.obstacles.rejoin()
        self._restart_route()

    def resume(self, pose: Pose, now_s: float) -> None:
        """Go on with the current leg from a hold in which the vehicle rests (RESUMED)."""
        situation = self._situation
        state = situation.reference.sample(now_s)
        assert state is not None  # noqa: S101  a hold has a reference
        resumed = Trigger.BEST_EFFORT_RESUMED if situation.best_effort else Trigger.RESUMED
        situation.fire(resumed, now_s)
        situation.avoidance = None
        situation.obstacles.rejoin()
        # What leads back from rest has been chosen just now.
        if situation.route.returning and situation.route.successor is not None:
            north_m, east_m = self._north_east_m(state)
            situation.route.begin_next(north_m, east_m)
            situation.rebuild_map()
            state = State((0.0, 0.0, state.position_leg_m[2]), (0.0, 0.0, 0.0))
        self._begin_leg(state, pose, now_s)

    def fly_back(self, cause: str, now_s: float) -> bool:
        """Return along the way that was flown: as soon as the vehicle can rest, or from its rest.

        In flight it comes to rest first, as for another mission.  At rest, in HOLDING or ARRIVED,
        `resume` begins the way back.

        Args:
            cause: why, for the operator.
            now_s: when.

        Returns:
            Whether a way was flown that leads back.
        """
        situation = self._situation
        state = situation.reference.sample(now_s)
        if state is None or not self._choose_way_back(self._north_east_m(state), cause, now_s):
            return False
        if situation.state.flying:
            self._stop_for_mission(now_s)
        return True

    def _choose_way_back(self, here_ned_m: tuple[float, float], cause: str, now_s: float) -> bool:
        """Have the way back flown next, and report it; tell whether there is one."""
        situation, route = self._situation, self._situation.route
        body_m = situation.assessment.inflation_m()
        back = route.flown.mission_back(here_ned_m, route.mission, body_m)
        if back is None:
            return False
        route.way_back = route.successor = back
        ends_ned_m = [here_ned_m, *(leg.end_ned_m for leg in back.legs)]
        length_m = math.fsum(math.dist(*leg) for leg in pairwise(ends_ned_m))
        text = f"returning along the way flown, {len(back.legs)} legs, {length_m:.0f} m: {cause}"
        data: EventData = {"mission": back.model_dump(mode="json")}
        situation.emit(Event(now_s, EventName.MISSION_CHANGED, Severity.NOTICE, text, data))
        return True

    def _north_east_m(self, state: State) -> tuple[float, float]:
        x_m, y_m, _ = state.position_leg_m
        north_m, east_m, _ = self._situation.leg.position_ned((x_m, y_m, 0.0))
        return north_m, east_m

    def _stop_for_mission(self, now_s: float) -> None:
        situation = self._situation
        situation.fire(Trigger.MISSION_CHANGED, now_s)
        if situation.state is FlightState.STOPPING and situation.reference.current is not None:
            self._cruise.fly_from(situation.reference.current.sample(now_s), now_s)

    def change_mission(self, mission: Mission, now_s: float) -> None:
        """Fly another mission: from its start in STANDBY, else from where the vehicle stops.

        The vehicle finishes an avoidance in progress first.  In ARRIVED or HOLDING it goes on
        hovering, and flies the new mission after the pilot has taken over and handed back.  In
        flight a mission at another altitude is refused.
        """
        situation = self._situation
        in_flight = situation.state is not FlightState.STANDBY
        objection = situation.fence_objection(mission)
        altitude_m = situation.route.mission.altitude_m
        if in_flight and mission.altitude_m != altitude_m:
            objection = (
                f"altitude {mission.altitude_m:g} m (expected {altitude_m:g} m while in flight)"
            )
        if objection is not None:
            text = f"mission refused: {objection}"
            event = Event(now_s, EventName.MISSION_REFUSED, Severity.WARNING, text)
            situation.emit_rarely(event, "objection")
            return
        self._leave_way_back(now_s)
        situation.route.successor = mission
        situation.assessment = situation.assessment.at_altitude(mission.altitude_m)
        when = "now" if situation.state.flying else "after control is granted"
        text = f"mission changed: flying the new mission {when}"
        data: EventData = {"mission": mission.model_dump(mode="json")}
        situation.emit(Event(now_s, EventName.MISSION_CHANGED, Severity.NOTICE, text, data))
        self._stop_for_mission(now_s)
        if not in_flight:
            self._restart_route()

    def _leave_way_back(self, now_s: float) -> None:
        """Keep of the way flown what still lies between the vehicle and where it began."""
        route, state = self._situation.route, self._situation.reference.sample(now_s)
        if route.returning and state is not None:
            route.flown.cut_at(self._north_east_m(state))
        route.way_back = None

    def advance(self, pose: Pose, now_s: float) -> bool:
        """Start or end a leg, in the states in which the vehicle is outside every region.

        Returns:
            whether that is all there is to decide in this tick; else the vehicle cruises.
        """
        state, current = self._situation.state, self._situation.reference.current
        if current is None:
            return True
        if state is not FlightState.ALIGNING and now_s >= current.end_s:
            self._finish_leg(current.final, pose, now_s)
            return True
        if state is FlightState.ALIGNING and now_s >= current.end_s:
            self._await_alignment(pose, now_s)
        return not state.cruising_freely

    def thread_on(self, thread: Thread, pose: Pose, now_s: float) -> None:
        """Thread until the next tick; end a leg that has been flown, or cruise where that begins.

        Where passing is guaranteed, a place that has been looked at all round starts the cruise.
        """
        situation, confirming = self._situation, thread.confirms_start
        flown = thread.advance(pose, now_s)
        state = situation.reference.sample(now_s)
        assert state is not None  # noqa: S101  what threads has a reference
        looked = confirming and not thread.confirms_start
        if flown:
            self._finish_leg(state, pose, now_s)
        elif looked and situation.shielded and situation.state is FlightState.LOOKING:
            situation.fire(Trigger.START_SEEN, now_s)
            self._align(state, now_s)
        elif self._cruises_again(thread, now_s):
            situation.fire(Trigger.BACK_TO_CRUISE, now_s)
            situation.rebuild_map()
            self._align(state, now_s, seen=True)

    def _cruises_again(self, thread: Thread, now_s: float) -> bool:
        """Tell whether the vehicle has waited for movers, and its cruise is clear of them again."""
        if self._situation.state is not FlightState.YIELDING or self._shield is None:
            return False
        if not (thread.way.still and thread.yielding.has_settled and thread.resumes_cruise):
            return False
        shield, passing = self._shield, self._passing

        def is_clear() -> bool:
            if shield.is_clear_from_rest(now_s):
                return True
            return passing is not None and passing.leads_on_from_rest(now_s)

        return thread.yielding.has_been_clear(is_clear, now_s)

    def _begin_leg(self, state: State, pose: Pose, now_s: float) -> None:
        route = self._situation.route
        if not route.returning:
            route.flown.begin_leg(route.leg, self._north_east_m(state))
        self._situation.rest_held = self._thread is not None
        if self._thread is not None and self._situation.best_effort:
            self._thread.begin_leg(state, pose.yaw_rad, now_s)
        else:
            self._align(state, now_s)

    def _align(self, state: State, now_s: float, *, seen: bool = False) -> None:
        """Hover and turn the nose, and with it the sensor, along the leg.

        A vehicle that is to hold a way to rest comes to the height of the leg meanwhile, at which
        the space around it is seen.

        Args:
            state: where it is, leg frame.
            now_s: the time.
            seen: the place is certified already, and stays so.
        """
        situation = self._situation
        situation.reference.heading_rad = 0.0
        if self._thread is None or not situation.shielded:
            hover = situation.braking_from(state, now_s)
        else:
            # At rest already, but for what it stops within its tracking error.
            if not seen:
                self._thread.release()
            at_rest = State(state.position_leg_m, (0.0, 0.0, 0.0))
            hover = closed_form.cruise(at_rest, now_s, climbing(situation.envelope), 0.0, z_m=0.0)
        situation.reference.fly(hover)
        self._aligned_since_s = None

    def _await_alignment(self, pose: Pose, now_s: float) -> None:
        """Cruise once the nose has been along the leg, at rest, for as long as a look takes."""
        situation = self._situation
        terms = situation.assessment.terms
        error_rad = abs(wrap_angle(pose.yaw_rad - situation.leg.heading_rad))
        at_rest = math.hypot(*pose.velocity_ned_mps) < at_rest_speed_mps(situation.assessment)
        look_s = terms.frame_age_max_s + terms.reaction_time_s
        if error_rad > HEADING_TOLERANCE_RAD or not at_rest:
            self._aligned_since_s = None
        elif self._aligned_since_s is None:
            self._aligned_since_s = now_s
        elif now_s - self._aligned_since_s >= look_s:
            state = situation.reference.sample(now_s)
            assert state is not None  # noqa: S101  aligning implies a reference
            if self._shield is not None and not self._shield.rest(state, now_s):
                situation.fire(Trigger.START_UNSEEN, now_s)
                assert self._thread is not None  # noqa: S101  the shield has it
                self._thread.begin_leg(state, pose.yaw_rad, now_s)
                return
            situation.fire(Trigger.ALIGNED, now_s)
            self._cruise.fly_from(state, now_s)

    def _finish_leg(self, final: State, pose: Pose, now_s: float) -> None:
        """Begin the next leg from where the vehicle is at rest, or arrive."""
        situation = self._situation
        x_m, y_m, z_m = final.position_leg_m
        beside_m = max(abs(y_m), abs(x_m - situation.route.length_m))
        allowed_m = situation.route.leg.target_half_width_m
        if beside_m > allowed_m and not situation.state.changes_mission:
            missed = Violation(Assumption.TARGET_REACHED, beside_m, allowed_m, "m")
            if self._shield is not None and self._shield.guards:
                self._shield.report_and_divert(missed, now_s)
            else:
                self._fallback.report_and_hold(missed, now_s)
            return
        # From where the vehicle is: the last leg may have left it beside its end (erratum 16).
        north_m, east_m = self._north_east_m(final)
        if situation.route.returns_next:
            self._choose_way_back((north_m, east_m), "the mission has been flown", now_s)
        if situation.route.begin_next(north_m, east_m):
            back = situation.shielded and situation.state.in_seen_space
            situation.fire(Trigger.BACK_TO_CRUISE if back else Trigger.LEG_FLOWN, now_s)
            situation.rebuild_map()
            # After a climb the vehicle may still be a little above the cruise height.
            self._begin_leg(State((0.0, 0.0, z_m), (0.0, 0.0, 0.0)), pose, now_s)
        else:
            situation.fire(Trigger.MISSION_FLOWN, now_s)

    def _restart_route(self) -> None:
        if self._situation.route.successor is not None:
            self._situation.route.restart()
            self._situation.rebuild_map()
