"""The clauses of a contract: what is required, what is declared, and why."""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.agility import thrust_to_weight_at_corner, tilt_limits
from onboard.contract.arithmetic import Arithmetic
from onboard.contract.clause import Clause
from onboard.contract.derivation import Derived, separation_m
from onboard.contract.emergence import emergence_clauses
from onboard.contract.heights import ground_below_m, view_needed_rad
from onboard.contract.mover_avoidance import avoidance_clauses
from onboard.contract.movers import mover_clauses
from onboard.contract.recentring import Drift, drift_of, required_view
from onboard.contract.terms import Terms
from onboard.geometry.frames import Q

__all__ = ["PROGRESS_CLAUSES", "TICK_S", "Clause", "clauses", "recentring_drift"]

# Clauses that decide whether an obstacle is passed, not whether it is touched, wherever only what
# was seen free is flown into (`requirements.stop`).
PROGRESS_CLAUSES: Final = frozenset(
    {
        "detection_range",
        "edge_visibility",
        "field_of_view",
        "sensor_silence",
        "recentring",
        "separation",
        "top_visibility",
    }
)

# The least view in which a look to both sides shows the way beside an obstacle; it suffices itself.
SEEN_FREE_VIEW_DEG: Final = 90.0 - 1e-6
# The daemon decides at this period; a silent sensor is noticed up to one tick late.
TICK_S = 0.02


def clauses(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> tuple[Clause[Q], ...]:
    """Every requirement of the contract, in the order in which an operator reads them."""
    separation = Clause(
        "separation",
        separation_m(terms, derived, ops),
        terms.obstacle_separation_min_m,
        "m",
        "the region of influence of an obstacle must be free of any other",
    )
    found = (
        _agility_clauses(terms, ops)
        + _wind_clauses(terms, ops)
        + _sensor_clauses(terms, derived, ops)
        + _stopping_clauses(terms, derived)
        + _passive_safety_clauses(terms, derived, ops)
        + _recentring_clauses(terms, derived, ops)
        + _height_clauses(terms)
        + _view_of_heights_clauses(terms, derived, ops)
        + _seen_free_clauses(terms)
        + mover_clauses(terms, derived, ops, TICK_S)
        + emergence_clauses(terms, derived, ops)
        + avoidance_clauses(terms, derived, ops)
        + (separation,)
    )
    if not terms.stop:
        return found
    return tuple([_concerning(clause) for clause in found])


def _concerning(clause: Clause[Q]) -> Clause[Q]:
    """Return a clause with what it concerns (`PROGRESS_CLAUSES`)."""
    if clause.name not in PROGRESS_CLAUSES:
        return clause
    # This takes a fraction of what `_replace` takes.
    return Clause._make((*clause[:-1], "progress"))


def _agility_clauses(terms: Terms[Q], ops: Arithmetic[Q]) -> tuple[Clause[Q], ...]:
    return (
        Clause(
            "thrust",
            thrust_to_weight_at_corner(terms, ops),
            terms.thrust_to_weight,
            "T/W",
            "height must be held at the roll and pitch limits together",
        ),
    )


def _wind_clauses(terms: Terms[Q], ops: Arithmetic[Q]) -> tuple[Clause[Q], ...]:
    if terms.wind_max_mps is None:
        return ()
    return (
        Clause(
            "wind",
            terms.trim_mps2,
            ops.minimum(*tilt_limits(terms, ops)),
            "m/s²",
            "tilting against the strongest declared wind must leave tilt to avoid with",
        ),
    )


def _height_clauses(terms: Terms[Q]) -> tuple[Clause[Q], ...]:
    if terms.mission_altitude_m is None:
        return ()
    clearance = Clause(
        "ground_clearance",
        terms.radius_m + terms.tracking_error_z_m + terms.estimator_reset_max_m,
        terms.mission_altitude_m,
        "m",
        "the mission must be flown high enough to stay clear of the ground",
    )
    if terms.terrain_max_m is None and terms.radius_z_m is None:
        return (clearance,)
    terrain = Clause(
        "terrain",
        ground_below_m(terms),
        terms.mission_altitude_m,
        "m",
        "the mission must be flown clear of the highest ground, drift and its error included",
    )
    return clearance, terrain


def _view_of_heights_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    needed_rad = view_needed_rad(terms, derived, ops)
    if needed_rad is None or terms.view_up_rad is None or terms.view_down_rad is None:
        return ()
    return (
        Clause(
            "top_visibility",
            needed_rad * (180.0 / math.pi),
            ops.minimum(terms.view_up_rad, terms.view_down_rad) * (180.0 / math.pi),
            "°",
            "what reaches into the heights flown at must be seen, up and down, before it is near",
        ),
    )


def _sensor_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    ahead_m = derived.required_detection_range_m - derived.encounter.run_on_m
    edge_m = derived.edge_offset_m
    seen_at_m = ahead_m
    if not terms.stops:
        # The far corner is seen best from where it comes into range, and remembered.
        square_m2 = terms.detection_range_m * terms.detection_range_m - edge_m * edge_m
        seen_at_m = ops.sqrt(ops.maximum(square_m2, square_m2 * 0.0))
    return (
        Clause(
            "detection_range",
            ahead_m,
            terms.detection_range_m,
            "m",
            "an obstacle must be seen before the last point where avoiding it is possible",
        ),
        Clause(
            "edge_visibility",
            _slant(ahead_m, edge_m, ops),
            terms.detection_range_m,
            "m",
            "what decides whether and where to pass must be seen in time",
        ),
        Clause(
            "field_of_view",
            2.0 * (ops.atan2(edge_m, seen_at_m) + terms.heading_error_rad) * (180.0 / math.pi),
            terms.field_of_view_rad * (180.0 / math.pi),
            "°",
            "what must be seen ahead must lie within the sensor's field of view",
        ),
    )


def _seen_free_clauses(terms: Terms[Q]) -> tuple[Clause[Q], ...]:
    """Return what a vehicle needs that flies into nothing but the space seen free (theory L)."""
    if not terms.stop:
        return ()
    return (
        Clause(
            "seen_free_view",
            SEEN_FREE_VIEW_DEG + 2.0 * terms.heading_error_rad * (180.0 / math.pi),
            terms.field_of_view_rad * (180.0 / math.pi),
            "°",
            "a look aside at rest must show the way beside an obstacle",
        ),
    )


def _slant(ahead_m: Q, aside_m: Q, ops: Arithmetic[Q]) -> Q:
    return ops.sqrt(ahead_m * ahead_m + aside_m * aside_m)


def _stopping_clauses(terms: Terms[Q], derived: Derived[Q]) -> tuple[Clause[Q], ...]:
    if not terms.stop:
        return ()
    e = derived.encounter
    fixed_m = derived.margin_m + terms.tracking_error_m
    stop_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2) + e.speed_mps * e.attitude_lag_s
    return (
        Clause(
            "stop",
            fixed_m + stop_m + e.speed_mps * e.reaction_time_s,
            terms.detection_range_m,
            "m",
            "braking to hover in front of an obstacle must be possible once it is seen",
        ),
        Clause(
            "sensor_silence",
            fixed_m + stop_m + e.speed_mps * (terms.frame_age_max_s + TICK_S),
            terms.detection_range_m,
            "m",
            "when the sensor falls silent, braking must end within what was last seen",
        ),
    )


def _passive_safety_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    if not terms.passive_safety:
        return ()
    return (
        Clause(
            "passive_safety",
            _slant(derived.required_detection_range_m, derived.edge_offset_m, ops),
            terms.detection_range_m,
            "m",
            "an obstacle must be seen early enough to avoid a collision even if the daemon dies",
        ),
    )


def recentring_drift(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Drift[Q]:
    """Return the drift back to the leg line: its slope, and the room that it needs (theory F)."""
    silent_s = terms.frame_age_max_s + TICK_S
    return drift_of(
        derived.manoeuvre_encounter,
        speed_min_mps=terms.cruise_speed_mps - terms.velocity_error_x_mps,
        margin_m=derived.margin_m + terms.tracking_error_m,
        notice_s=ops.maximum(terms.reaction_time_s, silent_s),
        ops=ops,
    )


def _recentring_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    wanted = terms.recentring_speed_mps > 0.0
    if not ops.anywhere(wanted):
        return ()
    view_rad = required_view(recentring_drift(terms, derived, ops), terms.detection_range_m, ops)
    view_rad = view_rad + 2.0 * terms.heading_error_rad
    return (
        Clause(
            "recentring",
            ops.where(wanted, view_rad, view_rad * 0.0) * (180.0 / math.pi),
            terms.field_of_view_rad * (180.0 / math.pi),
            "°",
            "what the vehicle drifts towards on its way back to the leg must have been seen before",
        ),
    )
