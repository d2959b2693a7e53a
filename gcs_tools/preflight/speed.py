"""Finds the fastest cruise speed that complies with a contract in a given field."""

from __future__ import annotations

from gcs_tools.contract.keys import contract_key
from gcs_tools.contract.solve import LARGEST_TRIED, solve
from gcs_tools.preflight.field_check import RULES_OF_SPEED, check_field, legs_of, regions_clear
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract, InputSet
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField

# Slowest speed tried, and the resolution of the result.
_SLOWEST_TRIED_MPS = 0.1
_RESOLUTION_MPS = 0.005


def fastest_speed_mps(
    contract: Contract, obstacles: ObstacleField, mission: Mission | None, input_set: InputSet
) -> float | None:
    """Return the fastest cruise speed [m/s] that contract and field allow, all else as stated.

    None if no speed complies: the broken clause or rule does not depend on speed.
    """
    key = contract_key("vehicle.cruise_speed_mps")

    def complies(speed_mps: float) -> bool:
        assessment = assess(key.changed(contract, speed_mps), input_set)
        return assessment.compliant and regions_clear(legs_of(assessment, obstacles, mission))

    rules = check_field(assess(contract, input_set), obstacles, mission)
    if not all(rule.holds for rule in rules if rule.name not in RULES_OF_SPEED):
        return None
    covered = [each.upper for each in solve(contract, key.path, input_set).intervals]
    ceiling_mps = max((end.value if end else LARGEST_TRIED for end in covered), default=0.0)
    slow_mps, fast_mps = _SLOWEST_TRIED_MPS, ceiling_mps
    if not (slow_mps < fast_mps and complies(slow_mps)):
        return None
    if complies(fast_mps):
        return fast_mps
    while fast_mps - slow_mps > _RESOLUTION_MPS:
        middle_mps = (slow_mps + fast_mps) / 2.0
        slow_mps, fast_mps = (
            (middle_mps, fast_mps) if complies(middle_mps) else (slow_mps, middle_mps)
        )
    return slow_mps
