"""What the sensors of a daemon's file declare, against the contract."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.offline.sensors import check_sources, rings_of
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from tests.gcs_tools.running import CONFIG, Clearway
from tests.onboard.perception.test_sensor_channels import source

CONTRACT = load_contract(CONFIG / "px4_contract.yaml")
MISSION = load_yaml(CONFIG / "default_mission.yaml", Mission)
# Sees as far and as exactly as the contract says, among trees.
GOOD = {"range_m": 15.0, "uncertainty_m": 0.05, "height_band_m": (6.0, 4.5)}
LOW: dict[str, Any] = {"height_band_m": (6.0, 8.0)}
NEAR_GROUND: dict[str, Any] = {"ground_margin_m": 4.3, "mounting": {"z_m": 0.65}}


def checked(kind: str, **keys: Any) -> dict[str, Finding]:
    found = check_sources([source(kind, "s", **(GOOD | keys))], assess(CONTRACT), MISSION)
    return {each.name.removeprefix("s "): each for each in found}


@pytest.mark.parametrize("kind", ["laserscan", "obstacle_distance", "range"])
def test_a_sensor_that_fits_holds(kind: str) -> None:
    found = checked(kind)
    assert {name: each.verdict for name, each in found.items()} == {"declares": Verdict.HOLDS}


@pytest.mark.parametrize(
    ("kind", "keys", "name", "words"),
    [
        ("laserscan", {"range_m": 12.0}, "range_m", "12 m, the contract's detection_range_m 15 m"),
        ("laserscan", {"uncertainty_m": 2.0}, "uncertainty_m", "position_error_m"),
        ("laserscan", {"box_max_m": 9.0}, "box_max_m", "obstacle_size_max_m"),
        ("laserscan", {"field_of_view_deg": 20.0}, "field of view", "20° around the nose"),
        ("laserscan", {"blind_sectors_deg": [(5.0, 90.0)]}, "field of view", "10° around"),
        ("laserscan", {"blind_sectors_deg": [(-20.0, 10.0)]}, "field of view", "0° around"),
        ("laserscan", {"blind_sectors_deg": [(170.0, -5.0)]}, "field of view", "10° around"),
        ("pointcloud2", {"view_deg": (30.0, 40.0)}, "field of view", "30° around the nose"),
        ("detection3d", {"mounting": {"yaw_deg": 40.0}}, "field of view", "10° around"),
        ("obstacle_distance", {"latency_s": 1.0}, "latency_s", "reaction_time_s"),
        ("laserscan", {"height_band_m": (1.0, 1.0)}, "height_band_m", "after 3.7 m"),
        ("laserscan", LOW | {"ground_margin_m": 0.0}, "height_band_m", "the ground is seen"),
        ("laserscan", LOW | {"ground_margin_m": 1.5}, "height_band_m", "after 13.1 m"),
        ("laserscan", LOW | {"mounting": {"z_m": 0.6}}, "height_band_m", "after 14.6 m"),
        ("laserscan", LOW | {"mounting": {"z_m": -2.0}}, "height_band_m", "after 14.9 m"),
        ("range", NEAR_GROUND, "height_band_m", "0.65 m below, needs 0.75 m"),
        (
            "range",
            {"height_band_m": (1.0, 0.2), "mounting": {"z_m": 0.15}},
            "height_band_m",
            "0.2 m below at the mission's altitude_m 5 m",
        ),
    ],
)
def test_a_sensor_that_declares_less_is_refused(
    kind: str, keys: dict[str, Any], name: str, words: str
) -> None:
    found = checked(kind, **keys)
    assert list(found) == [name]
    assert found[name].verdict is Verdict.BROKEN
    assert words in found[name].text


def test_of_the_height_band_what_the_ground_takes_is_not_counted_on() -> None:
    """As in flight: the band ends at ground_margin_m, so that a tilted scan sees less far."""
    mission = MISSION.model_copy(update={"altitude_m": 4.13})
    lidar = source("laserscan", "s", **(GOOD | {"height_band_m": (4.03, 4.03)}))
    (found,) = check_sources([lidar], assess(CONTRACT), mission)
    assert (found.name, found.verdict) == ("s height_band_m", Verdict.BROKEN)
    assert "leaves 3.63 m after 13.5 m" in found.text
    assert "ends ground_margin_m 0.5 m above the ground" in found.text
    # Without a mission only what is declared is known.
    (found,) = check_sources([lidar], assess(CONTRACT), None)
    assert found.verdict is Verdict.HOLDS


def test_a_blind_sector_behind_is_no_matter() -> None:
    assert list(checked("laserscan", blind_sectors_deg=[(160.0, -160.0)])) == ["declares"]


RING_CONTRACT = load_contract(CONFIG / "movers_contract.yaml")  # 14 m ahead, 13 m all round
RING: dict[str, Any] = {
    "range_m": 13.0, "height_band_m": (6.0, 4.5), "box_max_m": 1.5, "no_return_is_free_to_m": 13.0,
}  # fmt: skip


def ring_checked(kind: str = "obstacle_distance", **keys: Any) -> dict[str, Verdict]:
    stated = {"uncertainty_m": 0.05} | RING | keys
    found = check_sources([source(kind, "s", **stated)], assess(RING_CONTRACT), None)
    return {each.name.removeprefix("s "): each.verdict for each in found}


@pytest.mark.parametrize("kind", ["obstacle_distance", "laserscan"])
def test_the_sensor_that_covers_all_round_is_said(kind: str) -> None:
    assert ring_checked(kind) == {"all_round": Verdict.HOLDS, "declares": Verdict.HOLDS}
    assert rings_of([source(kind, "s"), source("range", "r")]) == ("s", "r")


@pytest.mark.parametrize(
    ("keys", "broken"),
    [
        ({"range_m": 12.9, "no_return_is_free_to_m": 12.9},
         ["all_round", "no_return_is_free_to_m", "range_m"]),
        ({"no_return_is_free_to_m": None}, ["no_return_is_free_to_m"]),
        ({"no_return_is_free_to_m": 12.0}, ["no_return_is_free_to_m"]),
        ({"blind_sectors_deg": [(160.0, -160.0)]}, ["range_m"]),  # then it has to see ahead
        ({"height_band_m": (3.0, 3.0)}, ["height_band_m"]),
    ],
)  # fmt: skip
def test_a_ring_that_shows_less_than_all_round_is_refused(
    keys: dict[str, Any], broken: list[str]
) -> None:
    found = ring_checked(**keys)
    assert sorted(name for name, each in found.items() if each is Verdict.BROKEN) == broken
    assert ("all_round" in found) is ("blind_sectors_deg" not in keys)


def test_who_only_adds_movers_need_not_see_what_the_contract_says() -> None:
    found = ring_checked("tracked_objects", range_m=5.0, no_return_is_free_to_m=None)
    assert found == {"declares": Verdict.HOLDS}
    assert rings_of([source("tracked_objects", "s")]) == ()


def test_preflight_reads_the_daemon_s_file(clearway: Clearway, tmp_path: Path) -> None:
    for name in ("px4_contract.yaml", "default_mission.yaml"):
        shutil.copy(CONFIG / name, tmp_path / name)
    lidar = {"kind": "laserscan", "name": "lidar", "topic": "/scan", **GOOD}
    lidar["height_band_m"] = list(GOOD["height_band_m"])  # type: ignore[call-overload]  # two numbers
    document = {"contract": "px4_contract.yaml", "mission": "default_mission.yaml"}
    config = tmp_path / "onboard.yaml"
    contract = ("preflight", "--contract", tmp_path / "px4_contract.yaml", "--format", "json")
    options = ("--mission", tmp_path / "default_mission.yaml", "--daemon-config", config)
    for range_m, code in ((15.0, 0), (8.0, 1)):
        sources = [lidar | {"range_m": range_m}]
        config.write_text(yaml.safe_dump(document | {"sources": sources}), encoding="utf-8")
        ran = clearway(*contract, *options)
        assert (ran.code, ran.err) == (code, "")
        live = json.loads(ran.out)["live"]
        assert [each["subject"] for each in live] == ["sensor"]
    assert "lidar range_m" in ran.out
