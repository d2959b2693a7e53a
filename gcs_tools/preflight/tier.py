"""The three verdicts on a flight, and what safety rests on where arrival is not guaranteed.

Clauses alone decide.  Where all hold, every obstacle is passed.  Where some of those fail that only
progress needs, the vehicle still never flies into what it has not seen free: at every instant it
holds a certified way to rest inside seen-free space (THEORY.md, "Stop and sidestep").  That needs
``requirements.stop``, the contract's clause ``seen_free_view``, and the rules below, without which
it could hardly move.
"""

from __future__ import annotations

import enum
import math
from dataclasses import replace
from typing import Final

import numpy as np

from gcs_tools.preflight.rule import Rule
from onboard.contract.assessment import Assessment, assess_terms
from onboard.contract.movers import start_clear_of_movers_m
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from onboard.perception.heights import level_blind_m

# At this speed the vehicle still gets on.
SLOW_MPS: Final = 0.5
# Beyond the body's square where it first hovers: cells of the grid, and room to begin.
START_ROOM_M: Final = 0.3


class Tier(enum.Enum):
    """The verdict on a flight."""

    PROGRESS_GUARANTEED = "progress guaranteed"
    SAFE = "safe, arrival not guaranteed"
    DO_NOT_FLY = "do not fly"
    UNKNOWN = "could not be checked"


def start_clear_radius_m(assessment: Assessment) -> float:
    """Return the radius that must be free of obstacles around the place of the first hover.

    Where obstacles are no pillars, a level sensor sees all of the heights flown at only from
    farther away on.
    """
    body_m = assessment.terms.body_m * math.sqrt(2.0)
    return max(body_m, level_blind_m(assessment.terms)) + START_ROOM_M


def seen_free_rules(
    assessment: Assessment, obstacles: ObstacleField | None, mission: Mission | None
) -> tuple[Rule, ...]:
    """Return the rules that safety without the progress clauses needs.

    None applies with ``requirements.stop: false``: then safety rests on every clause.

    Args:
        assessment: of the contract.
        obstacles: the known field, if there is one; the start is checked against it.
        mission: says where the flight starts.
    """
    if not assessment.terms.stop:
        return ()
    rules: tuple[Rule, ...] = (_range(assessment),)
    # A look all round tells less than the word where not all heights are in view nearby.
    needed = assessment.terms.radius_z_m is not None
    if mission is not None and (mission.start_clear_m is not None or needed):
        rules = (*rules, _start_word(assessment, mission.start_clear_m or 0.0))
    if obstacles is None or mission is None:
        return rules
    return (*rules, _start_room(assessment, obstacles, mission))


def words_on_movers(assessment: Assessment, mission: Mission) -> tuple[Rule, ...]:
    """Return what the operator has to say of movers, where no sensor sees all round (theory M)."""
    if assessment.terms.movers_level != "passive_in_view":
        return ()
    needed_m = start_clear_of_movers_m(assessment.terms, assessment.inflated)
    stated_m = mission.start_clear_of_movers_m or 0.0
    word = Rule(
        "start_clear_of_movers",
        needed_m,
        stated_m,
        "m",
        f"mission.start_clear_of_movers_m is {stated_m:g} m, needed {needed_m:.1f} m: by granting "
        "control you say that no mover is so near; nothing else tells of those outside the view",
        concerns="safety",
    )
    return (word,)


def _range(assessment: Assessment) -> Rule:
    terms = assessment.terms
    slow_mps = min(SLOW_MPS, terms.cruise_speed_mps)
    slow = assess_terms(assessment.contract, replace(terms, cruise_speed_mps=slow_mps))
    return Rule(
        "seen_free_range",
        slow.inflated.region.front_m,
        terms.detection_range_m - assessment.face_error_m - terms.body_m,
        "m",
        f"at {slow_mps:g} m/s the vehicle must stop, or run on, within what is seen free ahead",
        concerns="safety",
    )


def _start_word(assessment: Assessment, start_clear_m: float) -> Rule:
    return Rule(
        "start_clear",
        start_clear_radius_m(assessment),
        start_clear_m,
        "m",
        "the operator's word: mission.start_clear_m around the first hover nothing stands",
        concerns="safety",
    )


def _start_room(assessment: Assessment, obstacles: ObstacleField, mission: Mission) -> Rule:
    distances_m = face_distances_m(obstacles, mission.start_ned_m)
    required_m = start_clear_radius_m(assessment)
    near = np.flatnonzero(distances_m < required_m)
    return Rule(
        "start_room",
        required_m,
        float(distances_m.min(initial=math.inf)),
        "m",
        "no obstacle may stand near the place of the first hover, which no sensor has seen free",
        tuple(f"{obstacles.ids[index]}: {distances_m[index]:.2f} m" for index in near.tolist()),
        concerns="safety",
    )


def face_distances_m(obstacles: ObstacleField, point_ned_m: tuple[float, float]) -> FloatArray:
    """Return the distance of a point from the nearest face of each obstacle, (N,); 0 inside."""
    offset_m = np.asarray(point_ned_m) - obstacles.center_ned_m
    cosine, sine = np.cos(obstacles.yaw_rad), np.sin(obstacles.yaw_rad)
    along_m = cosine * offset_m[:, 0] + sine * offset_m[:, 1]
    across_m = -sine * offset_m[:, 0] + cosine * offset_m[:, 1]
    outside_m = np.abs(np.column_stack((along_m, across_m))) - obstacles.half_size_m
    distances_m: FloatArray = np.hypot(*np.maximum(outside_m, 0.0).T)
    return distances_m
