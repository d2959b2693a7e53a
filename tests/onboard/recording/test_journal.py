"""What the journal says of a service that sees obstacles and has a plan."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.models import Contract, Mission, load_contract
from onboard.files.yaml_file import load_yaml
from onboard.geometry.frames import LegFrame, rotation_about_down
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import Trajectory
from onboard.recording import foxglove_messages as foxglove
from onboard.recording.journal import PATH_POINTS_MAX, PATH_STEP_S, SLOW_PERIOD_S, Journal, path_of
from onboard.recording.record import Record
from onboard.vehicle_state import Pose

CONFIG = Path(__file__).parents[3] / "config"
EPOCH_S = 1_790_000_000.0


@pytest.fixture
def contract() -> Contract:
    return load_contract(CONFIG / "paper_contract.yaml")


@pytest.fixture
def autonomy(contract: Contract) -> Autonomy:
    mission = load_yaml(CONFIG / "paper_mission.yaml", Mission)
    return Autonomy(contract, mission, epoch_unix_s=EPOCH_S)


def see(autonomy: Autonomy, now_s: float, *centers_m: tuple[float, float]) -> None:
    obstacles = [
        {"id": str(i), "center_m": c, "size_m": [1.0, 1.2], "yaw_deg": 0.0, "uncertainty_m": 0.02}
        for i, c in enumerate(centers_m)
    ]
    frame = {
        "version": 1, "source": "front", "sequence": 1, "stamp_unix_s": EPOCH_S + now_s,
        "frame": "local_ned", "range_m": 12.0, "field_of_view_deg": 120.0, "obstacles": obstacles,
    }  # fmt: skip
    autonomy.receive_detection(json.dumps(frame).encode(), now_s)


def stand_at(autonomy: Autonomy, now_s: float, north_m: float, yaw_rad: float = 0.0) -> None:
    autonomy.link.pose = Pose(now_s, (north_m, 0.0, -4.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad)


def ticked(journal: Journal, now_s: float) -> dict[str, list[Record]]:
    journal.autonomy.tick(now_s)
    by_topic: dict[str, list[Record]] = defaultdict(list)
    for record in journal.collect(now_s):
        by_topic[record.topic].append(record)
    return by_topic


def test_every_tick_has_a_state_and_what_lasts_is_said_once(autonomy: Autonomy) -> None:
    journal = Journal(autonomy, timed=False)
    ticks = [ticked(journal, number * TICK_S) for number in range(1, 101)]
    assert all(len(tick["state"]) == 1 for tick in ticks)
    assert sum(len(tick["margins"]) for tick in ticks) == 1
    assert sum(len(tick["monitors"]) for tick in ticks) == round(2.0 / SLOW_PERIOD_S)


def test_margins_are_those_of_the_contract_as_flown(autonomy: Autonomy) -> None:
    (said,) = ticked(Journal(autonomy, timed=False), TICK_S)["margins"]
    assert said.payload["compliant"] is True
    for told, clause in zip(said.payload["clauses"], autonomy.assessment.clauses, strict=True):
        assert told["name"] == clause.name
        assert told["margin"] == pytest.approx(told["declared"] - told["required"])
        assert told["holds"] == (told["margin"] > 0.0)


def test_monitors_hold_what_is_measured_against_the_contract(
    autonomy: Autonomy, contract: Contract
) -> None:
    see(autonomy, 0.0, (10.0, 3.0))
    stand_at(autonomy, 0.0, 0.0)
    (said,) = ticked(Journal(autonomy, timed=False), 0.1)["monitors"]
    assert said.payload["detection_age"] == {
        "measured": pytest.approx(0.1),
        "limit": contract.sensor.frame_age_max_s,
        "unit": "s",
    }
    assert said.payload["telemetry_age"]["measured"] == pytest.approx(0.1)
    assert said.payload["heartbeat_age"]["measured"] is None
    # From (0, 0) to the corner of the box around (10, 3), less the vehicle's own radius.
    expected_m = math.hypot(9.5, 2.4) - contract.vehicle.radius_m
    assert said.payload["clearance"]["measured"] == pytest.approx(expected_m)


def test_obstacles_are_said_when_they_change_with_all_that_surrounds_them(
    autonomy: Autonomy,
) -> None:
    journal = Journal(autonomy, timed=False)
    see(autonomy, 0.0, (12.0, 0.5))
    (first,) = ticked(journal, 0.02)["obstacles"]
    (obstacle,) = first.payload["obstacles"]
    boundary_m = np.array(obstacle["boundary_ned_m"])
    region_m, keep_out_m = (np.array(obstacle[key]) for key in ("region_ned_m", "keep_out_ned_m"))
    # Behind the boundary lies the obstacle, before it the way in which it can still be avoided.
    assert boundary_m[:, 0].min() >= region_m[:, 0].min()
    assert boundary_m[:, 0].max() <= keep_out_m[:, 0].min() + 1e-9
    assert boundary_m[:, 1].min() == pytest.approx(keep_out_m[:, 1].min())
    lane_m = np.array(obstacle["lane_ned_m"])
    assert region_m[:, 1].min() <= lane_m[:, 1].min() < keep_out_m[:, 1].min()
    assert ticked(journal, 0.5)["obstacles"] == []
    see(autonomy, 0.6, (12.0, 0.5), (24.0, -1.0))
    (second,) = ticked(journal, 0.8)["obstacles"]
    assert [o["id"] for o in second.payload["obstacles"]] == ["front/0", "front/1"]
    assert second.payload["obstacles"][0] == obstacle


# ---------------------------------------------------------------------------- for viewers


def complaints(value: Any, schema: dict[str, Any], where: str = "$") -> list[str]:
    """Hold a JSON value against the part of JSON Schema that ours use."""
    kinds: dict[str, type | tuple[type, ...]] = {
        "object": dict, "array": list, "string": str, "boolean": bool, "integer": int,
        "number": (int, float),
    }  # fmt: skip
    if not isinstance(value, kinds[schema["type"]]):
        return [f"{where}: {value!r} is no {schema['type']}"]
    if isinstance(value, dict):
        found = [f"{where}: {key} is missing" for key in schema["required"] if key not in value]
        found += [f"{where}: {key} is unknown" for key in value if key not in schema["properties"]]
        for key in value.keys() & schema["properties"].keys():
            found += complaints(value[key], schema["properties"][key], f"{where}.{key}")
        return found
    if isinstance(value, list):
        if len(value) > schema.get("maxItems", math.inf):
            return [f"{where}: too long"]
        items = schema.get("items", {})
        return [c for i, item in enumerate(value) for c in complaints(item, items, f"{where}[{i}]")]
    return []


def test_what_viewers_get_follows_the_schemas(autonomy: Autonomy) -> None:
    journal = Journal(autonomy, timed=False)
    see(autonomy, 0.0, (12.0, 0.5))
    stand_at(autonomy, 0.0, 0.0)
    records = [r for topic in ticked(journal, 0.02).values() for r in topic if r.schema]
    assert {record.topic for record in records} == {"tf", "pose", "path/flown", "scene/obstacles"}
    for record in records:
        # As a reader gets it.
        payload = json.loads(json.dumps(record.payload))
        assert complaints(payload, foxglove.SCHEMAS[record.schema]) == []


def test_the_cube_stands_where_the_obstacle_is(autonomy: Autonomy) -> None:
    see(autonomy, 0.0, (12.0, 0.5))
    (update,) = ticked(Journal(autonomy, timed=False), 0.02)["scene/obstacles"]
    (entity,) = update.payload["entities"]
    (cube,) = entity["cubes"]
    assert (cube["pose"]["position"]["x"], cube["pose"]["position"]["y"]) == pytest.approx(
        (12.0, 0.5)
    )
    assert (cube["size"]["x"], cube["size"]["y"]) == pytest.approx((1.0, 1.2))
    # From the ground to above the height flown: down is positive.
    top_m = cube["pose"]["position"]["z"] - cube["size"]["z"] / 2.0
    assert top_m < -4.0
    assert cube["pose"]["position"]["z"] + cube["size"]["z"] / 2.0 == pytest.approx(0.0)


def turned(rotation: dict[str, float], vector: tuple[float, float, float]) -> list[float]:
    """Rotate a vector by a quaternion: q v q*."""
    axis, w = np.array([rotation["x"], rotation["y"], rotation["z"]]), rotation["w"]
    v = np.array(vector)
    turned_v: list[float] = (
        2.0 * np.dot(axis, v) * axis + (w * w - axis @ axis) * v + 2.0 * w * np.cross(axis, v)
    ).tolist()
    return turned_v


def test_the_map_has_east_north_up_and_the_body_follows_the_heading(autonomy: Autonomy) -> None:
    stand_at(autonomy, 0.0, 5.0, yaw_rad=0.7)
    (said,) = ticked(Journal(autonomy, timed=False), 0.02)["tf"]
    map_from_ned, ned_from_body = said.payload["transforms"]
    assert turned(map_from_ned["rotation"], (1.0, 2.0, 3.0)) == pytest.approx([2.0, 1.0, -3.0])
    assert ned_from_body["translation"] == {"x": 5.0, "y": 0.0, "z": -4.0}
    nose = turned(ned_from_body["rotation"], (1.0, 0.0, 0.0))
    assert nose == pytest.approx((rotation_about_down(0.7) @ np.array([1.0, 0.0, 0.0])).tolist())


def test_roll_lowers_the_right_side_and_pitch_raises_the_nose() -> None:
    right = turned(foxglove.quaternion(0.3, 0.0, 0.0), (0.0, 1.0, 0.0))
    nose = turned(foxglove.quaternion(0.0, 0.3, 0.0), (1.0, 0.0, 0.0))
    assert right[2] == pytest.approx(math.sin(0.3))
    assert nose[2] == pytest.approx(-math.sin(0.3))


def test_times_are_split_into_seconds_and_nanoseconds() -> None:
    assert foxglove.timestamp(EPOCH_S + 0.25) == {"sec": 1_790_000_000, "nsec": 250_000_000}
    assert foxglove.timestamp(0.9999999) == {"sec": 1, "nsec": 0}


@pytest.mark.parametrize("duration_s", [0.05, 0.1, 5.0, 5.03, 39.95, 60.0, 6383.0, 1e9])
def test_the_recorded_path_of_a_plan_is_bounded_and_keeps_its_ends(duration_s: float) -> None:
    still = Profile(0.0, 0.0)
    along = Profile(0.0, 2.0, (Segment(duration_s, 0.0),))
    trajectory = Trajectory.from_profiles(7.0, along, still, still)
    leg = LegFrame((0.0, 0.0, -4.0), math.pi / 2.0)
    path_ned_m = path_of(trajectory, leg)
    assert 2 <= len(path_ned_m) <= PATH_POINTS_MAX
    assert path_ned_m[0] == pytest.approx([0.0, 0.0, -4.0])
    assert path_ned_m[-1] == pytest.approx([0.0, 2.0 * duration_s, -4.0], rel=1e-9, abs=1e-6)
    steps_m = np.diff([east_m for _, east_m, _ in path_ned_m])
    assert (steps_m > -1e-9).all()
    fine_m = 2.0 * max(PATH_STEP_S, duration_s / (PATH_POINTS_MAX - 1))
    assert steps_m.max() <= fine_m * (1.0 + 1e-9)
