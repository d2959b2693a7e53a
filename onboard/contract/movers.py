"""What passive safety against movers requires: at rest before any contact (THEORY.md, "Movers").

Notation (theory -> here): v_o ``speed_max_mps`` of a class, kappa from "within range" to the
acceleration acting, t_set ``rest_settle_s``, F ``fixed_m``, b ``brake_mps2``, V_e ``speed_mps``.
R is taken from the vehicle's reference point to the nearest face of a mover.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final, Generic, Literal

from onboard.contract.agility import available_limits
from onboard.contract.arithmetic import SCALAR, Arithmetic
from onboard.contract.clause import Clause
from onboard.contract.derivation import Derived
from onboard.contract.heights import flown_over_clauses, flown_over_from_m
from onboard.contract.terms import Terms
from onboard.files.contract_terms.mover_terms import MoverClass
from onboard.geometry.frames import Q

# The stamp of a frame and the pose that places it may be apart by this (`placement.POSE_TIMING_S`).
STAMP_ERROR_S: Final = 0.01
# The nose points along the leg within this (`guidance.envelope.HEADING_TOLERANCE_RAD`).
NOSE_TOLERANCE_RAD: Final = math.radians(5.0)
# What the cells of the mover-free set take of a range: at the edge of the view, between two cells,
# in the frames that have to show a cell, and in rounding out what is asked about.
RASTER_M: Final = 1.0
# From the operator's word until frames have shown what is ahead, and the nose points along the leg.
FIRST_SIGHT_S: Final = 1.0
# No view is as wide as this: what is required where no view suffices.
NO_VIEW_RAD: Final = 4.0 * math.pi


@dataclass(frozen=True)
class Stop(Generic[Q]):
    """How the vehicle comes to rest from its greatest speed.

    Attributes:
        fixed_m: F, from the reference point to where a measured face may touch the body.
        speed_mps: V_e, greatest speed.
        brake_mps2: b, least deceleration of the way to rest, in any direction.
        lag_s: T.
        rest_settle_s: t_set, from the reference at rest to the vehicle at rest.
        accelerating: a_0 / b, where the vehicle may still accelerate by a_0.
    """

    fixed_m: Q
    speed_mps: Q
    brake_mps2: Q
    lag_s: Q
    rest_settle_s: float
    accelerating: Q

    def time_s(self, reaction_s: Q) -> Q:
        """Return t_s, until the vehicle is at rest, with a time until the setpoint changes."""
        ending_s = self.lag_s * (1.0 + self.accelerating)
        return reaction_s + ending_s + self.speed_mps / self.brake_mps2 + self.rest_settle_s

    def way_m(self, reaction_s: Q) -> Q:
        """Return d_s, the way made until then."""
        ending_s = self.lag_s * (1.0 + self.accelerating)
        v_mps = self.speed_mps
        return v_mps * (reaction_s + ending_s) + v_mps * v_mps / (2.0 * self.brake_mps2)


def stop_of(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Stop[Q]:
    """Return how the vehicle of a contract comes to rest."""
    x_mps2, y_mps2 = available_limits(terms, ops)
    brake_mps2 = ops.minimum(x_mps2, y_mps2)
    speed_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
    return Stop(
        fixed_m=derived.margin_m + terms.tracking_error_m,
        speed_mps=speed_mps,
        brake_mps2=brake_mps2,
        lag_s=terms.attitude_lag_s,
        rest_settle_s=terms.rest_settle_s,
        accelerating=x_mps2 / brake_mps2,
    )


def passive_range_m(stop: Stop[Q], reaction_s: Q, mover_mps: float) -> Q:
    """Return how far away a mover has to be reported at the latest, nearest face (theory M, 1).

    Args:
        stop: of the vehicle.
        reaction_s: from "within range" to the setpoint that brakes.
        mover_mps: v_o.
    """
    stamp_m = (stop.speed_mps + mover_mps) * STAMP_ERROR_S
    fixed_m = stop.fixed_m + stamp_m
    return fixed_m + stop.way_m(reaction_s) + mover_mps * stop.time_s(reaction_s)


def dead_daemon_range_m(terms: Terms[Q], derived: Derived[Q], stop: Stop[Q], mover_mps: float) -> Q:
    """Return the range with which the daemon may die as a mover comes into range.

    The vehicle flies on for the reaction time, and then runs on until the autopilot has stopped it.
    """
    run_s = _run_s(terms, stop)
    # A reference that still accelerates runs on for longer, as it does where it brakes.
    ending_s = stop.lag_s * stop.accelerating
    flown_s = terms.reaction_time_s + ending_s
    stamp_m = (stop.speed_mps + mover_mps) * STAMP_ERROR_S
    return (
        stop.fixed_m
        + stamp_m
        + stop.speed_mps * flown_s
        + derived.manoeuvre_encounter.run_on_m
        + mover_mps * (flown_s + run_s + stop.rest_settle_s)
    )


def all_round_m(
    terms: Terms[Q], derived: Derived[Q], stop: Stop[Q], mover_mps: float, ops: Arithmetic[Q]
) -> Q:
    """Return R_s, how far a ring has to see what the view ahead does not show (theory M, 3).

    Sideways the vehicle drifts; an avoidance that leads aside faster is certified in what the ring
    has shown, and ends in a stop where that is too little.  With best effort the vehicle may fly in
    any direction, also where the nose does not point: there the ring has to see as far as the view
    ahead.
    """
    kappa_s = terms.reaction_time_s + stop.lag_s * (1.0 + stop.accelerating)
    lateral_mps = derived.manoeuvre_encounter.lateral_speed_mps
    stopping_s = ops.maximum(stop.speed_mps, lateral_mps) / stop.brake_mps2
    if terms.passive_safety:  # the daemon may die at any time
        stopping_s = ops.maximum(stopping_s, _run_s(terms, stop))
    aside_m = lateral_mps * kappa_s + lateral_mps * lateral_mps / (2.0 * stop.brake_mps2)
    grown_m = mover_mps * (kappa_s + stop.rest_settle_s + stopping_s)
    stamp_m = (stop.speed_mps + mover_mps) * STAMP_ERROR_S
    half_rad = ops.minimum(_sure_half_view_rad(terms), terms.field_of_view_rad * 0.0 + math.pi / 2)
    ring_m = (stop.fixed_m + stamp_m + grown_m + aside_m) / ops.sin(half_rad)
    if terms.best_effort:
        ring_m = ops.maximum(ring_m, passive_range_m(stop, terms.reaction_time_s, mover_mps))
    # What sees all round as far as it sees ahead needs no other.
    return ops.where(terms.field_of_view_rad >= 2.0 * math.pi - 1e-9, ring_m * 0.0, ring_m)


def in_view_rad(
    terms: Terms[Q], derived: Derived[Q], stop: Stop[Q], mover_mps: float, ops: Arithmetic[Q]
) -> Q:
    """Return the view that shows in a steady cruise who may come near (theory M, 5).

    A vehicle that is less than twice as fast as the mover needs more than any view.
    """
    across_mps = mover_mps + derived.manoeuvre_encounter.lateral_speed_mps
    slow_mps = terms.cruise_speed_mps - terms.velocity_error_x_mps
    reported_m = terms.detection_range_m - (stop.speed_mps + mover_mps) * terms.reaction_time_s
    reported_m = reported_m - RASTER_M
    alpha_rad = _asin(across_mps / _not_zero(slow_mps, ops), ops)
    growing_s = slow_mps / (2.0 * stop.brake_mps2) + stop.rest_settle_s
    if terms.passive_safety:  # where the vehicle is has to stay clear until its run-on has ended
        growing_s = growing_s + _run_s(terms, stop)
    fixed_m = stop.fixed_m + RASTER_M
    aside_m = fixed_m + across_mps * growing_s
    beta_rad = alpha_rad + _asin(aside_m / _not_zero(reported_m, ops), ops)
    view_rad = 2.0 * (beta_rad + NOSE_TOLERANCE_RAD + terms.heading_error_rad)
    # At the edges of the view, movers have to come into range ahead of the body.
    ahead_m = reported_m * ops.sin(math.pi / 2.0 - beta_rad)
    fits = (slow_mps >= 2.0 * across_mps) & (reported_m > aside_m) & (ahead_m > fixed_m)
    return ops.where(fits, view_rad, view_rad * 0.0 + NO_VIEW_RAD)


def start_clear_of_movers_m(terms: Terms[float], derived: Derived[float]) -> float:
    """Return how far around a vehicle that starts without a ring no mover may be.

    Until it cruises, none outside the view may come so near that it cannot go on (theory M, 5).
    """
    stop = stop_of(terms, derived, SCALAR)
    v_mps = max((mover.speed_max_mps for mover in terms.movers), default=0.0)
    stopping_s = stop.time_s(terms.reaction_time_s)
    if terms.passive_safety:
        stopping_s += _run_s(terms, stop)
    starting_s = stop.speed_mps / stop.brake_mps2 + 2.0 * stop.lag_s + FIRST_SIGHT_S
    return stop.fixed_m + RASTER_M + v_mps * (stopping_s + starting_s)


def _run_s(terms: Terms[Q], stop: Stop[Q]) -> Q:
    """Return how long the vehicle runs on after the last setpoint at its greatest speed."""
    if terms.setpoint_loss_run_time_s is not None:
        return terms.setpoint_loss_run_time_s
    return terms.setpoint_loss_timeout_s + stop.lag_s + stop.speed_mps / stop.brake_mps2


def stoppable_m(terms: Terms[Q], stop: Stop[Q], tick_s: float) -> Q:
    """Return the way ahead that "brake now" needs before a region, errors of the speed included."""
    v_mps = stop.speed_mps
    return v_mps * (terms.attitude_lag_s + tick_s) + v_mps * v_mps / (2.0 * stop.brake_mps2)


def _sure_half_view_rad(terms: Terms[Q]) -> Q:
    return terms.sure_view_rad / 2.0 - NOSE_TOLERANCE_RAD


def _not_zero(value: Q, ops: Arithmetic[Q]) -> Q:
    return ops.maximum(value, value * 0.0 + 1e-9)


def _asin(sine: Any, ops: Arithmetic[Any]) -> Any:
    square = 1.0 - sine * sine
    return ops.atan2(sine, ops.sqrt(ops.maximum(square, square * 0.0)))


# ---------------------------------------------------------------------- clauses and levels


def mover_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q], tick_s: float
) -> tuple[Clause[Q], ...]:
    """Return the clauses of the level that the contract requires; none if it requires none."""
    if terms.movers_level == "none":
        return ()
    if not terms.movers_meet:
        return flown_over_clauses(terms)
    found = [class_clauses(terms, derived, ops, tick_s, mover) for mover in terms.movers]
    return tuple(chain(*found, _stoppable_clauses(terms, derived, ops, tick_s)))


def class_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q], tick_s: float, mover: MoverClass
) -> list[Clause[Q]]:
    """Return the clauses of one class, as many as its level has, or as `passive` where none is."""
    stop, v_mps, kind = stop_of(terms, derived, ops), mover.speed_max_mps, mover.kind
    silent_s = terms.frame_age_max_s + tick_s
    front = [
        (
            f"passive_range.{kind}",
            passive_range_m(stop, terms.reaction_time_s, v_mps),
            "the vehicle must be at rest before a mover that comes into range can be there",
        ),
        (
            f"passive_silence.{kind}",
            passive_range_m(stop, silent_s, v_mps),
            "the vehicle must be at rest in time also when the sensor falls silent",
        ),
    ]
    if terms.passive_safety:
        front.append(
            (
                f"passive_dead_daemon.{kind}",
                dead_daemon_range_m(terms, derived, stop, v_mps),
                "the autopilot must stop the vehicle in time if the daemon dies",
            )
        )
    found = [
        Clause(name, required + RASTER_M, terms.detection_range_m, "m", reason)
        for name, required, reason in front
    ]
    return found + _beside_clauses(terms, derived, stop, mover, ops)


def _beside_clauses(
    terms: Terms[Q], derived: Derived[Q], stop: Stop[Q], mover: MoverClass, ops: Arithmetic[Q]
) -> list[Clause[Q]]:
    """Return what is required against who comes from beside or behind."""
    v_mps, kind, to_deg = mover.speed_max_mps, mover.kind, 180.0 / math.pi
    if terms.movers_level == "passive_in_view":
        in_view = Clause(
            f"passive_in_view.{kind}",
            in_view_rad(terms, derived, stop, v_mps, ops) * to_deg,
            terms.field_of_view_rad * to_deg,
            "°",
            "in a steady cruise, who comes near must have come into range within the view",
        )
        return [in_view]
    if terms.all_round_range_m is None or not ops.anywhere(terms.all_round_range_m > 0.0):
        return []
    ring = Clause(
        f"all_round.{kind}",
        all_round_m(terms, derived, stop, v_mps, ops) + RASTER_M,
        terms.all_round_range_m,
        "m",
        "who comes from beside or behind must be seen before the vehicle cannot rest",
    )
    return [ring]


def _stoppable_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q], tick_s: float
) -> tuple[Clause[Q], ...]:
    if not terms.passive_safety:
        return ()
    return (
        Clause(
            "stoppable",
            stoppable_m(terms, stop_of(terms, derived, ops), tick_s),
            derived.manoeuvre_encounter.run_on_m,
            "m",
            "braking for a mover must end before a region whose avoidance is begun",
            concerns="progress",
        ),
    )


@dataclass(frozen=True)
class Level:
    """What a contract promises against one class of movers, whether or not it requires it.

    Attributes:
        mover: the class.
        level: ``"passive"``, ``"passive in view"``, ``"flown over"``, or None if it is not covered.
        front_m: range ahead that its clauses require; 0 beside heights, where none suffices.
        ring_m: all-round range that they require; likewise.
        view_deg: view that `passive in view` requires; None where none suffices.
        above_m: height of the mission from which on it is flown over, where heights are declared;
            infinite where it may be at any height; None where obstacles count as pillars.
    """

    mover: MoverClass
    level: Literal["passive", "passive in view", "flown over"] | None
    front_m: float
    ring_m: float
    view_deg: float | None
    above_m: float | None = None

    @property
    def brief(self) -> str:
        """Class and level: "drone 15 m/s: NOT COVERED, needs 25.0 m ahead and 9.1 m all round"."""
        if self.above_m is None:
            needs = f"needs {self.front_m:.1f} m ahead and {self.ring_m:.1f} m all round"
        elif math.isinf(self.above_m):
            needs = "it may come from above or below the vertical view"
        else:
            needs = f"needs a mission above {self.above_m:.2f} m"
        level = self.level or f"NOT COVERED, {needs}"
        return f"{self.mover.kind} {self.mover.speed_max_mps:g} m/s: {level}"

    def __str__(self) -> str:
        """Say it with its conditions, as an operator reads it."""
        if self.level is None:
            return self.brief
        if self.above_m is not None:
            return f"{self.brief}, above {self.above_m:.2f} m"
        hides = self.mover.hidden or self.level == "passive in view"
        hidden = "" if hides else ", if none hides behind an obstacle"
        in_view = ", from the operator's word at the start, in a steady cruise"
        return f"{self.brief}{in_view if self.level != 'passive' else ''}{hidden}"


def levels(terms: Terms[float], derived: Derived[float], tick_s: float) -> tuple[Level, ...]:
    """Return what the contract promises against each class that it declares."""
    return tuple(_level(terms, derived, tick_s, mover) for mover in terms.movers)


def _can_be_required(terms: Terms[float]) -> bool:
    """Tell whether nothing but classes and sensors speaks against requiring passive safety."""
    frozen = terms.passive_safety and terms.setpoint_loss_model == "frozen"
    return (
        terms.stop
        and terms.rest_settle_s > 0.0
        and not (frozen and terms.setpoint_loss_run_time_s is None)
    )


def _level(terms: Terms[float], derived: Derived[float], tick_s: float, mover: MoverClass) -> Level:
    if terms.radius_z_m is not None:
        return _level_over(terms, mover)
    stop, v_mps = stop_of(terms, derived, SCALAR), mover.speed_max_mps
    found = class_clauses(terms, derived, SCALAR, tick_s, mover)
    front = [each for each in found if not each.name.startswith(("all_round", "passive_in_view"))]
    ring_m = all_round_m(terms, derived, stop, v_mps, SCALAR) + RASTER_M
    view_rad = in_view_rad(terms, derived, stop, v_mps, SCALAR)
    sees_all = terms.field_of_view_rad >= 2.0 * math.pi - 1e-9
    level: Literal["passive", "passive in view"] | None = None
    if _can_be_required(terms) and all(clause.holds for clause in front):
        in_view_only = terms.movers_level == "passive_in_view"
        if not in_view_only and (sees_all or (terms.all_round_range_m or 0.0) > ring_m):
            level = "passive"
        elif terms.field_of_view_rad > view_rad and not terms.best_effort:
            level = "passive in view"
    return Level(
        mover,
        level,
        max(clause.required for clause in front),
        0.0 if sees_all else ring_m,
        math.degrees(view_rad) if view_rad < NO_VIEW_RAD else None,
    )


def _level_over(terms: Terms[float], mover: MoverClass) -> Level:
    """Return what is promised beside heights: what is flown over, or nothing."""
    above_m = math.inf
    if mover.top_max_m is not None:
        above_m = flown_over_from_m(terms, mover.top_max_m)
    holds = terms.mission_altitude_m is not None and terms.mission_altitude_m > above_m
    holds = holds and terms.height_drift_flight_m is not None and _can_be_required(terms)
    return Level(mover, "flown over" if holds else None, 0.0, 0.0, None, above_m)
