"""The table of the automaton, and the conditions of its induction step."""

import re
from itertools import product

import pytest

from onboard.contract.agility import AccelerationLimits
from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.guidance.phases import (
    STATES,
    TRANSITIONS,
    TRIGGERS,
    FlightState,
    IllegalTransitionError,
    Phase,
    Trigger,
    next_state,
    post_condition,
    pre_condition,
)
from onboard.motion.trajectory import State
from tests.onboard.contract.ideal_encounter import ideal_encounter

SPEED_MPS = 2.8
FLYING = [state for state in FlightState if state.flying]
GROUNDED = [state for state in FlightState if not state.flying]


@pytest.fixture
def region() -> RegionOfInfluence:
    limits = AccelerationLimits(*[2.6] * 4)
    obstacle = Box(10.0, 12.0, -1.0, 1.0)
    return RegionOfInfluence.around(obstacle, ideal_encounter(limits, SPEED_MPS, obstacle.size_m))


def at(x_m: float, y_m: float, vx_mps: float = SPEED_MPS, vy_mps: float = 0.0) -> State:
    return State((x_m, y_m, 0.0), (vx_mps, vy_mps, 0.0))


def triggers_of(state: FlightState) -> set[Trigger]:
    return {trigger for source, trigger in TRANSITIONS if source is state}


# ---------------------------------------------------------------------------- the table


@pytest.mark.parametrize(("state", "trigger"), list(product(FlightState, Trigger)))
def test_every_state_and_trigger_is_a_transition_or_an_error(
    state: FlightState, trigger: Trigger
) -> None:
    if (state, trigger) in TRANSITIONS:
        assert next_state(state, trigger) is TRANSITIONS[state, trigger]
    else:
        with pytest.raises(IllegalTransitionError, match=re.escape(f"'{trigger}'")):
            next_state(state, trigger)


def test_an_illegal_transition_names_state_trigger_and_what_is_expected() -> None:
    with pytest.raises(IllegalTransitionError) as caught:
        next_state(FlightState.HOLDING, Trigger.PRE_CONDITION)
    assert str(caught.value) == (
        "no transition for trigger 'pre-condition' in state 'holding'"
        " (expected 'resumed', 'best effort resumed', 'mission changed', 'control taken')"
    )


def test_every_state_and_every_trigger_is_described_and_used() -> None:
    assert set(STATES) == set(FlightState)
    assert set(TRIGGERS) == set(Trigger)
    assert {source for source, _ in TRANSITIONS} == set(FlightState)
    assert {trigger for _, trigger in TRANSITIONS} == set(Trigger)
    assert {facts.phase for facts in STATES.values()} == set(Phase)


def test_every_state_is_reached_from_standby() -> None:
    reached, frontier = {FlightState.STANDBY}, [FlightState.STANDBY]
    while frontier:
        state = frontier.pop()
        following = {TRANSITIONS[state, trigger] for trigger in triggers_of(state)} - reached
        reached |= following
        frontier += following
    assert reached == set(FlightState)


def test_every_phase_is_published_under_its_name_of_before() -> None:
    assert {state.value: state.phase.value for state in FlightState} == {
        "standby": "standby",
        "aligning": "cruise",
        "cruising": "cruise",
        "recentring": "cruise",
        "avoiding": "avoid",
        "stopping_unaligned": "cruise",
        "stopping": "cruise",
        "avoiding_then_stopping": "avoid",
        "threading": "thread",
        "looking": "pause",
        "yielding": "yield",
        "resting": "thread",
        "arrived": "arrived",
        "holding": "hold",
    }


@pytest.mark.parametrize("state", FlightState)
def test_properties_agree_with_the_phase(state: FlightState) -> None:
    seen = (Phase.THREAD, Phase.PAUSE, Phase.YIELD)
    assert state.in_seen_space is (state.phase in seen)
    assert state.flying is (state.phase in (Phase.CRUISE, Phase.AVOID) or state.in_seen_space)
    if state.cruising_freely:
        assert state.phase is Phase.CRUISE
    if state.changes_mission:
        assert state.flying


# ---------------------------------------------------------------------------- its properties


@pytest.mark.parametrize("state", [state for state in FlightState if not state.changes_mission])
def test_induction_step_returns_to_cruise(state: FlightState) -> None:
    if Trigger.PRE_CONDITION in triggers_of(state):
        avoiding = next_state(state, Trigger.PRE_CONDITION)
        assert avoiding is FlightState.AVOIDING
        assert next_state(avoiding, Trigger.POST_CONDITION) is FlightState.CRUISING


def test_an_avoidance_on_the_way_to_a_stop_is_followed_by_the_stop() -> None:
    avoiding = next_state(FlightState.STOPPING, Trigger.PRE_CONDITION)
    assert avoiding is FlightState.AVOIDING_THEN_STOPPING
    assert next_state(avoiding, Trigger.POST_CONDITION) is FlightState.STOPPING


@pytest.mark.parametrize("state", [s for s in FlightState if s is not FlightState.STANDBY])
def test_pilot_can_take_control_from_every_state(state: FlightState) -> None:
    assert next_state(state, Trigger.CONTROL_TAKEN) is FlightState.STANDBY


@pytest.mark.parametrize("state", FLYING)
def test_failed_assumption_ends_in_a_hold_while_flying(state: FlightState) -> None:
    assert next_state(state, Trigger.ASSUMPTION_FAILED) is FlightState.HOLDING


@pytest.mark.parametrize("state", GROUNDED)
def test_nothing_fails_while_not_flying(state: FlightState) -> None:
    assert Trigger.ASSUMPTION_FAILED not in triggers_of(state)


def test_a_hold_is_left_only_by_the_pilot_or_the_operator() -> None:
    ways_out = [
        trigger
        for (state, trigger), target in TRANSITIONS.items()
        if state is FlightState.HOLDING and target is not FlightState.HOLDING
    ]
    assert ways_out == [Trigger.RESUMED, Trigger.BEST_EFFORT_RESUMED, Trigger.CONTROL_TAKEN]
    # At rest, and looking first, as at a departure.
    assert next_state(FlightState.HOLDING, Trigger.RESUMED) is FlightState.ALIGNING
    assert next_state(FlightState.HOLDING, Trigger.BEST_EFFORT_RESUMED) is FlightState.LOOKING


@pytest.mark.parametrize("state", FlightState)
def test_a_mission_can_change_in_every_state(state: FlightState) -> None:
    changed = next_state(state, Trigger.MISSION_CHANGED)
    assert changed.phase is state.phase or (changed.in_seen_space and state.in_seen_space)
    assert changed.changes_mission is state.flying
    # Another one on top of it changes nothing more.
    assert next_state(changed, Trigger.MISSION_CHANGED) is changed
    assert changed.cruising_freely is state.cruising_freely


@pytest.mark.parametrize("state", FLYING)
def test_a_leg_ends_only_outside_regions_and_at_rest_with_the_nose_known(
    state: FlightState,
) -> None:
    ends = {Trigger.LEG_FLOWN, Trigger.MISSION_FLOWN} & triggers_of(state)
    ready = state.phase is Phase.CRUISE and state is not FlightState.ALIGNING
    # Also a wait for movers may end at the leg's end.
    assert bool(ends) is (ready or state.phase in (Phase.THREAD, Phase.YIELD))
    if ends:
        looks = FlightState.LOOKING if state.in_seen_space else FlightState.ALIGNING
        assert next_state(state, Trigger.LEG_FLOWN) is looks
        assert next_state(state, Trigger.MISSION_FLOWN) is FlightState.ARRIVED


@pytest.mark.parametrize("state", FlightState)
def test_avoidances_begin_only_in_a_free_cruise(state: FlightState) -> None:
    assert (Trigger.PRE_CONDITION in triggers_of(state)) is state.cruising_freely
    assert (Trigger.CRUISE_REPLANNED in triggers_of(state)) is state.cruising_freely


def test_a_flight_in_seen_space_leaves_it_for_rest_or_the_pilot_or_to_cruise_from_rest() -> None:
    ends = {FlightState.ARRIVED, FlightState.HOLDING, FlightState.STANDBY, FlightState.ALIGNING}
    for (state, trigger), target in TRANSITIONS.items():
        if not state.in_seen_space or target.in_seen_space:
            continue
        assert target in ends
        back = trigger in (Trigger.BACK_TO_CRUISE, Trigger.START_SEEN)
        assert (target is FlightState.ALIGNING) == back


@pytest.mark.parametrize("state", FlightState)
def test_what_cruises_or_avoids_threads_on_from_rest_where_nothing_certifies(
    state: FlightState,
) -> None:
    moving = state.cruising_freely or state.phase is Phase.AVOID
    if not moving:
        assert state.in_seen_space or Trigger.NO_WAY not in triggers_of(state)
        return
    rests = FlightState.RESTING if state.changes_mission else FlightState.LOOKING
    assert next_state(state, Trigger.NO_WAY) is rests


def test_threading_pauses_and_goes_on() -> None:
    looking = next_state(FlightState.STANDBY, Trigger.BEST_EFFORT_GRANTED)
    assert looking is FlightState.LOOKING
    assert next_state(looking, Trigger.WAY_FOUND) is FlightState.THREADING
    assert next_state(FlightState.THREADING, Trigger.NO_WAY) is looking
    assert next_state(looking, Trigger.NO_WAY) is looking


def test_a_drift_begins_and_ends_in_cruise() -> None:
    drifting = next_state(FlightState.CRUISING, Trigger.CORRIDOR_FREE)
    assert drifting is FlightState.RECENTRING
    assert next_state(drifting, Trigger.CORRIDOR_BLOCKED) is FlightState.CRUISING
    assert next_state(drifting, Trigger.CRUISE_REPLANNED) is FlightState.CRUISING


# ---------------------------------------------------------------------------- the conditions


def test_pre_condition_holds_at_the_front_of_the_region(region: RegionOfInfluence) -> None:
    state = at(region.approach_x_m, 0.0)
    condition = pre_condition(state, region, speed_max_mps=SPEED_MPS, late_m=0.0)
    assert condition.holds
    assert condition.failures == ()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"x_m": 0.1}, "avoidance started 0.10 m late (limit 0.05 m)"),
        (
            {"y_m": 1.5},
            "y = 1.50 m is not on a collision course (conflict band -1.00 to 1.00 m)",
        ),
        ({"vx_mps": SPEED_MPS + 0.01}, "speed 2.81 m/s (expected 0 to 2.80 m/s)"),
        ({"vx_mps": -0.1}, "speed -0.10 m/s (expected 0 to 2.80 m/s)"),
        ({"vy_mps": 0.01}, "lateral speed 0.01 m/s (limit 0.00 m/s)"),
        ({"vy_mps": -0.01}, "lateral speed -0.01 m/s (limit 0.00 m/s)"),
    ],
)
def test_pre_condition_names_what_fails(
    region: RegionOfInfluence, change: dict[str, float], expected: str
) -> None:
    state = at(
        region.approach_x_m + change.get("x_m", 0.0),
        change.get("y_m", 0.0),
        change.get("vx_mps", SPEED_MPS),
        change.get("vy_mps", 0.0),
    )
    condition = pre_condition(state, region, speed_max_mps=SPEED_MPS, late_m=0.05)
    assert condition.failures == (expected,)


def test_pre_condition_names_everything_that_fails(region: RegionOfInfluence) -> None:
    state = at(region.approach_x_m + 1.0, 2.0, 5.0, 1.0)
    condition = pre_condition(state, region, speed_max_mps=SPEED_MPS, late_m=0.05)
    assert not condition.holds
    assert len(condition.failures) == 4


def test_post_condition_holds_at_the_border_at_entry_speed(region: RegionOfInfluence) -> None:
    assert post_condition(at(region.x_pob_m, 1.2), region, exit_speed_mps=SPEED_MPS).holds


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (at(11.0, 1.2), r"x = 11\.00 m is before the post-obstacle border at \d+\.\d\d m"),
        (
            at(20.0, 1.2, vx_mps=2.0),
            r"speed 2\.000 m/s \(expected the exit speed 2\.800 m/s\)",
        ),
        (at(20.0, 1.2, vy_mps=0.1), r"lateral speed 0\.100 m/s \(limit 0\.001 m/s\)"),
        (at(20.0, 9.0), r"y = 9\.00 m is outside the lane \(-\d\.\d\d to \d\.\d\d m\)"),
    ],
)
def test_post_condition_names_what_fails(
    region: RegionOfInfluence, state: State, expected: str
) -> None:
    (failure,) = post_condition(state, region, exit_speed_mps=SPEED_MPS).failures
    assert re.fullmatch(expected, failure)
