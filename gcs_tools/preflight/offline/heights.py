"""Which obstacles of a known field are in the way of a mission, by their heights."""

from __future__ import annotations

import math

from onboard.contract.heights import half_band_m
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField


def obstacles_in_way(
    obstacles: ObstacleField, contract: Contract, mission: Mission | None
) -> ObstacleField:
    """Return what the sensor may report within the heights that a mission is flown at.

    All obstacles where the contract takes them for pillars, or without a mission.
    """
    terms = Terms.of(contract)
    half_m = half_band_m(terms)
    if mission is None or math.isinf(half_m) or terms.position_error_z_m is None:
        return obstacles
    reach_m = half_m + 2.0 * terms.position_error_z_m
    return obstacles.reaching_into(-mission.altitude_m - reach_m, -mission.altitude_m + reach_m)
