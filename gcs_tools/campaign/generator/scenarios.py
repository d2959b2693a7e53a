"""Random scenarios: contract, mission, field and plant that the pre-flight check accepts."""

from __future__ import annotations

import math
import random
from typing import Final

from gcs_tools.campaign.generator.airframes import Airframe, drawn_airframe
from gcs_tools.campaign.generator.case import FULL, Extent
from gcs_tools.campaign.generator.contracts import compliant_contract
from gcs_tools.campaign.generator.fields import ned_m, obstacles_along_leg
from gcs_tools.campaign.generator.plants import matching_plant
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import face_distances_m, start_clear_radius_m
from gcs_tools.scenario import Expectation, Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField

# Draws are repeated until contract and field comply; more than this many are a defect here.
ATTEMPTS_MAX: Final = 4000
_ALTITUDE_M: Final = 3.0
# The first hover is this near to the start.
_HOVERS_WITHIN_M: Final = 1.0
# An operator overlooks no more than this.
_CLEAR_MAX_M: Final = 4.0


def compliant_scenario(
    draw: random.Random,
    extent: Extent = FULL,
    *,
    stop: bool | None = None,
    passive_safety: bool | None = None,
) -> Scenario:
    """Draw scenarios until the pre-flight check accepts one; None draws a requirement, too.

    Raises:
        AssertionError: `ATTEMPTS_MAX` draws were all refused, which is a defect of this module.
    """
    airframe = drawn_airframe(draw, extent)
    for _ in range(ATTEMPTS_MAX):
        contract = compliant_contract(
            draw,
            extent,
            airframe,
            stop=draw.random() < 0.7 if stop is None else stop,
            passive_safety=draw.random() < 0.5 if passive_safety is None else passive_safety,
        )
        if contract is None:
            continue
        scenario = _placed_scenario(draw, contract, airframe, extent)
        if scenario is not None:
            return scenario
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no compliant scenario")


def _placed_scenario(
    draw: random.Random, contract: Contract, airframe: Airframe, extent: Extent
) -> Scenario | None:
    """Place obstacles along a leg in a random direction; None if the check refuses the result."""
    heading_rad = draw.uniform(-math.pi, math.pi)
    length_m = draw.uniform(*extent.length_m)
    obstacles = obstacles_along_leg(draw, contract, heading_rad, length_m)
    mission = straight_mission(draw, contract, heading_rad, length_m)
    if not obstacles or not check(contract, obstacles, mission).compliant:
        return None
    return flight_scenario(draw, contract, airframe, mission, obstacles, extent)


def straight_mission(
    draw: random.Random, contract: Contract, heading_rad: float, length_m: float
) -> Mission:
    """Draw a mission of one leg, with room beside its end to stop clear of an obstacle."""
    size_m, derived = contract.environment.obstacle_size_max_m, assess(contract).inflated
    return Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "climb_max_m": draw.choice((0.0, 0.0, draw.uniform(0.5, 1.5))),
            "legs": [
                {
                    "end_ned_m": ned_m(heading_rad, length_m, 0.0),
                    "target_half_width_m": 2.0 * size_m + derived.roi_width_m + 2.0,
                }
            ],
        }
    )


def flight_scenario(
    draw: random.Random,
    contract: Contract,
    airframe: Airframe,
    mission: Mission,
    obstacles: ObstacleField,
    extent: Extent,
) -> Scenario:
    """Draw a plant and put the scenario together; `generators.generated` names it.

    The operator confirms that the start is clear, where the field leaves it so.
    """
    needed_m = start_clear_radius_m(assess(contract)) + _HOVERS_WITHIN_M
    clear_m = float(face_distances_m(obstacles, mission.start_ned_m).min(initial=math.inf))
    clear_m = math.floor(10.0 * min(clear_m, _CLEAR_MAX_M)) / 10.0
    if clear_m >= needed_m:
        mission = mission.model_copy(update={"start_clear_m": clear_m})
    return Scenario(
        name="",
        contract=contract,
        mission=mission,
        obstacles=obstacles,
        plant=matching_plant(
            draw, contract, airframe, -mission.altitude_m if extent.airborne else 0.0
        ),
        faults=(),
        field_known=True,
        fly_outside_contract=False,
        expect=Expectation.model_validate({}),
    )
