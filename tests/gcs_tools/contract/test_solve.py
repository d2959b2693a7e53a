"""``clearway contract solve``: the limit it names is the limit."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gcs_tools.contract import solve as contract_solve
from gcs_tools.contract.keys import contract_key, numeric_keys
from gcs_tools.contract.solve import Trial, solve
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract, load_contract
from tests.gcs_tools.running import CONTRACTS, Clearway

EXAMPLE_PATH = CONTRACTS / "precise_vehicle.yaml"
# A drift is nothing without the time that it lasts.
EXAMPLE = load_contract(EXAMPLE_PATH, ("requirements.flight_time_max_s=600",))

# Heights are stated all together; what else they need is no clause.
HEIGHTS = (
    "vehicle.radius_z_m=0.5", "vehicle.height_drift_m=0.2", "sensor.position_error_z_m=0.1",
    "sensor.vertical_field_of_view_deg=[60, 60]",
)  # fmt: skip
OF_HEIGHTS = [
    "vehicle.radius_z_m", "vehicle.height_drift_m", "sensor.position_error_z_m",
    "sensor.vertical_field_of_view_deg.0", "sensor.vertical_field_of_view_deg.1",
]  # fmt: skip
# All but the two that any value of satisfies, see below.
KEYS = [
    key
    for key in numeric_keys()
    if key != "environment.obstacle_size_min_m" and key not in OF_HEIGHTS
]


def complies(key: str, value: float, contract: Contract = EXAMPLE) -> bool:
    return assess(contract_key(key).changed(contract, value)).compliant


def broken(key: str, value: float) -> set[str]:
    clauses = assess(contract_key(key).changed(EXAMPLE, value)).clauses
    return {clause.name for clause in clauses if not clause.holds}


@pytest.mark.parametrize("key", KEYS)
def test_limits_are_exact_and_strict(key: str) -> None:
    solution = solve(EXAMPLE, key)
    assert solution.intervals
    for interval in solution.intervals:
        for limit, outward in ((interval.lower, -1.0), (interval.upper, 1.0)):
            if limit is None:
                continue
            step = abs(limit.value) * 1e-9
            assert complies(key, limit.value)
            assert not complies(key, limit.value + outward * step)
            assert limit.beyond.clause in broken(key, limit.value + outward * step)
            assert complies(key, limit.value - outward * 1e3 * step)


@pytest.mark.parametrize("key", KEYS)
def test_the_answer_agrees_with_dense_trials(key: str) -> None:
    solution = solve(EXAMPLE, key)
    bounds = [
        (
            interval.lower.value if interval.lower else -math.inf,
            interval.upper.value if interval.upper else math.inf,
        )
        for interval in solution.intervals
    ]
    described = contract_key(key)
    low = described.lower + 1e-3
    high = min(described.upper, 60.0) - 1e-3
    for step in range(200):
        value = low + (high - low) * step / 199.0
        assert complies(key, value) == any(lo <= value <= hi for lo, hi in bounds), value


@pytest.mark.parametrize("key", OF_HEIGHTS)
def test_a_height_has_an_answer_where_the_others_are_stated(key: str) -> None:
    alone = solve(EXAMPLE, key)
    assert not alone.intervals
    assert alone.closest is not None
    assert "pillars of any height" in str(alone.closest.reason)
    stated = load_contract(EXAMPLE_PATH, HEIGHTS)
    assert assess(stated).compliant
    value, intervals = contract_key(key).value_in(stated), solve(stated, key).intervals
    assert value is not None
    assert any(
        (each.lower is None or each.lower.value <= value)
        and (each.upper is None or value <= each.upper.value)
        for each in intervals
    )


def test_fastest_speed_has_its_closed_form() -> None:
    """Pointed: D = V t* - b t*²/2 at the detection range, for a point that swerves."""
    ideal = {
        "radius_m": 0.0,
        "tracking_error_m": 0.0,
        "velocity_error_mps": (0.0, 0.0),
        "reaction_time_s": 0.0,
        "attitude_lag_s": 0.0,
    }
    document = EXAMPLE.model_dump()
    document["vehicle"] |= ideal
    document["sensor"] |= {"position_error_m": 0.0, "detection_range_m": 6.0}
    document["environment"] |= {"obstacle_separation_min_m": 1000.0}
    document["requirements"] = {"stop": False, "passive_safety": False}
    solution = solve(Contract.model_validate(document), "vehicle.cruise_speed_mps")
    limit = solution.limit
    assert limit is not None
    # The corner at S = 4 m has to be seen at 6 m: D = √(36 - 16) m.
    b = 9.80665 * math.tan(math.radians(15.0))
    clear_s = math.sqrt(4.0 / b)
    assert limit.value == pytest.approx(math.sqrt(20.0) / clear_s + b * clear_s / 2.0, rel=1e-9)
    assert limit.beyond.clause == "edge_visibility"


@settings(max_examples=6)
@example(range_m=9.5, separation_m=10.0)  # passive safety asks for 0.4 m more at once
@given(st.floats(7.0, 30.0), st.floats(10.0, 40.0))
def test_solving_back_and_forth(range_m: float, separation_m: float) -> None:
    """The smallest range that complies with the fastest speed is the range it was found for.

    Or less, where a requirement jumps up just beyond that speed.
    """
    document = EXAMPLE.model_dump()
    document["sensor"]["detection_range_m"] = range_m
    document["environment"]["obstacle_separation_min_m"] = 1e5
    contract = Contract.model_validate(document)
    fastest = solve(contract, "vehicle.cruise_speed_mps").limit
    assert fastest is not None
    changed = contract_key("vehicle.cruise_speed_mps").changed(contract, fastest.value)
    nearest = solve(changed, "sensor.detection_range_m").limit
    assert nearest is not None
    if nearest.value != pytest.approx(range_m, rel=1e-9):
        faster = contract_key("vehicle.cruise_speed_mps").changed(contract, fastest.value + 1e-6)
        assert nearest.value < range_m
        assert not assess(faster).compliant


def test_direction_is_part_of_the_answer() -> None:
    assert solve(EXAMPLE, "vehicle.cruise_speed_mps").answer == "largest"
    assert solve(EXAMPLE, "sensor.detection_range_m").answer == "smallest"
    assert solve(EXAMPLE, "environment.obstacle_separation_min_m").answer == "smallest"
    assert solve(EXAMPLE, "vehicle.tracking_error_m").answer == "largest"
    assert solve(EXAMPLE, "vehicle.pitch_max_deg").answer == "between"


def test_a_measured_run_ends_the_speeds_that_are_admissible() -> None:
    roomy = load_contract(
        EXAMPLE_PATH,
        ("vehicle.setpoint_loss_run_on_m=3.0", "environment.obstacle_separation_min_m=10000.0"),
    )
    limit = solve(roomy, "vehicle.cruise_speed_mps").limit
    assert limit is not None
    assert limit.value == pytest.approx(2.8)
    assert limit.beyond.clause is None
    assert "setpoint_loss_run_on_speed_mps = 2.8 m/s" in limit.beyond.reason
    modelled = load_contract(EXAMPLE_PATH, ("environment.obstacle_separation_min_m=10000.0",))
    beyond = solve(modelled, "vehicle.cruise_speed_mps").limit
    assert beyond is not None
    assert beyond.value > 2.8
    # The speed of the run itself may be anything from the cruise speed on.
    speed = solve(roomy, "vehicle.setpoint_loss_run_on_speed_mps")
    assert speed.intervals[0].lower is not None
    assert speed.intervals[0].lower.value == pytest.approx(2.8)


def test_a_cruise_above_the_measured_run_is_one_line(clearway: Clearway, config: Path) -> None:
    faster = ("--set", "vehicle.cruise_speed_mps=4")
    for command in (
        ("contract", "show"),
        ("contract", "solve", "--for", "sensor.detection_range_m"),
        ("contract", "surface", "--figure", "11"),
        ("preflight",),
    ):
        ran = clearway(*command, "--contract", config / "px4_contract.yaml", *faster)
        assert ran.code == 2
        assert ran.err.count("\n") == 1
        assert "vehicle.cruise_speed_mps = 4 m/s exceeds" in ran.err


def test_every_value_complies() -> None:
    document = EXAMPLE.model_dump()
    document["requirements"]["passive_safety"] = False
    solution = solve(Contract.model_validate(document), "vehicle.setpoint_loss_timeout_s")
    assert solution.answer == "always"
    assert solution.limit is None


def test_no_value_complies() -> None:
    """A sensor that sees 1 m ahead is not helped by any separation."""
    document = EXAMPLE.model_dump()
    document["sensor"]["detection_range_m"] = 1.0
    solution = solve(Contract.model_validate(document), "environment.obstacle_separation_min_m")
    assert solution.answer == "never"
    assert solution.closest is not None
    assert solution.closest.clause == "passive_safety"
    assert solution.closest.score < 0.0


def test_a_rule_of_the_file_is_a_limit_too() -> None:
    limit = solve(EXAMPLE, "environment.obstacle_size_min_m").limit
    assert limit is not None
    assert limit.value == pytest.approx(4.0, rel=1e-12)
    assert limit.beyond.clause is None
    assert "exceeds obstacle_size_max_m = 4.0 m" in limit.beyond.reason


def test_islands_and_gaps_between_samples_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict that changes twice within a step of the grid, once each way."""

    def scores(_contract: Contract, _key: object, _input_set: str, value: float) -> Trial:
        island = 1e-4 - abs(value - 3.33333)
        gap = abs(value - 7.77777) - 1e-4
        return Trial(value, gap if value > 5.0 else island, "some", "because")

    monkeypatch.setattr(contract_solve, "_try", scores)
    solution = solve(EXAMPLE, "vehicle.cruise_speed_mps")
    assert solution.answer == "several"
    ends = [
        end.value if end else None
        for interval in solution.intervals
        for end in (interval.lower, interval.upper)
    ]
    assert ends[:4] == pytest.approx([3.33323, 3.33343, 5.0, 7.77767], rel=1e-6)
    assert ends[4] == pytest.approx(7.77787)
    assert ends[5] is None


# --- command


def test_json(clearway: Clearway, config: Path) -> None:
    ran = clearway(
        "contract", "solve", "--contract", EXAMPLE_PATH,
        "--for", "vehicle.cruise_speed_mps", "--format", "json",
    )  # fmt: skip
    assert ran.code == 0
    document = json.loads(ran.out)
    limit = solve(EXAMPLE, "vehicle.cruise_speed_mps").limit
    assert limit is not None
    assert document["value"] == limit.value
    assert document["binding"] == limit.beyond.clause
    assert (document["answer"], document["unit"], document["declared"]) == ("largest", "m/s", 2.8)
    assert document["intervals"][0]["lower"] is None
    assert document["intervals"][0]["upper"]["value"] == limit.value
    assert document["contract_sha256"] == load_contract(EXAMPLE_PATH).sha256


def test_the_paper_set_is_solved_on_request(clearway: Clearway, config: Path) -> None:
    values = []
    for input_set in ("inner", "paper"):
        ran = clearway(
            "contract", "solve", "--contract", EXAMPLE_PATH, "--input-set",
            input_set, "--for", "environment.obstacle_separation_min_m", "--format", "json",
        )  # fmt: skip
        values.append(json.loads(ran.out)["value"])
    required_m = [
        assess(EXAMPLE, input_set).inflated.required_separation_m
        for input_set in ("inner", "paper")
    ]
    assert values == pytest.approx(required_m)
    assert values[0] != values[1]


@pytest.mark.parametrize(
    ("key", "overrides", "words"),
    [
        ("vehicle.cruise_speed_mps", (), ("complies up to 4.", "m/s", "above: passive_safety")),
        ("sensor.detection_range_m", (), ("complies from 6.", "below: passive_safety")),
        ("environment.obstacle_separation_min_m", ("sensor.detection_range_m=1",), ("no value",)),
        (
            "vehicle.setpoint_loss_timeout_s",
            ("requirements.passive_safety=false",),
            ("every admissible value",),
        ),
        ("vehicle.setpoint_loss_run_on_m", (), ("states nothing",)),
        ("vehicle.cruise_speed_mps", ("vehicle.setpoint_loss_run_on_m=3.0",), ("note: ",)),
    ],
)
def test_table(
    clearway: Clearway, config: Path, key: str, overrides: tuple[str, ...], words: tuple[str, ...]
) -> None:
    options: list[Any] = ["--set", *overrides] if overrides else []
    ran = clearway("contract", "solve", "--contract", EXAMPLE_PATH, "--for", key, *options)
    assert ran.code == 0
    for word in words:
        assert word in ran.out


@pytest.mark.parametrize(
    "key", ["vehicle.speed", "requirements.stop", "vehicle", "vehicle.velocity_error_mps", ""]
)
def test_keys_that_are_no_numbers(clearway: Clearway, config: Path, key: str) -> None:
    ran = clearway("contract", "solve", "--contract", EXAMPLE_PATH, "--for", key)
    assert ran.code == 2
    assert f"unknown numeric contract key {key!r}" in ran.err
    assert "did you mean vehicle." in ran.err or "expected one of vehicle." in ran.err


# No clause depends on wish and speed at rest; the ground is a term where it is stated.
NO_TERMS = {
    "vehicle.clearance_wish_m", "vehicle.rest_speed_mps",
    "environment.terrain_max_m", "environment.terrain_error_m",
}  # fmt: skip


@pytest.mark.parametrize("key", sorted(set(numeric_keys()) - set(OF_HEIGHTS)))
def test_every_key_is_a_term(key: str) -> None:
    described = contract_key(key)
    value = described.value_in(EXAMPLE)
    changed = described.changed(EXAMPLE, 3.5)
    assert described.value_in(changed) == 3.5
    if value is not None and key not in NO_TERMS:
        term = getattr(assess(EXAMPLE).terms, described.term)
        assert term == pytest.approx(value * described.term_per_unit)
    assert described.changed(changed, value if value is not None else 3.5) in {EXAMPLE, changed}
