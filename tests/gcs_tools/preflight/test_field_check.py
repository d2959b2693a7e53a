"""Legs, boxes and rules of an obstacle field, one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.preflight.field_check import (
    OFFENDERS_MAX,
    LegField,
    _Count,
    _nearest_neighbours,
    _stretches,
    check_field,
    leg_boxes,
    legs_of,
    regions_clear,
)
from gcs_tools.preflight.rule import Rule
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.box import Box
from onboard.geometry.frames import LegFrame
from tests.gcs_tools.running import CONFIG

PAPER = assess(load_contract(CONFIG / "paper_contract.yaml"))
angles = st.floats(-math.pi, math.pi)


def boxes(*centers_ned_m: tuple[float, float], **more: Any) -> ObstacleField:
    return ObstacleField.of(
        [
            Obstacle.model_validate(
                {"id": str(number), "center_ned_m": center, "size_m": (1.0, 1.0), **more}
            )
            for number, center in enumerate(centers_ned_m)
        ]
    )


def mission(*ends_ned_m: tuple[float, float], half_width_m: float = 3.0) -> Mission:
    legs = [{"end_ned_m": end, "target_half_width_m": half_width_m} for end in ends_ned_m]
    return Mission.model_validate({"altitude_m": 4.0, "legs": legs})


# ---------------------------------------------------------------------------- rules


@pytest.mark.parametrize(
    ("required", "declared", "holds"),
    [
        (4.0, 4.0, True),
        (4.0, 4.0 - 1e-12, True),
        (4.0, 4.0 - 1e-6, False),
        (0.0, -1e-12, True),
        (1e9, 1e9 - 0.5, True),
        (0.0, math.inf, True),
    ],
)
def test_a_rule_allows_for_round_off_alone(
    required: float, declared: float, *, holds: bool
) -> None:
    assert Rule("rule", required, declared, "m", "why").holds is holds


def test_offenders_are_counted_beyond_those_that_are_named() -> None:
    count = _Count()
    for number in range(OFFENDERS_MAX + 50):
        count.add(str(number))
    assert (count.total, len(count.offenders)) == (OFFENDERS_MAX + 50, OFFENDERS_MAX)


# ---------------------------------------------------------------------------- legs


def test_without_a_mission_the_leg_runs_north_and_has_no_ends() -> None:
    (stretch,) = _stretches(None)
    assert stretch.frame.heading_rad == 0.0
    assert math.isinf(stretch.start.x_min_m)
    assert math.isinf(stretch.end.x_min_m)


def test_a_later_leg_may_start_wherever_the_one_before_may_end() -> None:
    first, second = _stretches(mission((40.0, 0.0), (40.0, 30.0)))
    assert (first.start.x_min_m, first.start.x_max_m) == (0.0, 0.0)
    assert (first.end.x_min_m, first.end.x_max_m) == pytest.approx((40.0, 43.0))
    assert (first.end.y_min_m, first.end.y_max_m) == pytest.approx((-3.0, 3.0))
    # Turned by 90 degrees: beside becomes along, beyond becomes to the left.
    assert (second.start.x_min_m, second.start.x_max_m) == pytest.approx((-3.0, 3.0))
    assert (second.start.y_min_m, second.start.y_max_m) == pytest.approx((-3.0, 0.0))
    assert (first.name, second.name) == ("leg 1", "leg 2")


@given(angles, angles)
def test_a_leg_s_boxes_enclose_the_corners(heading_rad: float, yaw_rad: float) -> None:
    field = boxes((7.0, -2.0), size_m=(3.0, 1.0), yaw_deg=math.degrees(yaw_rad))
    frame = LegFrame((0.0, 0.0, 0.0), heading_rad)
    (found,) = leg_boxes(frame, field)
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    corners = signs * (1.5, 0.5) @ np.array([[cosine, sine], [-sine, cosine]]) + (7.0, -2.0)
    ned = np.column_stack((corners, np.zeros(4)))
    x_m, y_m, _ = frame.position_leg_from_ned(ned).T
    assert found == pytest.approx((x_m.min(), x_m.max(), y_m.min(), y_m.max()), abs=1e-9)


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), max_size=12))
def test_the_nearest_neighbour_is_the_nearest(points: list[tuple[float, float]]) -> None:
    points_m = np.array(points).reshape(-1, 2)
    distance_m, index = _nearest_neighbours(points_m)
    for number, point_m in enumerate(points_m):
        others = np.delete(np.arange(len(points_m)), number)
        if not len(others):
            assert (distance_m[number], index[number]) == (math.inf, -1)
            continue
        apart_m = np.hypot(*(points_m[others] - point_m).T)
        assert distance_m[number] == pytest.approx(apart_m.min())
        assert index[number] in others


def test_regions_at_a_place_share_a_point_with_it() -> None:
    (leg,) = legs_of(PAPER, boxes((20.0, 0.0), (60.0, 0.0)), None)
    low_m = np.minimum(leg.regions.extent_m[0], leg.regions.manoeuvre_m[0])
    high_m = np.maximum(leg.regions.extent_m[0], leg.regions.manoeuvre_m[0])
    (x_min_m, _, y_min_m, _), (_, x_max_m, _, y_max_m) = low_m, high_m
    assert leg.regions_at(Box(x_max_m, x_max_m + 1.0, y_max_m, y_max_m + 1.0)) == [0]
    assert leg.regions_at(Box(x_max_m + 1e-6, x_max_m + 1.0, y_min_m, y_max_m)) == []
    assert leg.regions_at(Box(x_min_m, 99.0, y_min_m, y_max_m)) == [0, 1]


def test_close_obstacles_are_one_after_merging() -> None:
    (leg,) = legs_of(PAPER, boxes((20.0, 0.0), (20.0, 0.1), (60.0, 0.0)), None)
    assert isinstance(leg, LegField)
    assert leg.ids == ("0+1", "2")
    assert leg.single_ids == ("0", "1", "2")
    assert leg.centers_m == pytest.approx(np.array([[20.0, 0.05], [60.0, 0.0]]))
    assert leg.called("2") == "2 (heading north)"


# ---------------------------------------------------------------------------- verdicts


@pytest.mark.parametrize(
    ("field", "flown"),
    [
        (boxes((25.0, 0.0)), None),
        (boxes((25.0, 0.0)), mission((60.0, 0.0))),
        (boxes((3.0, 0.0)), mission((60.0, 0.0))),
        (boxes((58.0, 0.0)), mission((60.0, 0.0))),
        (boxes((20.0, 0.0), (25.0, 1.0)), None),
        (boxes((20.0, 0.0), (45.0, 1.0)), None),
    ],
)
def test_the_quick_answer_agrees_with_the_rules(
    field: ObstacleField, flown: Mission | None
) -> None:
    by_name = {rule.name: rule.holds for rule in check_field(PAPER, field, flown)}
    of_regions = [by_name.get(name, True) for name in ("roi_disjoint", "start_clear", "end_clear")]
    assert regions_clear(legs_of(PAPER, field, flown)) is all(of_regions)


def test_ends_are_checked_with_a_mission_only() -> None:
    names = [rule.name for rule in check_field(PAPER, boxes((25.0, 0.0)), None)]
    assert names == ["obstacle_size_max", "obstacle_size_min", "separation", "roi_disjoint"]
    with_mission = check_field(PAPER, boxes((25.0, 0.0)), mission((60.0, 0.0)))
    assert [rule.name for rule in with_mission][4:] == ["start_clear", "end_clear"]


def test_a_lonely_obstacle_has_no_neighbour() -> None:
    rules = {rule.name: rule for rule in check_field(PAPER, boxes((25.0, 0.0)), None)}
    assert rules["separation"].declared == math.inf
    assert rules["separation"].holds


# ---------------------------------------------------------------------------- what may be missed


def rule_on_thin(field: ObstacleField, thinnest_m: float | None) -> list[Rule]:
    sensor = PAPER.contract.sensor.model_copy(update={"thinnest_obstacle_m": thinnest_m})
    contract = PAPER.contract.model_copy(update={"sensor": sensor})
    rules = check_field(assess(contract), field, None)
    return [rule for rule in rules if rule.name == "thinnest_obstacle"]


def test_a_known_obstacle_thinner_than_the_sensor_sees_for_certain_is_named() -> None:
    field = ObstacleField.of(
        [
            Obstacle(id="wire", center_ned_m=(10.0, 0.0), size_m=(2.0, 0.02)),
            Obstacle(id="trunk", center_ned_m=(40.0, 0.0), size_m=(0.3, 0.3)),
        ]
    )
    (rule,) = rule_on_thin(field, 0.05)
    assert not rule.holds
    assert (rule.concerns, rule.offenders) == ("safety", ("wire: 0.02 m",))
    (rule,) = rule_on_thin(field, 0.02)
    assert rule.holds
    assert rule_on_thin(field, None) == []


def test_an_empty_field_has_no_thin_obstacle() -> None:
    (rule,) = rule_on_thin(ObstacleField.of([]), 0.05)
    assert rule.holds
