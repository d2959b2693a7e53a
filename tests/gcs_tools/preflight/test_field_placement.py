"""A field in other coordinates than the mission's is refused; one that is only wide is not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_tools.preflight.field_placement import SITE_M, check_placement
from onboard.files.mission_file import Leg, Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from tests.gcs_tools.running import CONFIG, Clearway

RANGE_M = 12.0
MISSION = Mission(altitude_m=4.0, legs=(Leg(end_ned_m=(80.0, 0.0)), Leg(end_ned_m=(80.0, 60.0))))


def field(*centers_ned_m: tuple[float, float], size_m: float = 1.0) -> ObstacleField:
    return ObstacleField.of(
        [
            Obstacle(id=str(number), center_ned_m=center_m, size_m=(size_m, size_m))
            for number, center_m in enumerate(centers_ned_m)
        ]
    )


@pytest.mark.parametrize(
    "obstacles",
    [
        field((40.0, 0.5)),
        field((40.0, 12.0)),  # its corner comes within range
        field((92.0, 30.0)),  # beside the second leg
        field((40.0, 0.5), (90_000.0, 0.0)),
        field((40.0, -300.0)),  # nothing on the way, but on the site
        field((40.0, 13.0), size_m=4.0),
    ],
)
def test_a_field_of_this_site_holds(obstacles: ObstacleField) -> None:
    assert check_placement(obstacles, MISSION, RANGE_M).holds


@pytest.mark.parametrize(
    ("obstacles", "reason"),
    [
        (field((-0.5, 25.0), (0.8, -40.0)), "1 obstacles would be on the mission's way with north"),
        (field((5.0, 40.0), (-30.0, 50.0)), "with north and east swapped"),
        (field((40.0, -2.0 * SITE_M)), "the nearest obstacle is 1,999 m from the mission"),
        (field((90_000.0, 74_000.0)), "m from the mission"),
    ],
)
def test_a_field_of_other_coordinates_is_refused(obstacles: ObstacleField, reason: str) -> None:
    rule = check_placement(obstacles, MISSION, RANGE_M)
    assert not rule.holds
    assert reason in rule.reason
    assert "metres north, then metres east" in rule.note


@pytest.mark.parametrize(
    ("name", "text", "code", "words"),
    [
        ("swapped.csv", "x_m,y_m,dbh_cm\n0.5,25.0,53.4\n-0.8,55.0,60.0\n", 1, "swapped"),
        ("right.csv", "x_m,y_m,dbh_cm\n25.0,0.5,53.4\n55.0,-0.8,60.0\n", 0, ""),
        (
            "utm.csv",
            "x_m,y_m,dbh_cm\n4308505.04,747389.68,53.4\n",
            2,
            "is 4,309 km from",
        ),
    ],
)
def test_preflight_says_so(
    clearway: Clearway, tmp_path: Path, name: str, text: str, code: int, words: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    ran = clearway(
        "preflight", "--contract", CONFIG / "default_contract.yaml",
        "--mission", CONFIG / "default_mission.yaml", "--field", path, "--format", "json",
    )  # fmt: skip
    assert ran.code == code, ran
    assert words in (ran.err or " ".join(json.loads(ran.out)["refusals"]))
