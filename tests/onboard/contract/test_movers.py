"""What passive safety against movers requires of a contract."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.assessment import TICK_S, assess, clauses, derive
from onboard.contract.movers import (
    NOSE_TOLERANCE_RAD,
    STAMP_ERROR_S,
    Stop,
    all_round_m,
    dead_daemon_range_m,
    in_view_rad,
    passive_range_m,
    start_clear_of_movers_m,
    stop_of,
    stoppable_m,
)
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract, load_contract
from onboard.files.contract_terms.mover_terms import MoverClass
from onboard.files.yaml_file import FileError, validate
from onboard.guidance.envelope import HEADING_TOLERANCE_RAD
from onboard.monitoring.adaptation import at_compliant_speed
from onboard.perception.placement import POSE_TIMING_S

PERSON = {"class": "person", "speed_max_mps": 1.5, "size_max_m": 1.0}
DRONE = {"class": "drone", "speed_max_mps": 15.0, "size_max_m": 1.0}


HEIGHTS: dict[str, Any] = {
    "vehicle__radius_z_m": 0.25, "vehicle__height_drift_m": 0.1, "sensor__position_error_z_m": 0.1,
    "sensor__vertical_field_of_view_deg": [45.0, 45.0], "vehicle__height_drift_flight_m": 0.8,
}  # fmt: skip
LOW = {**PERSON, "top_max_m": 2.3}


def contract(**changes: Any) -> Contract:
    """Return a contract against movers; keys are ``section__key``."""
    data: dict[str, Any] = {
        "vehicle": {
            "roll_max_deg": 15.0, "pitch_max_deg": 15.0, "thrust_to_weight": 2.0,
            "cruise_speed_mps": 2.8, "radius_m": 0.3, "tracking_error_m": 0.35,
            "velocity_error_mps": [0.1, 0.1], "reaction_time_s": 0.25, "attitude_lag_s": 0.2,
            "setpoint_loss_timeout_s": 0.5, "rest_settle_s": 0.3,
        },
        "requirements": {"stop": True, "passive_safety": True, "movers": "passive"},
        "sensor": {
            "detection_range_m": 15.0, "field_of_view_deg": 120.0, "frame_age_max_s": 0.3,
            "position_error_m": 0.05, "all_round_range_m": 11.0,
        },
        "environment": {
            "obstacle_size_max_m": 4.0, "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": 20.0, "movers": [PERSON],
        },
    }  # fmt: skip
    for name, value in changes.items():
        section, _, key = name.partition("__")
        data[section][key] = value
    return validate(data, Contract, source="test")


def stop(terms: Terms[float]) -> Stop[float]:
    return stop_of(terms, derive(terms, SCALAR), SCALAR)


TERMS = Terms.of(contract())
DERIVED = derive(TERMS, SCALAR)


def test_constants_are_those_of_the_rooms_that_this_one_may_not_import() -> None:
    assert STAMP_ERROR_S == POSE_TIMING_S
    assert NOSE_TOLERANCE_RAD == HEADING_TOLERANCE_RAD


# ---------------------------------------------------------------------- the key and its hash


def test_at_their_defaults_the_keys_leave_the_hash_as_it_was() -> None:
    plain = load_contract(Path(__file__).parents[3] / "config" / "default_contract.yaml")
    assert plain.sha256 == "9769489e3b0d8048d790bbcd62e9ca3b25d0680deb56ecaba79b439cace44935"
    off = contract(requirements__movers="none", environment__movers=[], sensor__all_round_range_m=0)
    assert off.sha256 != contract().sha256


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"requirements__movers": "avoid", "requirements__progress": "best_effort"},
            "movers are passed from the cruise only",
        ),
        ({"environment__movers": []}, "needs environment.movers"),
        (
            {
                "vehicle__radius_z_m": 0.3,
                "vehicle__height_drift_m": 0.3,
                "sensor__position_error_z_m": 0.2,
                "sensor__vertical_field_of_view_deg": (30.0, 30.0),
            },
            "height_drift_flight_m = null, expected at least height_drift_m = 0.3 m",
        ),
        ({"requirements__stop": False}, "needs requirements.stop = true"),
        ({"vehicle__rest_settle_s": 0.0}, "needs vehicle.rest_settle_s above 0 s"),
        ({"sensor__all_round_range_m": 0.0}, "needs sensor.all_round_range_m above 0 m"),
        (
            {"requirements__movers": "passive_in_view", "requirements__progress": "best_effort"},
            "counts only in a steady cruise",
        ),
        (
            {"vehicle__setpoint_loss": {
                "model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8}},
            "needs vehicle.setpoint_loss_run_time_s",
        ),
        (
            {"environment__movers": [DRONE, {**PERSON, "class": "unknown"}]},
            "may be a drone: state at least 15 m/s",
        ),
        (
            {"environment__movers": [PERSON, {**PERSON, "class": "unknown", "size_max_m": 0.5}]},
            "may be a person: state at least 1 m",
        ),
        ({"environment__movers": [PERSON, PERSON]}, "'person' is stated 2 times"),
        (
            {"vehicle__radius_z_m": 0.25, "vehicle__height_drift_m": 0.1,
             "sensor__position_error_z_m": 0.1,
             "sensor__vertical_field_of_view_deg": [45.0, 45.0],
             "vehicle__height_drift_flight_m": 0.05},
            "height_drift_flight_m = 0.05 m, expected at least height_drift_m = 0.1 m",
        ),
        (HEIGHTS | {"environment__movers": [LOW, DRONE]}, "needs top_max_m [m] of class drone"),
        (HEIGHTS | {"requirements__movers": "avoid", "environment__movers": [LOW]},
         "require passive"),
        (
            {"environment__movers": [LOW, {**LOW, "class": "unknown", "top_max_m": 1.0}]},
            "may be a person, which has 2.3 m",
        ),
        (
            {"environment__movers": [PERSON, {**LOW, "class": "unknown"}]},
            "may be a person, which has no top_max_m",
        ),
    ],
)  # fmt: skip
def test_what_is_not_enforced_is_refused(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(FileError) as refused:
        contract(**changes)
    assert says in str(refused.value)


def test_a_view_all_round_needs_no_ring() -> None:
    seen = assess(contract(sensor__all_round_range_m=0.0, sensor__field_of_view_deg=360.0))
    assert not [c for c in seen.clauses if c.name.startswith("all_round")]
    assert str(seen.mover_levels[0]).startswith("person 1.5 m/s: passive")


# ---------------------------------------------------------------------- levels


def test_each_class_has_a_level() -> None:
    declared = [PERSON, DRONE, {"class": "child", "speed_max_mps": 0.5, "size_max_m": 1.0}]
    said = [str(level) for level in assess(contract(environment__movers=declared)).mover_levels]
    assert said[0] == "person 1.5 m/s: passive, if none hides behind an obstacle"
    assert said[1].startswith("drone 15 m/s: NOT COVERED, needs ")
    blind = contract(
        requirements__movers="none", sensor__all_round_range_m=0.0, environment__movers=declared
    )
    said = [str(level) for level in assess(blind).mover_levels]
    assert said[0].startswith("person 1.5 m/s: NOT COVERED")
    assert said[2] == (
        "child 0.5 m/s: passive in view, from the operator's word at the start, in a steady cruise"
    )


def in_view(**changes: Any) -> Contract:
    """Return a contract without a ring, against people who are slow enough for that."""
    slow = [{**PERSON, "speed_max_mps": 0.5}]
    level = {"requirements__movers": "passive_in_view", "sensor__all_round_range_m": 0.0}
    return contract(**{**level, "environment__movers": slow, **changes})


def clauses_of(contract: Contract) -> dict[str, tuple[float, float]]:
    return {c.name: (c.required, c.declared) for c in assess(contract).clauses}


def test_a_level_in_view_needs_a_view_in_place_of_a_ring() -> None:
    seen = assess(in_view())
    assert seen.compliant
    assert [level.brief for level in seen.mover_levels] == ["person 0.5 m/s: passive in view"]
    found = clauses_of(in_view())
    assert found["passive_in_view.person"][1] == pytest.approx(120.0)
    assert not [name for name in found if name.startswith("all_round")]
    assert "passive_in_view.person" not in clauses_of(contract())
    narrow = assess(in_view(sensor__field_of_view_deg=found["passive_in_view.person"][0] - 0.1))
    assert [c.name for c in narrow.clauses if not c.holds][-1] == "passive_in_view.person"
    assert narrow.mover_levels[0].level is None


def test_a_ring_that_nothing_watches_makes_no_higher_level() -> None:
    ringed = in_view(sensor__all_round_range_m=11.0)
    assert assess(ringed).mover_levels[0].level == "passive in view"


def test_the_view_in_view_grows_as_the_cruise_gets_slower() -> None:
    """So it is as the field of view: a slower cruise is no cure, and none is found by bisection."""
    speeds = (2.8, 2.4, 2.0, 1.6, 1.0)
    views = [
        clauses_of(in_view(vehicle__cruise_speed_mps=v))["passive_in_view.person"][0]
        for v in speeds
    ]
    assert views == sorted(views)
    assert views[0] < 120.0
    assert views[-1] == pytest.approx(720.0)
    slow = assess(in_view(sensor__field_of_view_deg=views[0] - 1.0))
    assert at_compliant_speed(slow, 2.8) is None


def test_the_view_in_view_is_the_same_on_a_surface() -> None:
    """Arrays, as `clearway contract surface` has them: some comply, some are too slow."""
    speeds = np.array((0.8, 2.0, 2.4, 2.8))
    hidden = [{**PERSON, "speed_max_mps": 0.5, "hidden": True}]
    terms = Terms.of(in_view(environment__movers=hidden))
    numbers: dict[str, Any] = {
        each.name: np.full(len(speeds), value)
        for each in fields(terms)
        if isinstance(value := getattr(terms, each.name), float)
    }
    numbers["cruise_speed_mps"] = speeds
    arrays: Terms[Any] = replace(cast("Terms[Any]", terms), **numbers)
    found = {c.name: c.required for c in clauses(arrays, derive(arrays, ARRAY), ARRAY)}
    for index, speed in enumerate(speeds.tolist()):
        one = clauses_of(in_view(environment__movers=hidden, vehicle__cruise_speed_mps=speed))
        for name in ("passive_in_view.person", "emergence", "emergence_range"):
            assert found[name][index] == pytest.approx(one[name][0])


@pytest.mark.parametrize(
    "changes",
    [
        {"vehicle__rest_settle_s": 0.9},
        {"environment__movers": [{**PERSON, "speed_max_mps": 0.6}]},
        {"vehicle__velocity_error_mps": [0.1, 0.3]},
        {"sensor__detection_range_m": 12.0},
        {"vehicle__heading_error_deg": 3.0},
        {"vehicle__tracking_error_m": 0.5},
    ],
)
def test_what_makes_the_view_in_view_wider(changes: dict[str, Any]) -> None:
    assert (
        clauses_of(in_view(**changes))["passive_in_view.person"][0]
        > clauses_of(in_view())["passive_in_view.person"][0]
    )


def test_the_operators_word_covers_the_way_into_the_cruise() -> None:
    """At 0.5 m/s a mover comes 0.5 m nearer for each second until the vehicle cruises or rests."""
    terms = Terms.of(in_view())
    word_m = start_clear_of_movers_m(terms, derive(terms, SCALAR))
    vehicle = stop(terms)
    least_m = vehicle.fixed_m + 0.5 * vehicle.time_s(terms.reaction_time_s)
    assert least_m + 1.0 < word_m < least_m + 4.0
    slower = Terms.of(in_view(environment__movers=[{**PERSON, "speed_max_mps": 0.3}]))
    assert start_clear_of_movers_m(slower, derive(slower, SCALAR)) < word_m


@pytest.mark.parametrize(
    "changes",
    [
        {"vehicle__rest_settle_s": 0.0},
        {"vehicle__setpoint_loss": {
            "model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8}},
        HEIGHTS,
    ],
)  # fmt: skip
def test_no_level_is_stated_that_could_not_be_required(changes: dict[str, Any]) -> None:
    slow = [{**PERSON, "speed_max_mps": 0.2}]
    far = {"sensor__detection_range_m": 40.0, "sensor__all_round_range_m": 40.0}
    off = {"requirements__movers": "none", "environment__movers": slow, **far}
    assert assess(contract(**off)).mover_levels[0].level == "passive"
    assert assess(contract(**off, **changes)).mover_levels[0].level is None


@pytest.mark.parametrize(
    ("changes", "above_m"),
    [
        # By hand: body 0.25, control 0.5, drift of the flight 0.8, 5 cm, and the top.
        ({}, 0.25 + 0.5 + 0.8 + 0.05 + 2.3),
        ({"environment__terrain_max_m": 1.5}, 0.25 + 0.5 + 0.8 + 0.05 + 2.3 + 1.5),
        ({"environment__terrain_error_m": 0.3}, 0.25 + 0.5 + 0.8 + 0.05 + 2.3 + 0.3),
        ({"vehicle__estimator_reset_max_m": 0.4}, 0.25 + 0.5 + 0.8 + 0.05 + 2.3 + 0.4),
        ({"environment__movers": [{**LOW, "top_max_m": 4.1}]}, 0.25 + 0.5 + 0.8 + 0.05 + 4.1),
    ],
)
def test_what_stays_lower_than_the_flight_is_flown_over(
    changes: dict[str, Any], above_m: float
) -> None:
    over = contract(**{**HEIGHTS, "vehicle__tracking_error_z_m": 0.5,
                       "environment__movers": [LOW], **changes})  # fmt: skip
    for altitude_m, level in ((above_m - 0.01, None), (above_m + 0.01, "flown over")):
        seen = assess(over, mission_altitude_m=altitude_m)
        (clause,) = [each for each in seen.clauses if each.name.startswith("flown_over")]
        assert clause.required == pytest.approx(above_m)
        assert clause.holds is (level is not None)
        assert seen.mover_levels[0].level == level
    assert str(seen.mover_levels[0]) == f"person 1.5 m/s: flown over, above {above_m:.2f} m"


def test_what_flies_is_not_covered_beside_heights() -> None:
    """It is said, where nothing is required; and a new key changes no older hash."""
    blind = contract(**{**HEIGHTS, "requirements__movers": "none", "environment__movers": [DRONE]})
    (level,) = assess(blind, mission_altitude_m=20.0).mover_levels
    assert str(level).endswith("NOT COVERED, it may come from above or below the vertical view")
    open_top = contract(environment__movers=[{**PERSON, "top_max_m": None}])
    assert open_top.sha256 == contract().sha256
    assert contract(environment__movers=[LOW]).sha256 != contract().sha256


def test_an_uncovered_class_breaks_the_contract_that_requires_it() -> None:
    assert assess(contract()).compliant
    broken = [c.name for c in assess(contract(environment__movers=[DRONE])).clauses if not c.holds]
    assert "passive_range.drone" in broken
    assert "all_round.drone" in broken
    without = contract(environment__movers=[DRONE], requirements__movers="none")
    assert assess(without).compliant


def test_the_table_of_the_theory() -> None:
    """T1 at 15 degrees and 2.8 m/s: t_set 0, no acceleration, no stamp error."""
    table = Stop(1.30, 2.9, 2.628, 0.2, 0.0, 0.0)
    for v_o, front_m in ((0.0, 4.2), (0.5, 5.0), (1.5, 6.5), (5.0, 12.0), (15.0, 27.5)):
        stamp_m = (2.9 + v_o) * STAMP_ERROR_S
        assert passive_range_m(table, 0.25, v_o) - stamp_m == pytest.approx(front_m, abs=0.06)


# ---------------------------------------------------------------------- against brute force


@given(
    v_o=st.floats(0.1, 15.0),
    speed=st.floats(0.5, 8.0),
    tau=st.floats(0.05, 0.5),
    settle=st.floats(0.0, 1.0),
    share=st.sampled_from((1.0, 0.9)),
)
@settings(max_examples=60, deadline=None)
def test_pursuers_touch_at_nine_tenths_of_the_range_and_never_outside(
    v_o: float, speed: float, tau: float, settle: float, share: float
) -> None:
    """Simulate reference and mover in steps of 2 ms, straight on, still accelerating at first."""
    terms = replace(TERMS, cruise_speed_mps=speed, reaction_time_s=tau, rest_settle_s=settle)
    vehicle = stop(terms)
    gap_m = share * passive_range_m(vehicle, tau, v_o)
    step_s, time_s, x_m, v_mps = 0.002, 0.0, 0.0, vehicle.speed_mps
    braking_from_s = tau + terms.attitude_lag_s * (1.0 + vehicle.accelerating)
    touched = False
    at_rest_s = math.inf
    while time_s < at_rest_s + settle:
        if time_s >= braking_from_s:
            v_mps = max(0.0, v_mps - vehicle.brake_mps2 * step_s)
        if v_mps == 0.0 and at_rest_s == math.inf:
            at_rest_s = time_s
        x_m += v_mps * step_s
        time_s += step_s
        touched |= x_m + v_o * time_s + vehicle.fixed_m >= gap_m + 2.0 * (v_mps + v_o) * step_s
    assert touched == (share < 1.0)


@given(bearing_deg=st.floats(0.0, 180.0), v_o=st.floats(0.1, 5.0))
@settings(max_examples=60, deadline=None)
def test_who_is_outside_view_and_ring_cannot_reach_a_stopping_vehicle(
    bearing_deg: float, v_o: float
) -> None:
    ring_m = all_round_m(TERMS, DERIVED, vehicle := stop(TERMS), v_o, SCALAR)
    bearing_rad = math.radians(bearing_deg)
    half_rad = TERMS.sure_view_rad / 2.0 - NOSE_TOLERANCE_RAD
    front_m = passive_range_m(vehicle, TERMS.reaction_time_s, v_o)
    from_m = front_m if bearing_rad < half_rad else ring_m
    x_m, y_m = from_m * math.cos(bearing_rad), from_m * math.sin(bearing_rad)
    total_s, step_s = vehicle.time_s(TERMS.reaction_time_s), 0.01
    braking_s = vehicle.speed_mps / vehicle.brake_mps2
    dead_s = total_s - braking_s - TERMS.rest_settle_s
    for index in range(int(total_s / step_s)):
        now_s = index * step_s
        left_s = min(max(now_s - dead_s, 0.0), braking_s)
        made_m = (
            vehicle.speed_mps * min(now_s, dead_s)
            + vehicle.speed_mps * left_s
            - vehicle.brake_mps2 * left_s**2 / 2.0
        )
        assert math.hypot(x_m - made_m, y_m) > v_o * now_s + vehicle.fixed_m


def test_the_dead_daemon_clause_has_the_reaction_time() -> None:
    """At 1.5 m/s and a reaction of 0.25 s, leaving it out is short by (V_e + v_o) tau."""
    vehicle = stop(TERMS)
    later = replace(TERMS, reaction_time_s=TERMS.reaction_time_s + 0.1)
    more_m = dead_daemon_range_m(later, DERIVED, vehicle, 1.5) - dead_daemon_range_m(
        TERMS, DERIVED, vehicle, 1.5
    )
    assert more_m == pytest.approx(0.1 * (vehicle.speed_mps + 1.5))


def test_a_measured_run_time_replaces_the_model() -> None:
    vehicle = stop(TERMS)
    slow = replace(TERMS, setpoint_loss_run_time_s=5.0)
    model_s = TERMS.setpoint_loss_timeout_s + vehicle.lag_s + vehicle.speed_mps / vehicle.brake_mps2
    more_m = dead_daemon_range_m(slow, DERIVED, vehicle, 2.0) - dead_daemon_range_m(
        TERMS, DERIVED, vehicle, 2.0
    )
    assert more_m == pytest.approx(2.0 * (5.0 - model_s))


def test_in_view_needs_a_vehicle_twice_as_fast() -> None:
    assert in_view_rad(TERMS, DERIVED, stop(TERMS), 1.5, SCALAR) > 2.0 * math.pi
    view_rad = in_view_rad(TERMS, DERIVED, stop(TERMS), 0.5, SCALAR)
    assert math.radians(30.0) < view_rad < math.radians(120.0)


def test_requirements_grow_with_speed_so_that_bisection_may_search() -> None:
    speeds = (0.5, 1.0, 2.0, 2.8)
    for name in ("passive_range.person", "passive_dead_daemon.person", "all_round.person"):
        found = []
        for speed in speeds:
            clauses = assess(contract(vehicle__cruise_speed_mps=speed)).clauses
            found += [clause.required for clause in clauses if clause.name == name]
        assert found == sorted(found)
        assert len(found) == len(speeds)


def test_stoppable_is_the_way_of_braking_at_once() -> None:
    vehicle = stop(TERMS)
    way_m = vehicle.speed_mps * (TERMS.attitude_lag_s + TICK_S)
    way_m += vehicle.speed_mps**2 / (2.0 * vehicle.brake_mps2)
    assert stoppable_m(TERMS, vehicle, TICK_S) == pytest.approx(way_m)


def test_a_class_in_a_file_is_named_class() -> None:
    mover = MoverClass.model_validate(PERSON)
    assert mover.model_dump(mode="json") == {**PERSON, "hidden": False, "top_max_m": None}
