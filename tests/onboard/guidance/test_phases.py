from itertools import product

import pytest

from onboard.contract.agility import AccelerationLimits
from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.guidance.phases import (
    TRANSITIONS,
    IllegalTransitionError,
    Phase,
    Trigger,
    next_phase,
    post_condition,
    pre_condition,
)
from onboard.motion.trajectory import State
from tests.onboard.contract.ideal_encounter import ideal_encounter

SPEED_MPS = 2.8


@pytest.fixture
def region() -> RegionOfInfluence:
    limits = AccelerationLimits(*[2.6] * 4)
    obstacle = Box(10.0, 12.0, -1.0, 1.0)
    return RegionOfInfluence.around(obstacle, ideal_encounter(limits, SPEED_MPS, obstacle.size_m))


def at(x_m: float, y_m: float, vx_mps: float = SPEED_MPS, vy_mps: float = 0.0) -> State:
    return State((x_m, y_m, 0.0), (vx_mps, vy_mps, 0.0))


@pytest.mark.parametrize(("phase", "trigger"), list(product(Phase, Trigger)))
def test_every_phase_and_trigger_is_a_transition_or_an_error(
    phase: Phase, trigger: Trigger
) -> None:
    if (phase, trigger) in TRANSITIONS:
        assert next_phase(phase, trigger) is TRANSITIONS[phase, trigger]
    else:
        with pytest.raises(IllegalTransitionError, match=trigger):
            next_phase(phase, trigger)


def test_induction_step_returns_to_cruise() -> None:
    avoiding = next_phase(Phase.CRUISE, Trigger.PRE_CONDITION)
    assert avoiding is Phase.AVOID
    assert next_phase(avoiding, Trigger.POST_CONDITION) is Phase.CRUISE


@pytest.mark.parametrize("phase", [phase for phase in Phase if phase is not Phase.STANDBY])
def test_pilot_can_take_control_from_every_phase(phase: Phase) -> None:
    assert next_phase(phase, Trigger.CONTROL_TAKEN) is Phase.STANDBY


@pytest.mark.parametrize("phase", [Phase.CRUISE, Phase.AVOID])
def test_failed_assumption_ends_in_hold_while_flying(phase: Phase) -> None:
    assert next_phase(phase, Trigger.ASSUMPTION_FAILED) is Phase.HOLD


def test_hold_is_left_only_by_the_pilot() -> None:
    ways_out = [trigger for phase, trigger in TRANSITIONS if phase is Phase.HOLD]
    assert ways_out == [Trigger.CONTROL_TAKEN]


def test_pre_condition_holds_at_the_front_of_the_region(region: RegionOfInfluence) -> None:
    state = at(region.extent.x_min_m, 0.0)
    assert pre_condition(state, region, speed_max_mps=SPEED_MPS, late_m=0.0).holds


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"x_m": 0.1}, "late"),
        ({"y_m": 1.5}, "does not meet"),
        ({"vx_mps": SPEED_MPS + 0.01}, "speed 2.81"),
        ({"vx_mps": -0.1}, "speed -0.10"),
        ({"vy_mps": 0.01}, "lateral speed 0.01"),
    ],
)
def test_pre_condition_names_what_fails(
    region: RegionOfInfluence, change: dict[str, float], named: str
) -> None:
    state = at(
        region.extent.x_min_m + change.get("x_m", 0.0),
        change.get("y_m", 0.0),
        change.get("vx_mps", SPEED_MPS),
        change.get("vy_mps", 0.0),
    )
    condition = pre_condition(state, region, speed_max_mps=SPEED_MPS, late_m=0.05)
    assert len(condition.failures) == 1
    assert named in condition.failures[0]


def test_post_condition_holds_at_the_border_at_entry_speed(region: RegionOfInfluence) -> None:
    assert post_condition(at(region.x_pob_m, 1.2), region, exit_speed_mps=SPEED_MPS).holds


@pytest.mark.parametrize(
    ("state", "named"),
    [
        (at(11.0, 1.2), "border"),
        (at(20.0, 1.2, vx_mps=2.0), "exit speed"),
        (at(20.0, 1.2, vy_mps=0.1), "lateral speed"),
        (at(20.0, 9.0), "lane"),
    ],
)
def test_post_condition_names_what_fails(
    region: RegionOfInfluence, state: State, named: str
) -> None:
    condition = post_condition(state, region, exit_speed_mps=SPEED_MPS)
    assert any(named in failure for failure in condition.failures)
