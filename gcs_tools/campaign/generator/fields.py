"""Random obstacle fields: along a leg as the contract allows, head-on, or breaking one rule."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from gcs_tools.scenario import Scenario
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract
from onboard.files.obstacle_field import Obstacle, ObstacleField

# Most way that is left before the first obstacle may be avoided.
_START_ROOM_M: Final = 4.0
Breach = Literal["larger", "closer", "range", "speed"]


def obstacles_along_leg(
    draw: random.Random, contract: Contract, heading_rad: float, length_m: float
) -> ObstacleField:
    """Draw obstacles one after another, each about as near to the last as the contract allows."""
    assessment = assess(contract)
    derived = assessment.inflated
    separation_m = contract.environment.separation_any_way_m
    half_m = contract.environment.obstacle_size_max_m / 2.0
    before_m, behind_m = clear_lengths_m(assessment)
    along_m = before_m + draw.uniform(0.5, _START_ROOM_M)
    last_m = length_m - behind_m - 0.5
    placed: list[Obstacle] = []
    while along_m < last_m:
        # Head-on half of the time; else anywhere up to just beside the vehicle's path.
        reach_m = draw.choice((0.2, 1.0)) * (half_m + derived.margin_m)
        centre_m = (along_m, draw.uniform(-reach_m, reach_m))
        placed.append(_obstacle(draw, contract, heading_rad, centre_m, str(len(placed))))
        along_m += separation_m * draw.choice((1.05, draw.uniform(1.05, 1.6)))
    return ObstacleField.of(placed)


def clear_lengths_m(assessment: Assessment) -> tuple[float, float]:
    """Return the way before and behind an obstacle's centre on which it may be avoided, in metres.

    No leg may start or end there.
    """
    derived, terms = assessment.inflated, assessment.terms
    half_m = terms.obstacle_size_max_m / 2.0 + derived.margin_m
    before_m = max(derived.region.front_m, derived.manoeuvre.front_m) + half_m
    return before_m, max(derived.manoeuvre.pob_depth_m - terms.body_m, half_m)


def one_obstacle_fits(assessment: Assessment, length_m: float) -> bool:
    """Tell whether a leg of this length takes an obstacle wherever the draw puts it."""
    before_m, behind_m = clear_lengths_m(assessment)
    return before_m + _START_ROOM_M + behind_m + 0.5 < length_m


def _obstacle(
    draw: random.Random,
    contract: Contract,
    heading_rad: float,
    centre_leg_m: tuple[float, float],
    name: str,
) -> Obstacle:
    """Draw a box, turned or not; a third of them fill S_max in the leg frame."""
    turn_rad = draw.choice((0.0, draw.uniform(0.0, math.pi / 2.0)))
    aspect = draw.uniform(0.2, 1.0)
    sides = draw.choice(((1.0, aspect), (aspect, 1.0), (1.0, 1.0)))
    cosine, sine = abs(math.cos(turn_rad)), abs(math.sin(turn_rad))
    extent = max(cosine * sides[0] + sine * sides[1], sine * sides[0] + cosine * sides[1])
    size_max_m = contract.environment.obstacle_size_max_m
    size_m = size_max_m * draw.choice((1.0, draw.uniform(0.1, 1.0), draw.uniform(0.5, 1.0)))
    scale_m = size_m / extent
    return Obstacle(
        id=name,
        center_ned_m=ned_m(heading_rad, *centre_leg_m),
        size_m=(sides[0] * scale_m, sides[1] * scale_m),
        yaw_deg=math.degrees(heading_rad + turn_rad),
    )


def head_on_field(scenario: Scenario) -> ObstacleField:
    """Return the first obstacle alone: square to the leg, centred on it, and of size S_max."""
    end_north_m, end_east_m = scenario.mission.legs[0].end_ned_m
    heading_rad = math.atan2(end_east_m, end_north_m)
    north_m, east_m = scenario.obstacles.center_ned_m[0]
    along_m = north_m * math.cos(heading_rad) + east_m * math.sin(heading_rad)
    size_m = scenario.contract.environment.obstacle_size_max_m
    return ObstacleField.of(
        [
            Obstacle(
                id="0",
                center_ned_m=ned_m(heading_rad, along_m, 0.0),
                size_m=(size_m, size_m),
                yaw_deg=math.degrees(heading_rad),
            )
        ]
    )


def with_breaching_field(draw: random.Random, scenario: Scenario, breach: Breach) -> Scenario:
    """Make the first obstacle too large, or put a neighbour into its region.

    The vehicle still starts outside every region.
    """
    field = scenario.obstacles
    size_max_m = scenario.contract.environment.obstacle_size_max_m
    if breach == "larger":
        # A box with such sides exceeds S_max at any yaw.
        side_m = size_max_m * draw.uniform(1.2, 3.0)
        half_size_m, center_ned_m = field.half_size_m.copy(), field.center_ned_m.copy()
        half_size_m[0] = side_m / 2.0
        center_ned_m[0] *= 1.0 + side_m / math.hypot(*center_ned_m[0])
        field = replace(field, half_size_m=half_size_m, center_ned_m=center_ned_m)
    else:
        apart_m = draw.uniform(0.3, 0.7) * scenario.contract.environment.separation_any_way_m
        north_m, east_m = field.center_ned_m[0].tolist()
        end_north_m, end_east_m = scenario.mission.legs[0].end_ned_m
        turn_rad = draw.uniform(-math.pi / 3.0, math.pi / 3.0)
        beside_m = ned_m(math.atan2(end_east_m, end_north_m) + turn_rad, apart_m, 0.0)
        neighbour = ObstacleField.of(
            [
                Obstacle(
                    id="neighbour",
                    center_ned_m=(north_m + beside_m[0], east_m + beside_m[1]),
                    size_m=(size_max_m / 2.0, size_max_m / 2.0),
                )
            ]
        )
        field = ObstacleField(
            (*field.ids, *neighbour.ids),
            np.vstack((field.center_ned_m, neighbour.center_ned_m)),
            np.vstack((field.half_size_m, neighbour.half_size_m)),
            np.append(field.yaw_rad, neighbour.yaw_rad),
        )
    return replace(scenario, obstacles=field, field_known=False)


def ned_m(heading_rad: float, along_m: float, across_m: float) -> tuple[float, float]:
    """Turn a vector in the leg frame into north and east."""
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    return cosine * along_m - sine * across_m, sine * along_m + cosine * across_m
