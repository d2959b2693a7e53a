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
from onboard.geometry.local_frame import Autopilot, GeographicPoint, LocalFrame
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


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.0, 2.0 * math.pi),
    st.floats(1.0, 60.0),
    st.floats(-80.0, 80.0),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(0.0, 20e3),
    st.sampled_from(["px4", "ardupilot"]),
)
def test_no_distance_on_the_ellipsoid_is_less_than_what_is_said(
    bearing_rad: float,
    away_m: float,
    latitude_deg: float,
    whither_rad: float,
    from_origin_m: float,
    autopilot: Autopilot,
) -> None:
    """By WGS84's radii of curvature, not by our frames, as far from the origin as is allowed."""
    frame = LocalFrame(GeographicPoint(latitude_deg, 10.0), autopilot)
    one_m = from_origin_m * np.array([math.cos(whither_rad), math.sin(whither_rad)])
    other_m = one_m + away_m * np.array([math.cos(bearing_rad), math.sin(bearing_rad)])
    here, there = (np.radians(frame.latitude_longitude_deg(*each)) for each in (one_m, other_m))
    middle_rad = (here[0] + there[0]) / 2.0
    squared = 0.0066943799901
    curved = 1.0 - squared * math.sin(middle_rad) ** 2
    prime_m = 6_378_137.0 / math.sqrt(curved)
    meridian_m = prime_m * (1.0 - squared) / curved
    true_m = math.hypot(
        meridian_m * (there[0] - here[0]),
        prime_m * math.cos(middle_rad) * (there[1] - here[1]),
    )
    assert away_m * (1.0 - 0.007) <= true_m + 1e-5 * away_m


def test_an_edge_that_is_straight_in_one_frame_bends_in_another(lanes: Changed) -> None:
    """A parallel of 16 km, as ArduPilot's frame has it, is 8.7 m nearer to PX4's in the middle."""
    half_m, origin = 8000.0, {"latitude_deg": 60.0, "longitude_deg": 8.5}

    def lane(south_m: float, north_m: float) -> Callable[[dict[str, Any]], object]:
        corners = [[south_m, -half_m], [north_m, -half_m], [north_m, half_m], [south_m, half_m]]
        return lambda fence: fence["areas"][0].update(corners_ned_m=corners)

    def along(north_m: float) -> Callable[[dict[str, Any]], object]:
        legs = [{"end_ned_m": [north_m, 50.0]}]
        return lambda mission: mission.update(start_ned_m=[north_m, -50.0], legs=legs)

    def placed(fleet: dict[str, Any]) -> None:
        for vehicle, autopilot in zip(fleet["vehicles"], ("px4", "ardupilot"), strict=True):
            vehicle |= {"origin": origin, "autopilot": autopilot}

    path = lanes(
        lanes=placed,
        left_geofence=lane(-80.0, -27.0),
        left_mission=along(-50.0),
        right_geofence=lane(-20.0, 30.0),
        right_mission=along(0.0),
    )
    (sentence,) = sentences(path)
    assert sentence.startswith("left and right fly 7.0 m apart and need 8.0 m")


@pytest.mark.parametrize("first", ["px4", "ardupilot"])
def test_two_autopilots_at_one_origin_do_not_have_one_frame(lanes: Changed, first: str) -> None:
    """Their spheres differ by 4.5 m in 4 km."""

    def east(document: dict[str, Any]) -> None:
        for area in document.get("areas", ()):
            area["corners_ned_m"] = [[n, e + 4000.0] for n, e in area["corners_ned_m"]]
        for leg in document.get("legs", ()):
            leg["end_ned_m"][1] += 4000.0
        if "start_ned_m" in document:
            document["start_ned_m"][1] += 4000.0

    def autopilots(fleet: dict[str, Any]) -> None:
        second = "px4" if first == "ardupilot" else "ardupilot"
        for vehicle, autopilot in zip(fleet["vehicles"], (first, second), strict=True):
            vehicle["autopilot"] = autopilot

    names = ("left_mission", "left_geofence", "right_mission", "right_geofence")
    path = lanes(lanes=autopilots, **dict.fromkeys(names, east))
    (pair,) = check_corridors(read_fleet(path)[1]).pairs
    assert pair.disjoint == (first == "ardupilot")
    assert pair.apart_m == pytest.approx(10.0 + (4.45 if first == "ardupilot" else -4.45), abs=0.2)


@pytest.mark.parametrize(("number", "latitude_deg"), [(0, 60.0), (1, 48.0)])
def test_corridors_of_two_sites_are_not_compared(
    lanes: Changed, number: int, latitude_deg: float
) -> None:
    """The frame of one that is far away does not tell how far apart two others are."""

    def elsewhere(fleet: dict[str, Any]) -> None:
        fleet["vehicles"][number]["origin"]["latitude_deg"] = latitude_deg

    (sentence,) = sentences(lanes(lanes=elsewhere))
    assert sentence.startswith("right: its geofence reaches ")
    assert sentence.endswith("km from its origin or that of left: compared within 20 km only")


# ------------------------------------------------------------------------ files that do not fit


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f["vehicles"][1].update(name="left"), "another vehicle has it"),
        (lambda f: f["vehicles"][1].pop("origin"), "vehicles.1.origin is missing"),
        (lambda f: f["vehicles"][0]["origin"].update(latitude_deg=85.0), "origin.latitude_deg"),
        (lambda f: f["vehicles"].pop(), "at least 2"),
        (lambda f: f["vehicles"][0].update(name="a/b"), "vehicles.0.name"),
        (lambda f: f["vehicles"][0].pop("absolute_position_error_m"), "is missing"),
        (lambda f: f["vehicles"][0].update(mission="none.yaml"), "none.yaml: cannot be read"),
        (lambda f: f.update(speed_max_mps=4.0), "left, may fly 5.59 m/s by its contract"),
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
