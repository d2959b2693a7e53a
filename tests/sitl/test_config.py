"""What a simulator's file may say, and what it means."""

import math
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from onboard.files.yaml_file import FileError
from sitl.autopilot.protocol.signing import signing_key
from sitl.config import (
    EstimatorConfig,
    MultirotorConfig,
    SitlConfig,
    VehicleConfig,
    load_sitl_config,
)
from sitl.plant.estimator import EstimatorProfile
from sitl.plant.multirotor import GRAVITY_MPS2

MEMBER = {"vehicle": "two", "system_id": 2, "mavlink": ["udpout://127.0.0.1:14560"]}


def config(**stated: Any) -> SitlConfig:
    return SitlConfig.model_validate(stated)


@pytest.mark.parametrize(
    ("stated", "text"),
    [
        ({"start": {"position_ned_m": [0.0, 0.0, 1.0]}}, "below the ground"),
        ({"tracking": {"toward_obstacle": True}}, "needs tracking.error_m"),
        ({"sensors": [{"source": "a"}, {"source": "a"}]}, "same source name"),
        ({"fleet": [{**MEMBER, "system_id": 1}]}, "same system_id"),
        ({"fleet": [{**MEMBER, "vehicle": "vehicle"}]}, "same vehicle"),
        ({"fleet": [MEMBER, {**MEMBER, "system_id": 3}]}, "same vehicle"),
        ({"vehicle": "a/b"}, "pattern"),
        ({"vehicle": ""}, "pattern"),
        ({"physics_rate_hz": 450}, "multiple of 100"),
        ({"physics_rate_hz": 300}, "greater than or equal to 400"),
        ({"speed_factor": 0.0}, "greater than 0"),
        ({"signing_passphrase": ""}, "at least 1 character"),
        ({"signing_key_hex": "00" * 31}, "pattern"),
        ({"signing_key_hex": "00" * 32, "signing_passphrase": "words"}, "state one of them"),
        ({"system_id": 256}, "less than or equal to 255"),
        ({"multirotor": {"thrust_to_weight": 1.0}}, "greater than 1"),
        ({"realism": "real"}, "'field' or 'ideal'"),
        ({"flavour": "betaflight"}, "'px4' or 'ardupilot'"),
        ({"unknown_key": 1}, "Extra inputs"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_reason(stated: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        config(**stated)


def test_everything_has_a_default_that_flies() -> None:
    default = config()
    assert default.each() == (default,)
    assert default.physics_rate_hz % 100 == 0
    assert len(default.sensors) == 1


def test_a_fleet_is_one_configuration_for_each_vehicle() -> None:
    both = config(truth_log="t.mcap", seed=7, fleet=[{**MEMBER, "start": {"yaw_deg": 90.0}}])
    first, second = both.each()
    assert (first.vehicle, first.system_id, first.fleet) == ("vehicle", 1, ())
    assert (second.vehicle, second.system_id, second.fleet) == ("two", 2, ())
    assert second.mavlink == ("udpout://127.0.0.1:14560",)
    assert (first.start.yaw_deg, second.start.yaw_deg) == (0.0, 90.0)
    assert second.seed == 7
    assert (first.truth_log, second.truth_log) == (Path("t.mcap"), Path("t-two.mcap"))


def test_a_fleet_without_a_truth_log_writes_none() -> None:
    assert [one.truth_log for one in config(fleet=[MEMBER]).each()] == [None, None]


def test_the_body_has_the_stated_mass_and_thrust() -> None:
    body = MultirotorConfig(mass_kg=2.0, thrust_to_weight=3.0, rotor_speed_max_rpm=8000.0)
    parameters = body.parameters()
    thrust_n = 4.0 * parameters.thrust_coefficient_n_per_rpm2 * 8000.0**2
    assert thrust_n == pytest.approx(3.0 * 2.0 * GRAVITY_MPS2)
    assert parameters.inertia_z_kgm2 == body.inertia_kgm2[2]


def test_an_estimator_changes_only_what_is_stated() -> None:
    measured = EstimatorProfile(position_m=0.4, velocity_mps=0.6, heading_rad=0.1, drift_mps2=0.3)
    changed = EstimatorConfig(position_m=0.0, heading_deg=2.0).applied_to(measured)
    assert changed.position_m == 0.0
    assert changed.heading_rad == pytest.approx(math.radians(2.0))
    assert (changed.velocity_mps, changed.drift_mps2) == (0.6, 0.3)
    assert EstimatorConfig().applied_to(measured) == measured


@pytest.mark.parametrize(
    ("text", "mentioned"),
    [
        ("multirotor: {mass_kg: -1.0}", "mass_kg"),
        ("field_of_view: 3", "field_of_view"),
        ("sensors: [{rate_hz: 0}]", "rate_hz"),
        ("[", "sitl.yaml"),
    ],
)
def test_a_bad_file_is_an_error_that_names_file_and_key(
    tmp_path: Path, text: str, mentioned: str
) -> None:
    path = tmp_path / "sitl.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=mentioned) as error:
        load_sitl_config(path)
    assert "sitl.yaml" in str(error.value)


def test_a_vehicle_alone_is_ideal_on_request_only() -> None:
    assert VehicleConfig().realism == "field"


def test_a_key_is_read_from_the_file_that_the_daemon_names_too(tmp_path: Path) -> None:
    (tmp_path / "sitl.yaml").write_text("signing_key_file: mavlink.key\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"mavlink\.key: cannot be read as a key"):
        load_sitl_config(tmp_path / "sitl.yaml")
    (tmp_path / "mavlink.key").write_text("secret words\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"not a key") as said:
        load_sitl_config(tmp_path / "sitl.yaml")
    assert "secret" not in str(said.value)
    (tmp_path / "mavlink.key").write_text(f"{'0f' * 32}\n", encoding="utf-8")
    read = load_sitl_config(tmp_path / "sitl.yaml")
    assert signing_key(read) == bytes([0x0F]) * 32
    assert "0f0f" not in repr(read)
    words = "signing_key_file: mavlink.key\nsigning_passphrase: words\n"
    (tmp_path / "sitl.yaml").write_text(words, encoding="utf-8")
    with pytest.raises(FileError, match="state one"):
        load_sitl_config(tmp_path / "sitl.yaml")
