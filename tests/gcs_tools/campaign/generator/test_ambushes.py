"""Movers faster than declared: that flights among movers can fail, and that an oracle sees it."""

from __future__ import annotations

import random
from dataclasses import replace

from gcs_tools.campaign.flight import fly_case
from gcs_tools.campaign.generator.ambushes import Ambush, ambush_case, case_of
from gcs_tools.campaign.oracles.registry import findings
from gcs_tools.preflight.command import check
from sitl.environment.movers.config import Dash


def test_a_contact_in_motion_is_a_collision_and_a_finding_where_none_was_to_be() -> None:
    """Short, so with a mover that is 2.5 times as fast as declared: what 30 % take is long."""
    ambush = Ambush(
        tilt_deg=20.0, cruise_mps=2.5, declared_mps=3.0, factor=2.5, stands_m=16.0, comes_m=5.9,
        time_limit_s=11.0,
    )  # fmt: skip
    case = case_of(ambush, seed=1)
    evidence = fly_case(case)
    assert evidence.result.outcome == "collided"
    assert evidence.result.collisions >= 1
    assert evidence.result.speed_at_contact_mps is not None
    assert evidence.result.speed_at_contact_mps > 0.2
    # Nothing was promised, so that this is what the flight is for.
    assert not findings(evidence)
    promised = replace(case, outcomes=("arrived", "aborted"), covered=True)
    assert "outcome" in findings(replace(evidence, case=promised))


def test_what_is_drawn_may_be_flown_and_promises_nothing() -> None:
    for number in range(5):
        case = ambush_case(random.Random(number))
        scenario = case.scenario
        assert check(scenario.contract, None, scenario.mission).may_fly
        assert not case.covered
        assert "collided" in case.outcomes
        (declared,), (mover,) = scenario.contract.environment.movers, scenario.plant.movers
        assert mover.speed_mps == 1.3 * declared.speed_max_mps
        assert isinstance(mover.path, Dash)
