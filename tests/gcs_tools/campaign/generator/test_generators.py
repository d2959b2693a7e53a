"""The generators draw the flights that they drew before, and those have what their name says."""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from typing import Any

import pytest

from gcs_tools.campaign.command import scenario_document
from gcs_tools.campaign.generator.airframes import airframe_of
from gcs_tools.campaign.generator.case import NO_FAULT, FlightCase
from gcs_tools.campaign.generator.faults import (
    DISPLACING,
    FAULT_KINDS,
    TOLERATED,
    UNDETECTABLE,
    all_tolerated,
)
from gcs_tools.campaign.generator.fields import ned_m
from gcs_tools.campaign.generator.generators import GENERATORS, generated
from gcs_tools.preflight.command import check
from onboard.contract.assessment import assess

SEED = 7
FLIGHTS = 100
# A campaign's seed and number must mean the same flight in every version; a change of what is
# drawn changes these, and has to be stated in docs/campaigns.md.
DIGESTS = {
    "nominal": "cb19ad7e0e201a30",
    "violating": "4327a5f37bf4f29b",
    "faults": "78c685ebbc1d1a5c",
    "outside": "6a86f580e2e84915",
    "competition": "64368921318d0599",
    "best-effort": "f3ee36056536f338",
    "best-effort-faults": "28247b695c5c5f24",
    "movers": "98cf49d4264923ab",
    "pedestrians": "e9524936d4f0546b",
    "ambush": "b2bd998bff926a8a",
    "faster-movers": "349a5fe2c50e1fae",
    "passed-movers": "984869bc47295fc6",
    "quick": "c2ec896834344007",
    "quick-faults": "6098990d5ea11549",
}


def rounded(value: Any) -> Any:
    """Nine digits: other mathematical libraries may differ in the last ones."""
    match value:
        case float():
            return float(f"{value:.9g}")
        case dict():
            return {key: rounded(each) for key, each in value.items()}
        case list() | tuple():
            return [rounded(each) for each in value]
        case _:
            return value


# Keys that came later, with their defaults: a draw that leaves them alone is the same flight.
LATER: dict[str, tuple[Any, ...]] = {
    "progress": ("guaranteed",),
    "flight_time_max_s": (None,),
    "position_drift_mps": (0.0,),
    "thinnest_obstacle_m": (None,),
    "no_return_is_free_to_m": (None,),
    "heading": ("leg",),
    "corridor_half_width_m": (None,),
    "on_end": ("hover",),
    "energy": (None,),
    "rest_settle_s": (0.0,),
    "rest_speed_mps": (0.2,),
    "setpoint_loss_run_time_s": (None,),
    "yield_max_s": (None,),
    "all_round_range_m": (0.0,),
    "movers": ("none", [], ()),  # of requirements, of the environment and of the simulator
    "message_version": (1,),
    "mover_motion": ("moving",),
    "mover_swap_share": (0.0,),
    "movers_hidden": (False,),
    "begins_within_m": (None,),
    "radius_z_m": (None,),
    "height_drift_m": (None,),
    "height_drift_flight_m": (None,),
    "top_max_m": (None,),
    "top_m": (None,),
    "position_error_z_m": (None,),
    "vertical_field_of_view_deg": (None,),
    "terrain_max_m": (0.0,),
    "terrain_error_m": (0.0,),
    "down_m": (None,),
    "start_clear_of_movers_m": (None,),
}


# Follows from what is drawn: the operator's word on a start that the field leaves clear.
FOLLOWS = {"start_clear_m"}


def without_later_keys(document: Any) -> Any:
    match document:
        case dict():
            return {
                key: without_later_keys(value)
                for key, value in document.items()
                if key not in FOLLOWS and (key not in LATER or value not in LATER[key])
            }
        case list() | tuple():
            return [without_later_keys(each) for each in document]
        case _:
            return document


def fingerprint(case: FlightCase) -> bytes:
    document = without_later_keys(scenario_document(case.scenario))
    expected = [case.variant, case.trigger, case.outcomes, case.covered, case.refusable]
    whole = [case.scenario.name, document, case.seed, *expected, case.expectation]
    return json.dumps(rounded(whole), sort_keys=True).encode()


def drawn(generator: str, count: int = 60) -> list[FlightCase]:
    return [generated(generator, SEED, number) for number in range(count)]


@pytest.mark.parametrize("generator", GENERATORS)
def test_seeds_mean_the_flights_that_they_meant_before(generator: str) -> None:
    digest = hashlib.sha256()
    for case in drawn(generator, FLIGHTS):
        digest.update(fingerprint(case))
    assert digest.hexdigest()[:16] == DIGESTS[generator]


def test_an_unknown_generator_is_an_error() -> None:
    with pytest.raises(KeyError):
        generated("kind", SEED, 0)


@pytest.mark.parametrize("generator", GENERATORS)
def test_a_flight_is_named_after_what_replays_it(generator: str) -> None:
    assert generated(generator, SEED, 5).scenario.name == f"{generator}-{SEED}-5"


def test_nominal_flights_have_no_fault_and_must_arrive() -> None:
    for case in drawn("nominal"):
        assert case.scenario.faults == ()
        assert (case.variant, case.outcomes, case.covered) == (NO_FAULT, ("arrived",), True)
        assert not case.scenario.fly_outside_contract


def test_quick_flights_are_short_and_start_in_hover() -> None:
    for case in drawn("quick", 30):
        mission = case.scenario.mission
        assert case.scenario.plant.start.position_ned_m[2] == -mission.altitude_m
        assert 16.0 <= math.hypot(*mission.legs[0].end_ned_m) <= 20.0
        assert 1 <= len(case.scenario.obstacles) <= 3


def test_breaches_in_the_field_are_unknown_before_the_flight() -> None:
    cases = drawn("violating", 80)
    assert {case.variant for case in cases} == {"larger", "closer", "range", "speed"}
    for case in cases:
        in_field = case.variant in {"larger", "closer"}
        assert case.scenario.field_known is not in_field
        assert case.outcomes == (("arrived", "held", "aborted") if in_field else ("aborted",))


def test_a_breach_of_size_or_separation_breaks_just_that_rule() -> None:
    for case in drawn("violating", 80):
        if case.variant not in {"larger", "closer"}:
            continue
        scenario = case.scenario
        found = check(scenario.contract, scenario.obstacles, scenario.mission)
        assert found.assessment.compliant
        broken = {rule.name for rule in found.field_rules if not rule.holds}
        assert ("obstacle_size_max" if case.variant == "larger" else "separation") in broken


def test_what_is_promised_follows_from_the_kind_of_fault() -> None:
    for case in drawn("faults", 300):
        kind = case.scenario.faults[-1].kind
        assert case.variant == kind
        assert case.covered is (kind not in UNDETECTABLE | DISPLACING)
        arrives = case.outcomes == ("arrived",)
        assert arrives is all_tolerated(case.scenario)
        assert case.trigger


def test_kinds_of_fault_are_in_one_class_at_most() -> None:
    assert set(FAULT_KINDS) > UNDETECTABLE | DISPLACING | TOLERATED
    assert not UNDETECTABLE & DISPLACING
    assert not TOLERATED & (UNDETECTABLE | DISPLACING)


def test_a_hold_or_standby_is_led_to_by_another_fault() -> None:
    led = 0
    for case in drawn("faults", 300):
        *before, fault = case.scenario.faults
        if fault.phase not in {"hold", "standby"}:
            assert before == []
            continue
        expected = "detections_off" if fault.phase == "hold" else "operator_takes_over"
        assert [each.kind for each in before] == ([] if fault.kind == expected else [expected])
        led += bool(before)
    assert led > 10


def test_best_effort_flies_what_no_separation_covers() -> None:
    headings = set()
    for case in drawn("best-effort", 12):
        scenario = case.scenario
        found = check(scenario.contract, None, scenario.mission)
        assert scenario.contract.requirements.progress == "best_effort"
        assert found.may_fly
        assert not found.compliant
        assert (case.outcomes, case.covered) == (("arrived", "held"), True)
        assert not scenario.field_known
        headings.add(scenario.mission.heading)
    assert headings == {"leg", "path"}


def test_faults_with_best_effort_are_drawn_in_its_own_phases() -> None:
    cases = drawn("best-effort-faults", 40)
    assert all(case.scenario.faults for case in cases)
    phases = {fault.phase for case in cases for fault in case.scenario.faults}
    assert {"thread", "pause", "hold", "standby"} <= phases
    assert not {"cruise", "avoid"} & phases


def test_outside_flights_head_straight_for_one_obstacle_of_the_largest_size() -> None:
    for case in drawn("outside", 30):
        scenario = case.scenario
        size_max_m = scenario.contract.environment.obstacle_size_max_m
        assert len(scenario.obstacles) == 1
        assert scenario.obstacles.half_size_m.tolist() == [[size_max_m / 2.0] * 2]
        north_m, east_m = scenario.obstacles.center_ned_m[0]
        end_north_m, end_east_m = scenario.mission.legs[0].end_ned_m
        aside_m = (north_m * end_east_m - east_m * end_north_m) / math.hypot(
            end_north_m, end_east_m
        )
        assert abs(aside_m) < 1e-9
        assert not case.covered
        assert "collided" in case.outcomes
        assert len(scenario.faults) == 1


def test_competition_fields_may_be_refused() -> None:
    cases = drawn("competition", 40)
    assert all(case.refusable for case in cases)
    assert {len(case.scenario.obstacles) for case in cases} == {1, 2, 3}
    for case in cases:
        sizes_m = 2.0 * case.scenario.obstacles.half_size_m
        assert sizes_m.min() >= 2.0
        assert sizes_m.max() <= 20.0
        assert assess(case.scenario.contract).compliant


@pytest.mark.parametrize("generator", ["nominal", "faults", "best-effort", "best-effort-faults"])
def test_most_flights_have_the_errors_of_the_field_and_contracts_that_declare_them(
    generator: str,
) -> None:
    flown = Counter[tuple[str, str]]()
    for case in drawn(generator):
        plant, vehicle = case.scenario.plant, case.scenario.contract.vehicle
        flown[plant.realism, plant.flavour] += 1
        as_in_the_field = plant.realism == "field"
        assert (vehicle.heading_error_deg > 0.0) is as_in_the_field
        if as_in_the_field:
            assert {sensor.frame for sensor in plant.sensors} == {"body_frd"}
    assert set(flown) == {("field", "px4"), ("field", "ardupilot"), ("ideal", "px4")}
    assert min(flown["field", "px4"], flown["field", "ardupilot"]) >= 15
    assert 4 <= flown["ideal", "px4"] <= 20


@pytest.mark.parametrize("generator", ["quick", "quick-faults", "outside"])
def test_flights_that_have_no_room_for_the_errors_of_the_field_are_ideal(generator: str) -> None:
    assert {case.scenario.plant.realism for case in drawn(generator, 20)} == {"ideal"}


def test_a_sensor_s_errors_stay_within_the_contract() -> None:
    for case in drawn("nominal"):
        (sensor,) = case.scenario.plant.sensors
        declared_m = case.scenario.contract.sensor.position_error_m
        error_m = declared_m - airframe_of(case.scenario.plant).wander_m
        assert sensor.noise_m + (sensor.face_noise_m or 0.0) <= error_m * math.sqrt(0.5) + 1e-12
        assert sensor.uncertainty_m == declared_m


@pytest.mark.parametrize(
    ("heading_deg", "expected"),
    [(0.0, (3.0, 1.0)), (90.0, (-1.0, 3.0)), (180.0, (-3.0, -1.0)), (-90.0, (1.0, -3.0))],
)
def test_a_leg_turns_into_north_and_east(heading_deg: float, expected: tuple[float, float]) -> None:
    assert ned_m(math.radians(heading_deg), 3.0, 1.0) == pytest.approx(expected)
