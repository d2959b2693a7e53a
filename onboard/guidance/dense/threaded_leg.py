"""What belongs to one leg in THREAD and PAUSE: limits, the end, and what plans the way there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from onboard.guidance.dense.limits import rest_limits_of, shown_half_view_rad
from onboard.guidance.dense.pause import Pause
from onboard.guidance.dense.sliced_planning import SlicedPlanning
from onboard.guidance.dense.stop_and_sidestep import StopAndSidestep, looks_before_sidestep_rad
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.planning.corridor.guide import Guide

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.box import Box
    from onboard.guidance.dense.way_to_rest import WayToRest
    from onboard.guidance.situation import Situation
    from onboard.planning.rest_certifier import RestLimits

# The vehicle has arrived where it rests this near to the leg's end.
ARRIVED_M: Final = 0.3
NO_END: Final = Violation(
    Assumption.LEG_END_CLEAR,
    0.0,
    1.0,
    "places",
    sentence="an obstacle covers the end of the leg, and each place where it may end",
)
_STEP_M: Final = 0.2
# The cells of the seen-free set take so much from a gap.
_CELLS_M: Final = 0.15
# Beside where an avoidance has led there is this much room for another way.
_BESIDE_M: Final = 1.0


class ThreadedLeg(NamedTuple):
    """What belongs to the leg that is flown, and to where it is to end.

    Attributes:
        limits: what a way to rest may ask for.
        planning: of ways to rest.
        pause: counts the pauses.
        manoeuvre: stop, look, sidestep, go.
        end_leg_m: (x, y) where the leg is to end.
        beside_m: how far beside its line it has been flown before THREAD took it over.
        half_width_m: how far beside its line it may be flown.
    """

    limits: RestLimits
    planning: SlicedPlanning
    pause: Pause
    manoeuvre: StopAndSidestep
    end_leg_m: tuple[float, float]
    beside_m: float
    half_width_m: float


def leg_to(
    end_leg_m: tuple[float, float],
    situation: Situation,
    way: WayToRest,
    frames_needed: int,
    beside_m: float = 0.0,
) -> ThreadedLeg:
    """Return what flies the situation's leg to a place.

    Args:
        end_leg_m: (x, y) of the place.
        situation: what is flown.
        way: the way to rest that is held.
        frames_needed: frames that have to show a cell free.
        beside_m: how far beside its line the leg has been flown so far.
    """
    assessment, route = situation.assessment, situation.route
    half_width_m = _half_width_m(situation, beside_m)
    terms, margin_m = assessment.terms, assessment.inflation_m()
    limits = rest_limits_of(assessment, any_heading=route.mission.heading == "path")
    guide = Guide(
        end_leg_m,
        margin_m,
        half_width_m,
        face_error_m=assessment.face_error_m,
        wish_m=assessment.contract.vehicle.clearance_wish_m,
    )
    manoeuvre = StopAndSidestep(
        situation.reference,
        way,
        limits,
        margin_m=margin_m,
        goal_leg_m=end_leg_m,
        looks_rad=looks_before_sidestep_rad(
            shown_half_view_rad(assessment), terms.radius_m, terms.tracking_error_m
        ),
        frames_needed=frames_needed,
    )
    pause = Pause(situation.reference, guide)
    planning = SlicedPlanning(guide, limits)
    return ThreadedLeg(limits, planning, pause, manoeuvre, end_leg_m, beside_m, half_width_m)


def _half_width_m(situation: Situation, beside_m: float) -> float:
    """Return how far beside its line a leg may be flown.

    Without a stated corridor an avoidance may have led farther than best effort would.
    """
    leg = situation.route.leg
    room_m = situation.assessment.inflation_m() + _BESIDE_M
    stated = leg.corridor_half_width_m is not None
    return max(leg.threading_half_width_m, 0.0 if stated else beside_m + room_m)


def with_free_end(
    leg: ThreadedLeg, situation: Situation, way: WayToRest, frames_needed: int
) -> ThreadedLeg | None:
    """Return what flies the leg to a free place beside its end, if an obstacle covers that.

    Args:
        leg: what flies it now; returned as it is if its end is free as far as is known.
        situation: what is flown.
        way: the way to rest that is held.
        frames_needed: frames that have to show a cell free.

    Returns:
        None if known obstacles cover every place where the mission lets the leg end.
    """
    boxes = [obstacle.measured for obstacle in situation.obstacles]
    margin_m, route = situation.assessment.inflation_m(), situation.route
    if not is_blocked(leg.end_leg_m, boxes, margin_m):
        return leg
    half_width_m = min(
        route.leg.target_half_width_m - ARRIVED_M,
        leg.half_width_m - leg.limits.body_radius_m,
    )
    for grown_m in (margin_m + _CELLS_M, margin_m):
        place_leg_m = end_beside((route.length_m, 0.0), boxes, grown_m, half_width_m)
        if place_leg_m is not None:
            other = leg_to(place_leg_m, situation, way, frames_needed, leg.beside_m)
            other.pause.count = leg.pause.count
            return other
    return None


def is_blocked(place_leg_m: tuple[float, float], boxes: Sequence[Box], margin_m: float) -> bool:
    """Tell whether a known obstacle, grown by a margin, covers a place."""
    x_m, y_m = place_leg_m
    return any(
        box.x_min_m - margin_m < x_m < box.x_max_m + margin_m
        and box.y_min_m - margin_m < y_m < box.y_max_m + margin_m
        for box in boxes
    )


def end_beside(
    end_leg_m: tuple[float, float], boxes: Sequence[Box], margin_m: float, half_width_m: float
) -> tuple[float, float] | None:
    """Return the place nearest to the end of a leg that no known obstacle covers.

    Args:
        end_leg_m: (x, y).
        boxes: known obstacles, leg frame.
        margin_m: that they are grown by.
        half_width_m: how far from the end on each axis the leg may end.

    Returns:
        None if they cover every place.
    """
    steps = math.floor(half_width_m / _STEP_M)
    offsets_m = _STEP_M * np.arange(-steps, steps + 1)
    x_m, y_m = (offsets_m[:, None] + end_leg_m[0], offsets_m[None, :] + end_leg_m[1])
    free = np.ones((offsets_m.size, offsets_m.size), bool)
    for box in boxes:
        beside = (x_m <= box.x_min_m - margin_m) | (x_m >= box.x_max_m + margin_m)
        free &= beside | (y_m <= box.y_min_m - margin_m) | (y_m >= box.y_max_m + margin_m)
    if not free.any():
        return None
    apart_m = np.where(free, np.hypot(offsets_m[:, None], offsets_m[None, :]), math.inf)
    i, j = np.unravel_index(int(apart_m.argmin()), apart_m.shape)
    return float(x_m[i, 0]), float(y_m[0, j])
