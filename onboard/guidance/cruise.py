"""Cruising along the leg, drifting back to its line, and stopping for another mission."""

from __future__ import annotations

from onboard.contract.assessment import TICK_S
from onboard.events import Event, EventName, Severity
from onboard.guidance.dense.shield import Shield
from onboard.guidance.envelope import envelope_from
from onboard.guidance.fallback import Fallback
from onboard.guidance.phases import FlightState, Trigger
from onboard.guidance.situation import Situation
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.motion.trajectory import State, X
from onboard.perception.obstacle_map import Obstacle
from onboard.planning.certifier import certify_clear
from onboard.planning.closed_form import stop_at


class Cruise:
    """Flies the leg outside every Region of Influence.

    Args:
        situation: what is flown, and what is known.
        fallback: what is left if the cruise cannot go on.
        shield: threads the rest of a leg that ends too near to an obstacle; None without one.
    """

    def __init__(
        self, situation: Situation, fallback: Fallback, shield: Shield | None = None
    ) -> None:
        self._situation, self._fallback, self._shield = situation, fallback, shield
        # Theory F: a drift may begin once the vehicle has flown straight on from here far enough.
        self._straight_from_x_m = 0.0

    def fly_from(self, state: State, start_s: float) -> None:
        """Cruise on from a state as the automaton says: straight, drifting, or to a stop.

        The cruise stops at the end of the leg, or beyond it if that is too near; before another
        mission, as soon as it can.
        """
        situation = self._situation
        x_m = self._straight_from_x_m = state.position_leg_m[X]
        terms = situation.assessment.terms
        drifting = situation.state is FlightState.RECENTRING
        stopping = stop_at(
            state,
            start_s,
            situation.envelope,
            x_m if situation.state.changes_mission else situation.route.length_m,
            speed_mps=terms.cruise_speed_mps,
            z_m=0.0,
            recentring_mps=terms.recentring_speed_mps if drifting else 0.0,
        )
        cruise = stopping or situation.braking_from(state, start_s)
        situation.reference.intend(cruise)
        envelope = envelope_from(state, situation.envelope)
        certificate = certify_clear(cruise, state, start_s, envelope)
        if not certificate.valid:
            text = f"the certifier rejected the cruise: {'; '.join(certificate.failures)}"
            situation.emit(Event(start_s, EventName.CERTIFICATE, Severity.CRITICAL, text))
            rejected = Violation(Assumption.SELF_CHECK, 1.0, 0.0, "certificates")
            self._fallback.report_and_hold(rejected, start_s)

    def replan(self, state: State, now_s: float) -> None:
        """Plan the cruise again from a state, since the estimate or the contract has changed."""
        self._situation.fire(Trigger.CRUISE_REPLANNED, now_s)
        self.fly_from(state, now_s)

    def advance(self, now_s: float) -> Obstacle | None:
        """Cruise until the next tick, unless an obstacle has to be avoided in it.

        Returns:
            the obstacle whose region begins before the next tick; None to cruise on, or if the leg
            ends too near to an obstacle, so that the vehicle threads on, or brakes to hover.
        """
        situation = self._situation
        current = situation.reference.current
        assert current is not None  # noqa: S101  what cruises has a reference
        here = current.sample(now_s)
        x_m, y_m, _ = here.position_leg_m
        horizon_m = current.sample(now_s + TICK_S).position_leg_m[X] - x_m
        obstacle = self._obstacle_to_avoid(x_m, y_m, horizon_m)
        end_x_m = current.final.position_leg_m[X]
        if obstacle is None or end_x_m < obstacle.region.keep_out.x_min_m:
            self._recentre(here, now_s)
            return None
        if end_x_m <= obstacle.region.x_pob_m and not situation.state.changes_mission:
            short_m = obstacle.region.x_pob_m - end_x_m
            too_near = Violation(Assumption.LEG_END_CLEAR, short_m, 0.0, "m", obstacle.id)
            if self._shield is None:
                self._fallback.report_and_hold(too_near, now_s)
            else:
                self._shield.report_and_divert(too_near, now_s)
            return None
        return obstacle

    def keep_guarded(self, shield: Shield, now_s: float) -> None:
        """Have what is intended certified; where what is flown has left it, go on from there."""
        situation = self._situation
        flown = situation.reference.sample(now_s)
        renewed = shield.advance(now_s)
        off_course = situation.state.cruising_freely and shield.is_off_course(now_s)
        if not renewed and off_course and flown is not None:
            self.fly_from(flown, now_s)
            renewed = shield.guards and shield.advance(now_s)
        if not renewed and shield.guards:
            shield.divert_if_due(now_s)

    def _obstacle_to_avoid(self, x_m: float, y_m: float, horizon_m: float) -> Obstacle | None:
        """Return the first obstacle on the way of which the avoidance begins within a horizon."""
        situation = self._situation
        if self._shield is None:
            return situation.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=horizon_m)
        seen_m = situation.assessment.terms.detection_range_m
        first = situation.obstacles.obstacle_of_interest(x_m, y_m, horizon_m=seen_m)
        if first is None:
            return None
        begins_m = situation.to_avoid(first).region.approach_x_m
        return first if begins_m <= x_m + horizon_m else None

    def _recentre(self, here: State, now_s: float) -> None:
        """Begin or end the drift back to the leg line (theory F)."""
        situation = self._situation
        corridor, current = situation.assessment.corridor, situation.reference.current
        if corridor is None or current is None or situation.state.changes_mission:
            return
        x_m, y_m, _ = here.position_leg_m
        soon = current.sample(now_s + corridor.ending_s)
        free = corridor.steady(here.velocity_leg_mps[X], soon.velocity_leg_mps[X]) and not any(
            corridor.meets(y_m, obstacle.region.keep_out)
            for obstacle in situation.obstacles.between(x_m, x_m + corridor.reach_m)
        )
        if situation.state is FlightState.RECENTRING:
            if not free:
                situation.fire(Trigger.CORRIDOR_BLOCKED, now_s)
                self.fly_from(here, now_s)
        elif free and corridor.seen(y_m, straight_m=x_m - self._straight_from_x_m):
            situation.fire(Trigger.CORRIDOR_FREE, now_s)
            self.fly_from(here, now_s)
