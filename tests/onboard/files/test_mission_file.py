"""Missions are legs with a length, inside the space that flights stay in."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.files.mission_file import LEG_LENGTH_MIN_M, Leg, Mission
from onboard.files.yaml_file import FileError, load_yaml, validate


def mission(*ends_ned_m: list[float], **keys: Any) -> Mission:
    legs = [{"end_ned_m": end_m} for end_m in ends_ned_m]
    return validate({"altitude_m": 4.0, "legs": legs} | keys, Mission, source="mission.yaml")


def test_a_mission(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text("altitude_m: 4.0\nlegs:\n  - end_ned_m: [46, 0.3]\n", encoding="utf-8")
    mission = load_yaml(path, Mission)
    assert mission.start_ned_m == (0.0, 0.0)
    assert mission.legs[0].end_ned_m == (46.0, 0.3)
    assert mission.legs[0].target_half_width_m > 0.0
    assert mission.climb_max_m == 0.0


@pytest.mark.parametrize(
    "text",
    [
        "altitude_m: 4.0\nlegs: []\n",
        "altitude_m: -4.0\nlegs: [{end_ned_m: [1, 2]}]\n",
        "altitude_m: 4.0\nlegs: [{end_ned_m: [1, 2, 3]}]\n",
        "legs: [{end_ned_m: [1, 2]}]\n",
        "altitude_m: 4.0\nlegs: [{end_ned_m: [1, north]}]\n",
    ],
)
def test_missions_that_cannot_be_flown(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=r"mission\.yaml: "):
        load_yaml(path, Mission)


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"altitude_m": 0.0}, "altitude_m [m] = 0.0: input should be greater than 0"),
        ({"climb_max_m": -0.1}, "climb_max_m [m] = -0.1: input should be greater than or equal"),
        ({"start_ned_m": [0.0, 1.1e5]}, "start_ned_m.1 [m] = 110000.0: input should be less than"),
        ({"start_ned_m": [math.nan, 0.0]}, "start_ned_m.0 [m] = nan: input should be a finite"),
        ({"speed_mps": 2.0}, "speed_mps is not a known key"),
    ],
)
def test_a_bad_key_is_named_with_its_value(keys: dict[str, Any], problem: str) -> None:
    with pytest.raises(FileError) as caught:
        mission([46.0, 0.0], **keys)
    assert problem.replace("speed_mps", "speed_mps [m/s]") in str(caught.value)


def test_a_target_must_be_wide() -> None:
    legs = [{"end_ned_m": [1.0, 2.0], "target_half_width_m": 0.0}]
    with pytest.raises(FileError, match=r"legs\.0\.target_half_width_m \[m\] = 0\.0"):
        mission(legs=legs)


@given(st.floats(0.0, 2.0 * LEG_LENGTH_MIN_M), st.floats(-math.pi, math.pi))
def test_a_leg_has_a_length(length_m: float, heading_rad: float) -> None:
    first_m = [30.0, -4.0]
    north_m = first_m[0] + length_m * math.cos(heading_rad)
    east_m = first_m[1] + length_m * math.sin(heading_rad)
    actual_m = math.hypot(north_m - first_m[0], east_m - first_m[1])
    if actual_m >= LEG_LENGTH_MIN_M:
        assert len(mission(first_m, [north_m, east_m]).legs) == 2
        return
    with pytest.raises(FileError, match=r"legs\.1\.end_ned_m = .* is less than 0\.1 m from"):
        mission(first_m, [north_m, east_m])


def test_the_first_leg_begins_at_the_start() -> None:
    with pytest.raises(FileError, match=r"legs\.0\.end_ned_m"):
        mission([5.0, 6.0], start_ned_m=[5.0, 6.0])
    assert mission([5.0, 6.0]).start_ned_m == (0.0, 0.0)


def test_with_best_effort_the_corridor_is_as_wide_as_the_target_by_default() -> None:
    leg = Leg(end_ned_m=(10.0, 0.0), target_half_width_m=4.0)
    assert (leg.corridor_half_width_m, leg.threading_half_width_m) == (None, 4.0)
    assert leg.model_copy(update={"corridor_half_width_m": 7.0}).threading_half_width_m == 7.0
