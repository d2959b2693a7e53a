"""Which heights a measurement says that an obstacle fills, and which of those flown at are seen."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from onboard.contract.heights import VIEW_EDGE_RAD
from onboard.contract.terms import Terms
from onboard.perception.detection import ANY_HEIGHT, DetectionFrame, corners_ned
from onboard.perception.heights import (
    ShownHeights,
    azimuth_error_rad,
    distances_m,
    heights_filled_m,
    shown_heights,
    tilt_rad,
)
from onboard.vehicle_state import Pose
from tests.onboard.contract.example_terms import TERMS

UP_DEG, DOWN_DEG = 30.0, 30.0
HEIGHTS = replace(
    TERMS,
    tracking_error_z_m=0.5,
    radius_z_m=0.2,
    height_drift_m=0.4,
    position_error_z_m=0.3,
    view_up_rad=math.radians(UP_DEG),
    view_down_rad=math.radians(DOWN_DEG),
)
LEG_DOWN_M = -5.0
POSE = Pose(0.0, (0.0, 0.0, LEG_DOWN_M), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def frame_of(*obstacles: dict[str, Any], **changed: Any) -> DetectionFrame:
    stated: dict[str, Any] = {
        "version": 1, "source": "front", "sequence": 1, "stamp_unix_s": 0.0, "frame": "local_ned",
        "range_m": 12.0, "field_of_view_deg": 120.0,
        "obstacles": [
            {"id": str(number), "center_m": (10.0, 0.0), "size_m": (1.0, 6.0), "yaw_deg": 0.0,
             "uncertainty_m": 0.05} | each
            for number, each in enumerate(obstacles)
        ],
    }  # fmt: skip
    return DetectionFrame.model_validate(stated | changed)


def filled_m(
    frame: DetectionFrame, pose: Pose | None = POSE, terms: Terms[float] = HEIGHTS
) -> tuple[float, float]:
    (seen,) = frame.obstacles
    placed_by = pose if frame.frame == "body_frd" else None
    return heights_filled_m(frame, seen, corners_ned(seen, placed_by), pose, terms)


def test_a_low_obstacle_fills_what_was_measured_and_its_error() -> None:
    # The foot is out of view: 5 m below at 9.5 m.
    assert filled_m(frame_of({"down_m": (-1.5, 0.0)})) == (-1.8, math.inf)
    assert filled_m(frame_of({"down_m": (-1.5, -1.0)})) == pytest.approx((-1.8, -0.7))


def test_a_frame_of_the_body_is_relative_to_the_levelled_body() -> None:
    pose = POSE._replace(roll_rad=0.005, pitch_rad=0.005)
    seen = frame_of({"down_m": (3.5, 4.0)}, frame="body_frd")
    assert filled_m(seen, pose) == pytest.approx((-1.8, -0.7))


def test_a_sensor_that_states_a_larger_error_is_believed() -> None:
    worse = frame_of({"down_m": (-2.5, -2.0), "down_uncertainty_m": 0.8})
    better = frame_of({"down_m": (-1.5, -1.0), "down_uncertainty_m": 0.1})
    assert filled_m(worse) == pytest.approx((-3.3, -1.2))
    assert filled_m(better) == pytest.approx((-1.8, -0.7))


def test_a_climbing_body_is_off_by_what_stamp_and_pose_are_apart() -> None:
    climbing = POSE._replace(velocity_ned_mps=(0.0, 0.0, -2.0))
    assert filled_m(frame_of({"down_m": (-1.5, -1.0)}), climbing)[0] < -1.8


@pytest.mark.parametrize(
    ("obstacle", "pose", "terms"),
    [
        ({}, POSE, HEIGHTS),
        ({"down_m": None}, POSE, HEIGHTS),
        ({"down_m": (None, None)}, POSE, HEIGHTS),
        ({"down_m": (-1.5, 0.0), "partial": True}, POSE, HEIGHTS),
        ({"down_m": (-1.5, 0.0)}, None, HEIGHTS),
        ({"down_m": (-1.5, 0.0)}, POSE, TERMS),
    ],
    ids=["unsaid", "null", "faces null", "partial", "no pose", "pillars by contract"],
)
def test_what_is_not_known_to_end_is_a_pillar(
    obstacle: dict[str, Any], pose: Pose | None, terms: Terms[float]
) -> None:
    assert filled_m(frame_of(obstacle), pose, terms) == ANY_HEIGHT


def test_a_top_at_the_edge_of_the_view_is_not_a_top() -> None:
    tall = {"down_m": (-8.0, -5.5)}  # 3 m above the sensor at 9.5 m: 18 degrees
    assert filled_m(frame_of(tall))[0] == pytest.approx(-8.3)
    up = POSE._replace(pitch_rad=math.radians(-8.0))
    assert filled_m(frame_of(tall), up)[0] == -math.inf
    assert filled_m(frame_of(tall, vertical_field_of_view_deg=(20.0, 30.0)))[0] == -math.inf
    assert filled_m(frame_of(tall, vertical_field_of_view_deg=(60.0, 60.0)))[0] > -math.inf


@given(
    roll=st.floats(-0.4, 0.4),
    pitch=st.floats(-0.4, 0.4),
    distance=st.floats(1.0, 15.0),
    bearing=st.floats(-1.0, 1.0),
    top=st.floats(-20.0, 0.0),
    tall=st.floats(0.1, 15.0),
    high=st.floats(-0.2, 0.2),
    error=st.sampled_from([-0.3, 0.0, 0.3]),
)
def test_no_cut_obstacle_is_taken_for_a_whole_one(
    roll: float, pitch: float, distance: float, bearing: float,
    top: float, tall: float, high: float, error: float,
) -> None:  # fmt: skip
    """A sensor anywhere in the body reports the part of a thin post that is in its view."""
    pose = POSE._replace(roll_rad=roll, pitch_rad=pitch)
    north, east = distance * math.cos(bearing), distance * math.sin(bearing)
    downs = np.linspace(top, top + tall, 400)
    rays = np.stack([np.full(400, north), np.full(400, east), downs - (LEG_DOWN_M + high)])
    x, y, z = Rotation.from_euler("ZYX", (0.0, pitch, roll)).as_matrix().T @ rays
    elevation_deg = np.degrees(np.arctan2(-z, np.hypot(x, y)))
    shown = downs[(elevation_deg <= UP_DEG) & (elevation_deg >= -DOWN_DEG)]
    if not shown.size:
        return
    stated = (float(shown[0]) + error, float(max(shown[-1] + error, shown[0] + error)))
    box = {"center_m": (north, east), "size_m": (0.02, 0.02), "down_m": stated}
    found_top, found_bottom = filled_m(frame_of(box), pose)
    # Of what is cut within the last hundredth of a metre, the sampling says nothing.
    assert found_top <= top + tall / 399.0 + 1e-9
    assert found_bottom >= top + tall - tall / 399.0 - 1e-9


@given(
    roll=st.floats(-0.6, 0.6),
    pitch=st.floats(-0.6, 0.6),
    bearing=st.floats(-math.pi, math.pi),
    elevation=st.floats(-0.7, 0.7),
)
def test_tilt_turns_directions_by_no_more_than_said(
    roll: float, pitch: float, bearing: float, elevation: float
) -> None:
    tilted = tilt_rad(POSE._replace(roll_rad=roll, pitch_rad=pitch))
    turn = Rotation.from_euler("ZYX", (0.0, pitch, roll)).as_matrix()
    ray = np.array([math.cos(bearing), math.sin(bearing), -math.tan(elevation)])
    x, y, z = turn.T @ ray
    assert abs(math.atan2(-z, math.hypot(x, y)) - elevation) <= tilted + 1e-9
    moved = math.tan(abs(elevation)) * math.sin(tilted) + 1.0 - math.cos(tilted)
    if moved < 1.0:
        off = math.remainder(math.atan2(y, x) - bearing, 2.0 * math.pi)
        assert abs(off) <= azimuth_error_rad(abs(elevation), tilted) + 1e-9


def test_the_distance_of_a_rectangle_is_that_of_its_nearest_side() -> None:
    square = [(2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0)]
    assert distances_m(square, (0.0, 0.0)) == pytest.approx((2.0, math.hypot(4.0, 1.0)))
    assert distances_m(square, (3.0, 0.0))[0] == 0.0
    assert distances_m(square, (5.0, 2.0))[0] == pytest.approx(math.sqrt(2.0))


# ------------------------------------------------------------------ what a frame shows


def test_among_pillars_a_frame_shows_every_height() -> None:
    assert shown_heights(frame_of(), POSE, LEG_DOWN_M, TERMS) == ShownHeights()


def test_near_the_sensor_the_band_is_not_all_in_view() -> None:
    shown = shown_heights(frame_of(), POSE, LEG_DOWN_M, HEIGHTS)
    high_m = 0.2 + 0.5 + 0.4 + 0.05 + 0.2
    edge_rad = math.radians(30.0) - VIEW_EDGE_RAD
    assert shown.blind_m == pytest.approx(high_m / math.tan(edge_rad))
    assert shown.high_m == pytest.approx(high_m)
    assert shown.level_range_m(12.0) == pytest.approx(math.sqrt(144.0 - high_m**2))
    assert shown.half_view_rad(1.0) == 1.0  # level: no direction is turned
    tilted = POSE._replace(pitch_rad=0.2)
    less = shown_heights(frame_of(), tilted, LEG_DOWN_M, HEIGHTS)
    assert less.blind_m > shown.blind_m
    assert less.half_view_rad(1.0) < 1.0
    assert less.half_view_rad(math.pi) == math.pi


@pytest.mark.parametrize(
    ("changed", "pose"),
    [
        ({"vertical_field_of_view_deg": (0.0, 0.0)}, POSE),
        ({}, POSE._replace(roll_rad=0.5)),
        ({"reported_height_m": (1.0, 5.0)}, POSE),
        ({"reported_height_m": (5.0, 1.0)}, POSE),
    ],
    ids=["planar", "rolled", "cut above", "cut below"],
)
def test_a_frame_that_cannot_show_the_band_shows_nothing(
    changed: dict[str, Any], pose: Pose
) -> None:
    assert shown_heights(frame_of(**changed), pose, LEG_DOWN_M, HEIGHTS).blind_m == math.inf


def test_a_vehicle_below_its_leg_has_more_of_the_band_above() -> None:
    low = POSE._replace(position_ned_m=(0.0, 0.0, LEG_DOWN_M + 0.3))
    shown = shown_heights(frame_of(), low, LEG_DOWN_M, HEIGHTS)
    assert shown.high_m == pytest.approx(0.2 + 0.5 + 0.4 + 0.05 + 0.2 + 0.3)
