"""Fields for an adversary: obstacles as near to one another, and to the way, as is allowed."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from gcs_tools.campaign.adversary.genes import Genes
from gcs_tools.campaign.generator.fields import clear_lengths_m, ned_m
from gcs_tools.preflight.tier import start_clear_radius_m
from onboard.contract.assessment import Assessment
from onboard.files.obstacle_field import Obstacle, ObstacleField

# A second obstacle stands this much farther than the declared separation, for round-off.
_HAIR: Final = 1.0 + 1e-9
_LANE_MAX_M: Final = 42.0
_ROOM_M: Final = 1.0
_WALL_M: Final = 0.3


class Course(NamedTuple):
    """A field and the legs through it, from the origin.

    Attributes:
        obstacles: the field.
        ends_ned_m: end of each leg.
        heading_rad: of the first leg.
        half_width_m: of the corridor at the end of each leg.
    """

    obstacles: ObstacleField
    ends_ned_m: tuple[tuple[float, float], ...]
    heading_rad: float
    half_width_m: float


def course_of(genes: Genes, assessment: Assessment, kind: str) -> Course | None:
    """Draw the course of a kind; None where it does not fit."""
    heading_rad = genes.uniform("heading", -math.pi, math.pi)
    match kind:
        case "lane":
            return _lane(genes, assessment, heading_rad)
        case "corner":
            return _corner(genes, assessment, heading_rad)
    return _forest(genes, assessment, heading_rad)


def _lane(genes: Genes, assessment: Assessment, heading_rad: float) -> Course | None:
    """Draw one or two obstacles along a leg, the second at the declared separation exactly."""
    before_m, behind_m = clear_lengths_m(assessment)
    derived, size_m = assessment.inflated, assessment.terms.obstacle_size_max_m
    reach_m = size_m / 2.0 + derived.margin_m
    first_m = before_m + 0.2 + genes.uniform("along_0", 0.0, _ROOM_M)
    centres_m = [(first_m, reach_m * genes.uniform("across_0", -1.0, 1.0))]
    if genes.choice("obstacles", (1, 2, 2)) == 2:
        centres_m.append(_second(genes, assessment, centres_m[0]))
    length_m = max(along_m for along_m, _ in centres_m) + behind_m + 0.6
    if length_m > _LANE_MAX_M or min(along_m for along_m, _ in centres_m) < before_m:
        return None
    placed = [
        _box(genes, number, heading_rad, centre_m, size_m)
        for number, centre_m in enumerate(centres_m)
    ]
    half_width_m = 2.0 * size_m + derived.roi_width_m + 2.0
    end_ned_m = ned_m(heading_rad, length_m, 0.0)
    return Course(ObstacleField.of(placed), (end_ned_m,), heading_rad, half_width_m)


def _second(
    genes: Genes, assessment: Assessment, first_m: tuple[float, float]
) -> tuple[float, float]:
    """Return the centre of a neighbour: in any direction, or beside or behind by a pair."""
    environment = assessment.contract.environment
    pair_m = environment.separation_box_m
    if pair_m is None:
        apart_m = environment.separation_any_way_m * _HAIR
        turn_rad = genes.uniform("along_1", -math.pi / 2.0, math.pi / 2.0)
        along_m, across_m = apart_m * math.cos(turn_rad), apart_m * math.sin(turn_rad)
    elif genes.choice("beside", (True, False)):
        side = genes.choice("side", (-1.0, 1.0))
        along_m, across_m = genes.uniform("along_1", 0.0, 1.0) * pair_m[0], side * pair_m[1] * _HAIR
    else:
        along_m = pair_m[0] * _HAIR
        across_m = genes.uniform("across_1", -1.0, 1.0) * pair_m[1]
    return first_m[0] + along_m, first_m[1] + across_m


def _box(
    genes: Genes, number: int, heading_rad: float, centre_m: tuple[float, float], size_m: float
) -> Obstacle:
    """Draw a box, turned or not, that fills up to the largest extent in the frame of the leg."""
    turned = genes.choice(f"turned_{number}", (False, True))
    turn_rad = genes.uniform(f"turn_{number}", 0.0, math.pi / 2.0) if turned else 0.0
    aspect = genes.uniform(f"aspect_{number}", 0.1, 1.0)
    sides = genes.choice(f"longer_{number}", ((1.0, aspect), (aspect, 1.0)))
    cosine, sine = abs(math.cos(turn_rad)), abs(math.sin(turn_rad))
    extent = max(cosine * sides[0] + sine * sides[1], sine * sides[0] + cosine * sides[1])
    scale_m = size_m * genes.uniform(f"size_{number}", 0.4, 1.0) / extent
    return Obstacle(
        id=str(number),
        center_ned_m=ned_m(heading_rad, *centre_m),
        size_m=(sides[0] * scale_m, sides[1] * scale_m),
        yaw_deg=math.degrees(heading_rad + turn_rad),
    )


def _corner(genes: Genes, assessment: Assessment, heading_rad: float) -> Course:
    """Draw two legs at an angle, with walls beside both starts and an obstacle on the second."""
    first_m, second_m = genes.uniform("leg_0", 6.0, 9.0), genes.uniform("leg_1", 7.0, 10.0)
    turn_rad = genes.choice("side", (-1.0, 1.0)) * genes.uniform("angle", 0.6, 2.3)
    corner_m = ned_m(heading_rad, first_m, 0.0)
    leg_rad = heading_rad + turn_rad
    size_m = assessment.terms.obstacle_size_max_m
    # Where a wall may be reported within the disc, the operator's word is not taken.
    near_m = start_clear_radius_m(assessment) + 2.5 * assessment.terms.position_error_m
    room_m = near_m + _WALL_M / 2.0
    placed = [
        # Beside the first start, and beside the second, inside of the bend or outside of it.
        _wall("start", (0.0, 0.0), heading_rad, 1.0, room_m, 2.0 * size_m),
        _wall(
            "corner",
            corner_m,
            leg_rad,
            genes.choice("wall", (-1.0, 1.0)),
            room_m - 0.3 + genes.uniform("across_0", 0.0, 0.8),
            size_m * genes.uniform("size_0", 1.0, 4.0),
            genes.uniform("along_0", -1.0, 2.0),
        ),
    ]
    along_m = second_m * genes.uniform("along_1", 0.4, 0.7)
    across_m = genes.uniform("across_1", -1.0, 1.0) * (size_m / 2.0 + assessment.inflated.margin_m)
    offset_m = ned_m(leg_rad, along_m, across_m)
    centre_m = (corner_m[0] + offset_m[0], corner_m[1] + offset_m[1])
    ahead = _box(genes, 1, leg_rad, (0.0, 0.0), size_m)
    placed.append(ahead.model_copy(update={"center_ned_m": centre_m}))
    end_m = ned_m(leg_rad, second_m, 0.0)
    ends_ned_m = (corner_m, (corner_m[0] + end_m[0], corner_m[1] + end_m[1]))
    return Course(ObstacleField.of(placed), ends_ned_m, heading_rad, 6.0)


def _wall(
    name: str,
    start_ned_m: tuple[float, float],
    leg_rad: float,
    side: float,
    aside_m: float,
    length_m: float,
    along_m: float = 0.0,
) -> Obstacle:
    offset_m = ned_m(leg_rad, along_m, side * aside_m)
    return Obstacle(
        id=name,
        center_ned_m=(start_ned_m[0] + offset_m[0], start_ned_m[1] + offset_m[1]),
        size_m=(length_m, _WALL_M),
        yaw_deg=math.degrees(leg_rad),
    )


def _forest(genes: Genes, assessment: Assessment, heading_rad: float) -> Course:
    """Draw stems around a short leg, clear of its start and its end."""
    length_m, half_m = genes.uniform("leg_0", 9.0, 14.0), 6.0
    room_m = start_clear_radius_m(assessment) + assessment.terms.obstacle_size_max_m
    count = round(genes.uniform("stems_per_m2", 0.015, 0.06) * 2.0 * half_m * length_m)
    placed: list[Obstacle] = []
    for number in range(count):
        centre_m = (
            genes.uniform(f"along_{number}", 0.0, length_m),
            genes.uniform(f"across_{number}", -half_m, half_m),
        )
        near_end_m = math.hypot(centre_m[0] - length_m, centre_m[1])
        if min(math.hypot(*centre_m), near_end_m) > room_m:
            size_m = assessment.terms.obstacle_size_max_m * 0.7
            placed.append(_box(genes, number, heading_rad, centre_m, size_m))
    end_ned_m = ned_m(heading_rad, length_m, 0.0)
    return Course(ObstacleField.of(placed), (end_ned_m,), heading_rad, half_m)
