"""Random flights with best effort: fields that no separation covers, seen as they come."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Final

from gcs_tools.campaign.generator.airframes import Airframe, drawn_airframe
from gcs_tools.campaign.generator.case import Extent
from gcs_tools.campaign.generator.contracts import compliant_contract
from gcs_tools.campaign.generator.fields import ned_m
from gcs_tools.campaign.generator.scenarios import ATTEMPTS_MAX, flight_scenario, straight_mission
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import start_clear_radius_m
from gcs_tools.scenario import Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.obstacle_field import Obstacle, ObstacleField

# Short legs, from hover: dense fields are flown in a third of the time of a whole flight.
_EXTENT: Final = Extent((18.0, 28.0), (1.2, 2.8), airborne=True)
# Contracts need no leg that takes one obstacle of their own.
_ROOMY: Final = replace(_EXTENT, length_m=(60.0, 60.0))
_SIZE_M: Final = (0.2, 1.5)
_STEMS_PER_M2: Final = (0.01, 0.06)
_HALF_WIDTH_M: Final = (5.0, 8.0)
_VIEW_DEG: Final = (100.0, 180.0)
_RANGE_M: Final = (8.0, 14.0)
_SEPARATION_M: Final = (1.0, 4.0)
# Free around the end of the leg, beside what the vehicle itself needs.
_END_ROOM_M: Final = 1.0


def best_effort_scenario(draw: random.Random) -> Scenario:
    """Draw a vehicle, a leg and stems around it until the pre-flight check lets it fly.

    Raises:
        AssertionError: `ATTEMPTS_MAX` draws were all refused, which is a defect of this module.
    """
    airframe = drawn_airframe(draw, _EXTENT)
    for _ in range(ATTEMPTS_MAX):
        contract = _contract(draw, airframe)
        if contract is None:
            continue
        heading_rad, length_m = draw.uniform(-math.pi, math.pi), draw.uniform(*_EXTENT.length_m)
        mission = straight_mission(draw, contract, heading_rad, length_m)
        width = {"target_half_width_m": draw.uniform(*_HALF_WIDTH_M)}
        legs = tuple(leg.model_copy(update=width) for leg in mission.legs)
        changes = {"legs": legs, "heading": draw.choice(("leg", "path")), "climb_max_m": 0.0}
        mission = mission.model_copy(update=changes)
        obstacles = _stems(draw, contract, heading_rad, length_m)
        if not check(contract, None, mission).may_fly:
            continue
        scenario = flight_scenario(draw, contract, airframe, mission, obstacles, _EXTENT)
        return Scenario(**{**vars(scenario), "field_known": False})
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no scenario that may be flown")


def _contract(draw: random.Random, airframe: Airframe) -> Contract | None:
    """Draw a contract that complies, and declare what a dense field leaves of it."""
    passive_safety = draw.random() < 0.5
    contract = compliant_contract(
        draw,
        _ROOMY,
        airframe,
        stop=True,
        passive_safety=passive_safety,
        size_max_m=draw.uniform(*_SIZE_M),
    )
    if contract is None:
        return None
    view = {
        "field_of_view_deg": draw.uniform(*_VIEW_DEG),
        "detection_range_m": draw.uniform(*_RANGE_M),
    }
    separation = {"obstacle_separation_min_m": draw.uniform(*_SEPARATION_M)}
    return contract.model_copy(
        update={
            "requirements": contract.requirements.model_copy(update={"progress": "best_effort"}),
            "sensor": contract.sensor.model_copy(update=view),
            "environment": contract.environment.model_copy(update=separation),
        }
    )


def _stems(
    draw: random.Random, contract: Contract, heading_rad: float, length_m: float
) -> ObstacleField:
    """Draw stems anywhere around a leg, but for its start and its end."""
    half_m = 2.0 * _HALF_WIDTH_M[1]
    room_m = start_clear_radius_m(assess(contract)) + _SIZE_M[1]
    placed: list[Obstacle] = []
    area_m2 = 2.0 * half_m * length_m
    for _ in range(round(draw.uniform(*_STEMS_PER_M2) * area_m2)):
        along_m, across_m = draw.uniform(0.0, length_m), draw.uniform(-half_m, half_m)
        size_m = contract.environment.obstacle_size_max_m * draw.uniform(0.3, 0.7)
        near_start = math.hypot(along_m, across_m) < room_m
        near_end = math.hypot(along_m - length_m, across_m) < room_m + _END_ROOM_M
        if not near_start and not near_end:
            placed.append(
                Obstacle(
                    id=str(len(placed)),
                    center_ned_m=ned_m(heading_rad, along_m, across_m),
                    size_m=(size_m, size_m),
                    yaw_deg=draw.uniform(0.0, 90.0),
                )
            )
    return ObstacleField.of(placed)
