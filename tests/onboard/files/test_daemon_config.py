"""The daemon's configuration: defaults that fly safely, and keys that are checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from onboard.files.daemon_config import DaemonConfig, MavlinkLink
from onboard.files.yaml_file import FileError, load_yaml, validate

EXAMPLE = Path(__file__).parents[3] / "config" / "onboard.yaml"
MINIMUM: dict[str, Any] = {"contract": "c.yaml", "mission": "m.yaml"}


def test_a_daemon_flies_only_inside_its_contract_unless_told() -> None:
    config = validate({"contract": "c.yaml", "mission": "m.yaml"}, DaemonConfig, source="d.yaml")
    assert not config.fly_outside_contract
    assert config.input_set == "inner"
    assert config.contract == Path("c.yaml")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("input_set", "outer"),
        ("vehicle", "a/b"),
        ("vehicle", ""),
        ("mavlink", {"system_id": 0}),
        ("mavlink", {"system_id": 256}),
        ("mavlink", {"port": 14540}),
        ("log_level", "verbose"),
    ],
)
def test_daemon_settings_are_checked(key: str, value: Any) -> None:
    document = {"contract": "c.yaml", "mission": "m.yaml", key: value}
    with pytest.raises(FileError, match=key):
        validate(document, DaemonConfig, source="d.yaml")


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        (
            {"mission_changes": True},
            "d.yaml: mission_changes is now called accept_mission_updates",
        ),
        (
            {"mavlink": {"stale_after_s": 0.5}},
            "d.yaml: mavlink.stale_after_s is now called mavlink.telemetry_timeout_s",
        ),
    ],
)
def test_an_old_name_is_refused_with_the_new_one(document: dict[str, Any], problem: str) -> None:
    with pytest.raises(FileError) as caught:
        validate(MINIMUM | document, DaemonConfig, source="d.yaml")
    assert str(caught.value) == problem


def test_the_new_names_are_read() -> None:
    keys = {"accept_mission_updates": True, "mavlink": {"telemetry_timeout_s": 0.3}}
    config = validate(MINIMUM | keys, DaemonConfig, source="d.yaml")
    assert config.accept_mission_updates
    assert config.mavlink.telemetry_timeout_s == 0.3


@pytest.mark.parametrize("key", ["contract", "mission"])
def test_contract_and_mission_must_be_stated(key: str) -> None:
    document = {name: value for name, value in MINIMUM.items() if name != key}
    with pytest.raises(FileError, match=rf"d\.yaml: {key} is missing"):
        validate(document, DaemonConfig, source="d.yaml")


@pytest.mark.parametrize("value", [0.0, -0.5, "0.5", None])
def test_a_timeout_is_a_number_above_zero(value: Any) -> None:
    document = MINIMUM | {"mavlink": {"telemetry_timeout_s": value}}
    with pytest.raises(FileError, match=r"mavlink\.telemetry_timeout_s \[s\]"):
        validate(document, DaemonConfig, source="d.yaml")


def test_what_is_not_stated_is_the_documented_default() -> None:
    config = validate(MINIMUM, DaemonConfig, source="d.yaml")
    assert config.mavlink == MavlinkLink()
    assert (config.mavlink.url, config.mavlink.system_id) == ("udpin://127.0.0.1:14540", 1)
    assert not config.accept_mission_updates
    assert not config.require_preflight
    assert config.log_file is None
    assert (config.zenoh.connect, config.zenoh.listen) == ((), ())


def test_the_example_is_read() -> None:
    config = load_yaml(EXAMPLE, DaemonConfig)
    assert config.contract == Path("px4_contract.yaml")
    assert config.zenoh.listen == ("tcp/127.0.0.1:7448",)
