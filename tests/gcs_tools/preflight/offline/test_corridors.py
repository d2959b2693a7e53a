"""C0: where each vehicle may be, and which of them may meet."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point

from gcs_tools.preflight.offline.corridors import check_corridors, region_of
from gcs_tools.preflight.offline.fleet_files import read_fleet
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from tests.gcs_tools.running import CONFIG, Clearway

ZURICH = {"latitude_deg": 47.397742, "longitude_deg": 8.545594}
LANES = CONFIG / "fleet" / "lanes.yaml"
Changed = Callable[..., Path]


@pytest.fixture
def lanes(tmp_path: Path) -> Changed:
    """Write the shipped lanes with some of their files changed; return the fleet's file."""
    folder = tmp_path / "fleet"

    def write(**changes: Callable[[dict[str, Any]], object]) -> Path:
        folder.mkdir()
        (tmp_path / "default_contract.yaml").write_bytes(
            (CONFIG / "default_contract.yaml").read_bytes()
        )
        for source in (CONFIG / "fleet").glob("*.yaml"):
            document = yaml.safe_load(source.read_text(encoding="utf-8"))
            if source.stem in changes:
                changes[source.stem](document)
            (folder / source.name).write_text(yaml.safe_dump(document), encoding="utf-8")
        return folder / "lanes.yaml"

    return write


def sentences(path: Path) -> tuple[str, ...]:
    return check_corridors(read_fleet(path)[1]).sentences


def test_lanes_beside_each_other_are_disjoint(clearway: Clearway) -> None:
    ran = clearway("fleet", "check", LANES)
    assert ran.code == 0, ran
    assert "CORRIDORS ARE DISJOINT" in ran.out
    document = json.loads(clearway("fleet", "check", LANES, "--format", "json").out)
    (pair,) = document["pairs"]
    assert document["holds"]
    assert pair["vehicles"] == ["left", "right"]
    # 15 m on both sides of lines that are 40 m apart; two bodies, and 2 m of error each.
    assert pair["apart_m"] == pytest.approx(10.0, rel=0.01)
    (left, right) = read_fleet(LANES)[1]
    assert pair["required_m"] == left.margin_m + right.margin_m + 4.0


def test_ways_that_cross_are_a_sentence_for_each_pair(clearway: Clearway) -> None:
    ran = clearway("fleet", "check", CONFIG / "fleet" / "crossing.yaml")
    assert ran.code == 1, ran
    assert ran.out.count("may fly in the same place") == 6
    assert "to cure it: give each a geofence of its own" in ran.out


def test_the_position_error_of_both_counts(lanes: Changed) -> None:
    def worse(fleet: dict[str, Any]) -> None:
        fleet["vehicles"][1]["absolute_position_error_m"] = 4.0

    (sentence,) = sentences(lanes(lanes=worse))
    assert sentence == "left and right fly 9.9 m apart and need 10.0 m for bodies and errors"


@pytest.mark.parametrize("half_m", [None, 3.0])
def test_what_a_leg_states_is_no_bound(lanes: Changed, half_m: float | None) -> None:
    """A way back about what was flown may lead out of the strip of the leg."""

    def stated(mission: dict[str, Any]) -> None:
        mission["legs"][0]["corridor_half_width_m"] = half_m

    (pair,) = check_corridors(read_fleet(lanes(left_mission=stated, right_mission=stated))[1]).pairs
    assert pair.apart_m == pytest.approx(10.0, rel=0.01)


def test_without_a_geofence_nothing_bounds_a_vehicle(lanes: Changed) -> None:
    def unfenced(fleet: dict[str, Any]) -> None:
        del fleet["vehicles"][0]["geofence"]

    (sentence,) = sentences(lanes(lanes=unfenced))
    assert sentence.startswith("left: no geofence keeps it inside an area")


def test_a_geofence_that_only_keeps_out_bounds_nothing(lanes: Changed) -> None:
    def out(fence: dict[str, Any]) -> None:
        fence["areas"] = [{"keep": "outside", "center_ned_m": [50.0, 50.0], "radius_m": 3.0}]

    (sentence,) = sentences(lanes(left_geofence=out))
    assert "no geofence keeps it inside an area" in sentence


def test_without_ways_to_rest_nothing_keeps_an_avoidance_in_a_corridor(
    lanes: Changed, tmp_path: Path
) -> None:
    path = lanes()
    contract = tmp_path / "default_contract.yaml"
    contract.write_text(contract.read_text("utf-8").replace("stop: true", "stop: false"), "utf-8")
    first, second = sentences(path)
    assert first.startswith("left: requirements.stop is false")
    assert second.startswith("right: requirements.stop is false")


def test_a_mission_outside_its_geofence_is_not_disjoint_from_everything(lanes: Changed) -> None:
    def elsewhere(mission: dict[str, Any]) -> None:
        mission["start_ned_m"] = [0.0, 500.0]
        mission["legs"][0]["end_ned_m"] = [100.0, 500.0]

    (sentence,) = sentences(lanes(left_mission=elsewhere))
    assert sentence.startswith("left: start_ned_m = [0.0, 500.0] m has less than")


def test_what_a_geofence_keeps_out_is_not_flown_in(lanes: Changed) -> None:
    def halved(fence: dict[str, Any]) -> None:
        fence["areas"].append({"keep": "outside", "center_ned_m": [50.0, -5.0], "radius_m": 3.5})

    path = lanes(left_geofence=halved)
    region = region_of(read_fleet(path)[1][0])
    assert region.contains(Point(50.0, -8.6))
    assert not region.contains(Point(50.0, -8.4))


# ------------------------------------------------------------------------ places on the Earth


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("east_m", [0.0, 30.0])
def test_other_origins_are_compared_on_the_earth(
    lanes: Changed, autopilot: str, east_m: float
) -> None:
    """Both fly the same numbers, of origins that lie so far apart."""
    here = LocalFrame(GeographicPoint(**ZURICH), "px4")
    latitude_deg, longitude_deg = here.latitude_longitude_deg(0.0, 40.0 + east_m)

    def placed(fleet: dict[str, Any]) -> None:
        first, second = fleet["vehicles"]
        first["origin"] = ZURICH
        second |= {"mission": first["mission"], "geofence": first["geofence"]}
        second["origin"] = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}
        second["autopilot"] = autopilot

    (pair,) = check_corridors(read_fleet(lanes(lanes=placed))[1]).pairs
    # The spheres differ by 0.11 %, over the places of a mission that is 120 m long.
    assert pair.apart_m == pytest.approx(0.993 * (10.0 + east_m), abs=0.2)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(1.0, 60.0), st.floats(-89.0, 89.0))
def test_no_distance_on_the_ellipsoid_is_less_than_what_is_said(
    bearing_rad: float, away_m: float, latitude_deg: float
) -> None:
    """By WGS84's radii of curvature, not by our frames."""
    frame = LocalFrame(GeographicPoint(latitude_deg, 10.0), "ardupilot")
    north_m, east_m = away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
    there = np.radians(frame.latitude_longitude_deg(north_m, east_m))
    sine2 = math.sin(math.radians(latitude_deg)) ** 2
    squared = 0.0066943799901
    prime_m = 6_378_137.0 / math.sqrt(1.0 - squared * sine2)
    meridian_m = prime_m * (1.0 - squared) / (1.0 - squared * sine2)
    true_m = math.hypot(
        meridian_m * (there[0] - math.radians(latitude_deg)),
        prime_m * math.cos(math.radians(latitude_deg)) * (there[1] - math.radians(10.0)),
    )
    assert away_m * (1.0 - 0.007) <= true_m + 1e-5 * away_m


# ------------------------------------------------------------------------ files that do not fit


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f["vehicles"][1].update(name="left"), "another vehicle has it"),
        (lambda f: f["vehicles"][0].update(origin=ZURICH), "vehicles.1.origin is missing"),
        (lambda f: f["vehicles"].pop(), "at least 2"),
        (lambda f: f["vehicles"][0].update(name="a/b"), "vehicles.0.name"),
        (lambda f: f["vehicles"][0].pop("absolute_position_error_m"), "is missing"),
        (lambda f: f["vehicles"][0].update(mission="none.yaml"), "none.yaml: cannot be read"),
        (lambda f: f.update(speed_max_mps=2.9), "left, may fly 3.25 m/s by its contract"),
    ],
)
def test_a_file_that_does_not_fit_is_one_line(
    lanes: Changed, clearway: Clearway, change: Callable[[Any], object], words: str
) -> None:
    ran = clearway("fleet", "check", lanes(lanes=change))
    assert (ran.code, ran.out, ran.err.count("\n")) == (2, "", 1), ran
    assert words in ran.err


def test_a_geofence_whose_edges_cross_is_one_line(lanes: Changed, clearway: Clearway) -> None:
    def crossed(fence: dict[str, Any]) -> None:
        corners = fence["areas"][0]["corners_ned_m"]
        corners[0], corners[1] = corners[1], corners[0]

    ran = clearway("fleet", "check", lanes(left_geofence=crossed))
    assert (ran.code, ran.err.count("\n")) == (2, 1), ran
    assert "left_geofence.yaml: its edges cross each other" in ran.err
