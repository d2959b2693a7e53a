"""``clearway preflight --fleet``: the clause `corridors` as a part of one vehicle's check."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.gcs_tools.running import CONFIG, Clearway, Ran

FLEET = CONFIG / "fleet"


def checked(clearway: Clearway, fleet: str, *more: object, mission: str = "left") -> Ran:
    return clearway(
        "preflight",
        *("--contract", CONFIG / "default_contract.yaml"),
        *("--mission", FLEET / f"{mission}_mission.yaml", "--fleet", FLEET / fleet),
        *("--format", "json"),
        *more,
    )


def geofence(name: str) -> tuple[str, Path]:
    return "--geofence", FLEET / f"{name}_geofence.yaml"


def test_a_vehicle_of_disjoint_lanes_may_fly(clearway: Clearway) -> None:
    ran = checked(clearway, "lanes.yaml", *geofence("left"))
    assert ran.code == 0, ran
    document = json.loads(ran.out)
    rules = {rule["name"]: rule for rule in document["geofence"]}
    assert rules["corridors"]["holds"]
    assert rules["corridors"]["concerns"] == "safety"


def test_ways_that_cross_are_not_flown(clearway: Clearway) -> None:
    ran = checked(clearway, "crossing.yaml", *geofence("northbound"), mission="northbound")
    assert ran.code == 1, ran
    (refusal,) = [each for each in json.loads(ran.out)["refusals"] if "corridors" in each]
    assert "northbound and southbound may fly in the same place" in refusal


def test_another_geofence_than_the_fleet_knows_is_refused(clearway: Clearway) -> None:
    for more in ((), geofence("right")):
        ran = checked(clearway, "lanes.yaml", *more)
        assert ran.code == 1, ran
        assert "no vehicle of lanes.yaml flies by this contract, mission and geofence" in ran.out


def test_another_contract_than_the_fleet_knows_is_refused(clearway: Clearway) -> None:
    ran = checked(
        clearway, "lanes.yaml", *geofence("left"), "--set", "vehicle.cruise_speed_mps=2.7"
    )
    assert ran.code == 1, ran
    assert "no vehicle of lanes.yaml flies by" in ran.out


@pytest.mark.parametrize("kept", ["left", "right", None])
def test_a_daemon_has_to_keep_to_the_geofence_that_is_checked(
    clearway: Clearway, tmp_path: Path, kept: str | None
) -> None:
    """The corridor is held by the daemon; what the fleet's file says holds nothing."""
    daemon = tmp_path / "onboard.yaml"
    stated = "" if kept is None else f"geofence: {FLEET / f'{kept}_geofence.yaml'}\n"
    daemon.write_text(stated + (CONFIG / "onboard.yaml").read_text("utf-8"), "utf-8")
    ran = checked(clearway, "lanes.yaml", *geofence("left"), "--daemon-config", daemon)
    rules = {rule["name"]: rule for rule in json.loads(ran.out)["geofence"]}
    assert rules["corridors"]["holds"] == (kept == "left")
    objection = "geofence of onboard.yaml is not the one that is checked"
    assert (objection in ran.out) == (kept != "left")
