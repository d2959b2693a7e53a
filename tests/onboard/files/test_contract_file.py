"""Contracts are read strictly, hashed by their terms, and changed by overrides alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.contract_file import (
    Contract,
    EnvironmentTerms,
    Requirements,
    SensorTerms,
    VehicleTerms,
    load_contract,
)
from onboard.files.yaml_file import (
    FileError,
    unit_of,
    validate,
)

VEHICLE: dict[str, Any] = {
    "roll_max_deg": 15.0,
    "pitch_max_deg": 15,
    "thrust_to_weight": 2.0,
    "cruise_speed_mps": 2.8,
    "radius_m": 0.3,
    "tracking_error_m": 0.25,
    "velocity_error_mps": [0.2, 0.1],
    "reaction_time_s": 0.15,
    "attitude_lag_s": 0.15,
}
SENSOR: dict[str, Any] = {
    "detection_range_m": 12.0,
    "field_of_view_deg": 120.0,
    "frame_age_max_s": 0.3,
    "position_error_m": 0.05,
}
ENVIRONMENT: dict[str, Any] = {
    "obstacle_size_max_m": 4.0,
    "obstacle_size_min_m": 0.0,
    "obstacle_separation_min_m": 20.0,
}
CONTRACT: dict[str, Any] = {"vehicle": VEHICLE, "sensor": SENSOR, "environment": ENVIRONMENT}


@pytest.fixture
def contract_path(tmp_path: Path) -> Path:
    path = tmp_path / "contract.yaml"
    path.write_text(yaml.safe_dump(CONTRACT), encoding="utf-8")
    return path


def changed(section: str, key: str, value: Any) -> dict[str, Any]:
    return CONTRACT | {section: CONTRACT[section] | {key: value}}


def refusal(document: Any) -> str:
    with pytest.raises(FileError) as caught:
        validate(document, Contract, source="c.yaml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("c.yaml: ")
    return message.removeprefix("c.yaml: ")


def test_a_contract_is_read_as_written(contract_path: Path) -> None:
    contract = load_contract(contract_path)
    assert contract.vehicle.cruise_speed_mps == 2.8
    assert contract.vehicle.pitch_max_deg == 15.0
    assert contract.vehicle.velocity_error_mps == (0.2, 0.1)
    assert contract.sensor.field_of_view_deg == 120.0
    assert contract.environment.obstacle_size_max_m == 4.0


def test_what_may_be_left_out(contract_path: Path) -> None:
    contract = load_contract(contract_path)
    assert contract.requirements == Requirements(stop=True, passive_safety=True)
    assert contract.vehicle.setpoint_loss_timeout_s == 1.0
    assert contract.vehicle.setpoint_loss_run_on_m is None


@pytest.mark.parametrize(
    ("section", "key"),
    [(name, key) for name, section in CONTRACT.items() for key in section],
)
def test_everything_else_must_be_stated(section: str, key: str) -> None:
    without = {name: value for name, value in CONTRACT[section].items() if name != key}
    assert refusal(CONTRACT | {section: without}) == (
        f"{section}.{key}{f' [{unit_of(key)}]' if unit_of(key) else ''} is missing"
    )


@pytest.mark.parametrize("section", CONTRACT)
def test_a_missing_section_is_named(section: str) -> None:
    without = {name: value for name, value in CONTRACT.items() if name != section}
    assert refusal(without) == f"{section} is missing"


@pytest.mark.parametrize(
    ("section", "key", "value", "parts"),
    [
        ("vehicle", "roll_max_deg", 90.0, ("vehicle.roll_max_deg [°] = 90.0", "less than 90")),
        ("vehicle", "pitch_max_deg", 0.0, ("vehicle.pitch_max_deg [°] = 0.0", "greater than 0")),
        ("vehicle", "pitch_max_deg", 120, ("vehicle.pitch_max_deg [°] = 120", "less than 90")),
        ("vehicle", "cruise_speed_mps", 0.0, ("cruise_speed_mps [m/s] = 0.0", "greater than 0")),
        ("vehicle", "cruise_speed_mps", -2.8, ("cruise_speed_mps [m/s] = -2.8", "greater than 0")),
        ("vehicle", "cruise_speed_mps", "2.8 m/s", ("'2.8 m/s'", "valid number")),
        ("vehicle", "cruise_speed_mps", True, ("= True", "valid number")),
        ("vehicle", "cruise_speed_mps", float("nan"), ("= nan", "finite number")),
        ("vehicle", "cruise_speed_mps", float("inf"), ("= inf", "finite number")),
        ("vehicle", "thrust_to_weight", 1.0, ("[times the weight] = 1.0", "greater than 1")),
        ("vehicle", "radius_m", -0.1, ("vehicle.radius_m [m] = -0.1", "equal to 0")),
        ("vehicle", "velocity_error_mps", [0.1, -0.2], ("mps.1 [m/s] = -0.2", "equal to 0")),
        ("vehicle", "velocity_error_mps", [0.1], ("velocity_error_mps.1 [m/s] is missing",)),
        ("vehicle", "velocity_error_mps", 0.1, ("velocity_error_mps [m/s] = 0.1", "tuple")),
        ("vehicle", "reaction_time_s", -1.0, ("reaction_time_s [s] = -1.0", "equal to 0")),
        ("vehicle", "setpoint_loss_run_on_m", -1.0, ("run_on_m [m] = -1.0", "equal to 0")),
        ("vehicle", "setpoint_loss_run_on_speed_mps", 0.0, ("[m/s] = 0.0", "greater than 0")),
        ("vehicle", "tracking_error_z_m", -0.1, ("error_z_m [m] = -0.1", "equal to 0")),
        ("vehicle", "heading_error_deg", 45.0, ("heading_error_deg [°] = 45.0", "less than 45")),
        ("vehicle", "heading_error_deg", -1.0, ("heading_error_deg [°] = -1.0", "equal to 0")),
        ("vehicle", "estimator_reset_max_m", -1.0, ("reset_max_m [m] = -1.0", "equal to 0")),
        ("vehicle", "drag_per_s", -0.1, ("drag_per_s [1/s] = -0.1", "equal to 0")),
        ("environment", "wind_max_mps", -1.0, ("wind_max_mps [m/s] = -1.0", "equal to 0")),
        ("environment", "wind_max_mps", "calm", ("wind_max_mps", "'calm'", "valid number")),
        ("sensor", "field_of_view_deg", 361.0, ("[°] = 361.0", "less than or equal to 360")),
        ("sensor", "detection_range_m", 0.0, ("detection_range_m [m] = 0.0", "greater than 0")),
        ("sensor", "frame_age_max_s", 0, ("frame_age_max_s [s] = 0", "greater than 0")),
        ("environment", "obstacle_size_max_m", 0.0, ("[m] = 0.0", "greater than 0")),
        ("vehicle", "cruise_speed", 2.8, ("vehicle.cruise_speed is not a known key (value 2.8)",)),
    ],
)
def test_bad_values_are_named(section: str, key: str, value: Any, parts: tuple[str, ...]) -> None:
    message = refusal(changed(section, key, value))
    for part in parts:
        assert part in message


def test_every_problem_is_reported_at_once() -> None:
    document = changed("vehicle", "radius_m", -1.0) | {"sensor": SENSOR | {"range": 3.0}}
    message = refusal(document)
    assert "vehicle.radius_m" in message
    assert "; sensor.range is not a known key" in message


def test_sizes_are_ordered() -> None:
    message = refusal(changed("environment", "obstacle_size_min_m", 5.0))
    assert "obstacle_size_min_m = 5.0 m exceeds obstacle_size_max_m = 4.0 m" in message
    assert validate(changed("environment", "obstacle_size_min_m", 4.0), Contract, source="c")


def test_a_contract_cannot_be_changed(contract_path: Path) -> None:
    contract = load_contract(contract_path)
    with pytest.raises(ValueError, match="frozen"):
        contract.vehicle.radius_m = 0.0  # type: ignore[misc]  # that is what is tested


# --- hash


def test_the_hash_is_that_of_the_terms(contract_path: Path, tmp_path: Path) -> None:
    contract = load_contract(contract_path)
    other = tmp_path / "same.yaml"
    reordered = {name: dict(reversed(CONTRACT[name].items())) for name in reversed(CONTRACT)}
    reordered["vehicle"]["cruise_speed_mps"] = 2.80
    reordered["requirements"] = {"stop": True}
    other.write_text("# the same terms\n" + yaml.safe_dump(reordered, sort_keys=False))
    assert load_contract(other).sha256 == contract.sha256
    assert len(contract.sha256) == 64


@pytest.mark.parametrize(
    "override",
    [
        "vehicle.tracking_error_z_m=1.1",
        "vehicle.heading_error_deg=1.0",
        "vehicle.estimator_reset_max_m=0.1",
        "vehicle.drag_per_s=0.4",
        "environment.wind_max_mps=0.0",
        "vehicle.radius_m=0.3000001",
        "requirements.stop=false",
        "vehicle.velocity_error_mps=[0.2, 0.11]",
        "vehicle.setpoint_loss_run_on_m=4.0",
        "requirements.progress=best_effort",
        "environment.obstacle_separation_min_m=[20.0, 20.0]",
    ],
)
def test_another_term_is_another_hash(contract_path: Path, override: str) -> None:
    changed_contract = load_contract(contract_path, (override,))
    assert changed_contract.sha256 != load_contract(contract_path).sha256


def test_the_speed_of_a_run_counts_only_where_it_is_another(contract_path: Path) -> None:
    run, speed = "vehicle.setpoint_loss_run_on_m=4.0", "vehicle.setpoint_loss_run_on_speed_mps={}"
    implied = load_contract(contract_path, (run,))
    assert implied.vehicle.setpoint_loss_run_on_speed_mps == 2.8
    assert load_contract(contract_path, (run, speed.format(2.8))).sha256 == implied.sha256
    assert load_contract(contract_path, (run, speed.format(3.0))).sha256 != implied.sha256


def test_later_keys_at_their_defaults_are_not_in_the_hash(contract_path: Path) -> None:
    stated = (
        "vehicle.tracking_error_z_m=1.0",
        "vehicle.heading_error_deg=0",
        "vehicle.estimator_reset_max_m=0",
        "vehicle.drag_per_s=0.45",
        "vehicle.clearance_wish_m=0",
        "environment.wind_max_mps=null",
        "vehicle.setpoint_loss_run_on_speed_mps=null",
        "requirements.progress=guaranteed",
        "requirements.flight_time_max_s=null",
        "vehicle.position_drift_mps=0",
        "sensor.thinnest_obstacle_m=null",
        "sensor.no_return_is_free_to_m=null",
    )
    assert load_contract(contract_path, stated).sha256 == load_contract(contract_path).sha256


def test_a_wish_for_clearance_is_in_the_hash_and_not_negative(contract_path: Path) -> None:
    wishing = load_contract(contract_path, ("vehicle.clearance_wish_m=1.5",))
    assert wishing.vehicle.clearance_wish_m == 1.5
    assert wishing.sha256 != load_contract(contract_path).sha256
    with pytest.raises(FileError, match="clearance_wish_m"):
        load_contract(contract_path, ("vehicle.clearance_wish_m=-0.1",))


# --- what stands for a number


@pytest.mark.parametrize(("stated", "any_way_m"), [("5.0", 5.0), ("[3.0, 4.0]", 5.0)])
def test_a_separation_is_a_number_or_a_pair(
    contract_path: Path, stated: str, any_way_m: float
) -> None:
    key = f"environment.obstacle_separation_min_m={stated}"
    environment = load_contract(contract_path, (key,)).environment
    assert environment.separation_any_way_m == any_way_m
    assert environment.separation_box_m == ((3.0, 4.0) if "," in stated else None)


@pytest.mark.parametrize("stated", [[0.0, 4.0], [3.0, -1.0], [3.0], [1.0, 2.0, 3.0]])
def test_a_separation_that_is_no_pair_of_distances_is_refused(stated: list[float]) -> None:
    document = changed("environment", "obstacle_separation_min_m", stated)
    assert "obstacle_separation_min_m" in refusal(document)


# --- the speed of a measured run

RUN = "vehicle.setpoint_loss_run_on_m=4.0"
SPEED = "vehicle.cruise_speed_mps={}"
AT = "vehicle.setpoint_loss_run_on_speed_mps={}"


@pytest.mark.parametrize(
    ("overrides", "refused"),
    [
        ((RUN,), False),
        ((RUN, SPEED.format(2.8)), False),
        ((RUN, SPEED.format(1.0)), False),
        ((RUN, SPEED.format(2.801)), True),
        ((SPEED.format(2.801), RUN), True),
        ((RUN, SPEED.format(3.0), AT.format(3.0)), False),
        ((RUN, AT.format(2.7)), True),
        ((RUN, SPEED.format(3.0), AT.format("null")), True),
        ((SPEED.format(3.0), AT.format(2.8)), False),  # there is no run
        ((RUN, SPEED.format(3.0), "requirements.passive_safety=false"), False),  # none is needed
        ((SPEED.format(2.0), RUN, AT.format(1.9)), True),
    ],
)
def test_a_cruise_above_the_speed_of_the_run_is_refused(
    contract_path: Path, overrides: tuple[str, ...], refused: bool
) -> None:
    if not refused:
        load_contract(contract_path, overrides)
        return
    with pytest.raises(FileError) as caught:
        load_contract(contract_path, overrides)
    message = str(caught.value)
    assert "\n" not in message
    for part in (
        "vehicle.cruise_speed_mps = ",
        "vehicle.setpoint_loss_run_on_speed_mps = ",
        "setpoint_loss_run_on_m = 4 m",
        " m/s exceeds ",
    ):
        assert part in message


def test_the_speed_of_a_run_stays_that_of_the_file(tmp_path: Path) -> None:
    """To change the cruise speed afterwards does not measure the run again."""
    document = {**CONTRACT, "vehicle": {**CONTRACT["vehicle"], "setpoint_loss_run_on_m": 4.0}}
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(document))
    assert load_contract(path).vehicle.setpoint_loss_run_on_speed_mps == 2.8
    slower = load_contract(path, (SPEED.format(1.0),))
    assert slower.vehicle.setpoint_loss_run_on_speed_mps == 2.8
    again = Contract.model_validate(slower.model_dump() | {})
    assert again.vehicle.setpoint_loss_run_on_speed_mps == 2.8
    with pytest.raises(FileError, match="exceeds"):
        load_contract(path, (SPEED.format(4.0),))


@pytest.mark.parametrize("speed", ["fast", None, -2.8, 0.0, True, [2.8]])
def test_a_bad_speed_is_named_once(contract_path: Path, speed: Any) -> None:
    with pytest.raises(FileError) as caught:
        load_contract(contract_path, (RUN, SPEED.format("null" if speed is None else speed)))
    assert str(caught.value).count("cruise_speed_mps [m/s] = ") == 1
    document = {**CONTRACT, "vehicle": {**CONTRACT["vehicle"], "setpoint_loss_run_on_m": 4.0}}
    document["vehicle"]["cruise_speed_mps"] = speed
    message = refusal(document)
    assert message.count("[m/s]") == 1
    assert "run_on_speed" not in message


# --- overrides


def test_overrides_change_what_they_name(contract_path: Path) -> None:
    contract = load_contract(
        contract_path,
        (
            "vehicle.cruise_speed_mps=3.5",
            "requirements.stop=false",
            "vehicle.velocity_error_mps=[0, 0.5]",
            "vehicle.setpoint_loss_run_on_m=null",
        ),
    )
    assert contract.vehicle.cruise_speed_mps == 3.5
    assert contract.requirements == Requirements(stop=False, passive_safety=True)
    assert contract.vehicle.velocity_error_mps == (0.0, 0.5)
    assert contract.vehicle.radius_m == 0.3


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("vehicle.cruise_speed_mps", "write dotted.key=value"),
        ("=3", "write dotted.key=value"),
        ("vehicle.=3", "write dotted.key=value"),
        (".radius_m=3", "write dotted.key=value"),
        ("vehicle.radius_m.x=3", "radius_m holds a value, not keys"),
        ("vehicle.radius_m=]", "']' is not a value"),
        ("vehicle.radius_m=", "vehicle.radius_m [m] = None"),
        ("vehicle.radius=1", "vehicle.radius is not a known key"),
        ("rotor.radius_m=1", "rotor is not a known key"),
    ],
)
def test_bad_overrides_are_named(contract_path: Path, override: str, problem: str) -> None:
    with pytest.raises(FileError) as caught:
        load_contract(contract_path, (override,))
    assert problem in str(caught.value)
    assert override in str(caught.value)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from([*CONTRACT, *VEHICLE, *SENSOR, "other"]), inner, max_size=4
            )
        ),
        max_leaves=12,
    )
)
def test_nothing_but_a_file_error_comes_out(document: Any) -> None:
    assert refusal(document)


@pytest.mark.parametrize("model", [VehicleTerms, SensorTerms, EnvironmentTerms, Requirements])
def test_every_key_is_described(model: type[VehicleTerms]) -> None:
    undescribed = {
        name
        for name, key in model.model_fields.items()
        if not key.description and name != "field_of_view_deg"  # says it all itself
    }
    assert not undescribed


# --- how it runs on when the stream stops


def with_loss(**keys: Any) -> dict[str, Any]:
    return {**CONTRACT, "vehicle": {**CONTRACT["vehicle"], **keys}}


def test_a_frozen_setpoint_needs_both_gains() -> None:
    gains = {"gain_per_s": 0.95, "velocity_gain_per_s": 1.8}
    contract = Contract.model_validate(with_loss(setpoint_loss={"model": "frozen", **gains}))
    assert contract.vehicle.setpoint_loss is not None
    assert contract.vehicle.setpoint_loss.model == "frozen"
    for missing in gains:
        partial = {key: value for key, value in gains.items() if key != missing}
        assert missing in refusal(with_loss(setpoint_loss={"model": "frozen", **partial}))
    assert "model" in refusal(with_loss(setpoint_loss={"model": "melts"}))


def test_a_coast_states_its_timeout_once() -> None:
    loss = {"model": "coast", "timeout_s": 0.2}
    document = with_loss(setpoint_loss=loss)
    document["vehicle"].pop("setpoint_loss_timeout_s", None)
    contract = Contract.model_validate(document)
    assert contract.vehicle.setpoint_loss_timeout_s == 0.2
    # What was read can be read again, and changed.
    again = Contract.model_validate(contract.model_dump())
    assert again == contract
    assert Contract.model_validate(with_loss(setpoint_loss={"model": "coast"}))
    message = refusal(with_loss(setpoint_loss=loss, setpoint_loss_timeout_s=0.5))
    for part in ("setpoint_loss.timeout_s = 0.2 s", "setpoint_loss_timeout_s = 0.5 s", "state one"):
        assert part in message


def test_what_is_said_of_a_loss_is_part_of_the_contract() -> None:
    plain = Contract.model_validate(with_loss())
    assert Contract.model_validate(with_loss(setpoint_loss=None)).sha256 == plain.sha256
    frozen = {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8}
    assert Contract.model_validate(with_loss(setpoint_loss=frozen)).sha256 != plain.sha256
