"""What is measured in a recording of known errors, lag and tilt."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_tools.identify.recording import (
    Recording,
    attitude_lag_s,
    cruise_velocity_error_mps,
    measure,
)
from onboard.contract.agility import GRAVITY_MPS2
from onboard.geometry.frames import FloatArray

TIMES_S = np.arange(0.0, 30.0, 0.02)


def swaying(times_s: FloatArray) -> FloatArray:
    """Acceleration north and east, [m/s²]."""
    return np.column_stack((np.sin(1.3 * times_s), 0.7 * np.sin(2.1 * times_s + 1.0)))


def recording(lag_s: float = 0.2, yaw_rad: float = 0.0, **changes: Any) -> Recording:
    """A vehicle whose tilt follows what it is asked for with a delay."""
    north, east = swaying(TIMES_S - lag_s).T
    forward = math.cos(yaw_rad) * north + math.sin(yaw_rad) * east
    right = math.cos(yaw_rad) * east - math.sin(yaw_rad) * north
    zeros = np.zeros(len(TIMES_S))
    flown = Recording(
        source="log",
        time_s=TIMES_S,
        position_error_m=zeros + 0.1,
        height_error_m=zeros + 0.05,
        velocity_error_mps=np.array([[0.1, 0.2], [0.3, 0.05]]),
        heading_error_rad=np.array([0.01, math.nan, 0.02]),
        asked_ned_mps2=swaying(TIMES_S),
        roll_rad=np.arctan(right / GRAVITY_MPS2),
        pitch_rad=-np.arctan(forward / GRAVITY_MPS2),
        yaw_rad=zeros + yaw_rad,
        reaction_s=0.17,
        doing=lambda time_s: f"doing it at {time_s:.2f}",
    )
    return replace(flown, **changes)


@settings(max_examples=20)
@given(st.integers(0, 79), st.floats(-math.pi, math.pi))
def test_the_lag_is_found_at_any_heading(hundredths: int, yaw_rad: float) -> None:
    lag_s = hundredths / 100.0
    assert attitude_lag_s(recording(lag_s, yaw_rad)) == pytest.approx(lag_s, abs=0.011)


def test_steady_wind_does_not_change_the_lag() -> None:
    leaning = recording(0.3)
    leaning = replace(leaning, roll_rad=leaning.roll_rad + 0.1, pitch_rad=leaning.pitch_rad - 0.1)
    assert attitude_lag_s(leaning) == pytest.approx(0.3, abs=0.011)


@pytest.mark.parametrize("asked_mps2", [0.0, 0.1, math.nan])
def test_too_little_motion_shows_no_lag(asked_mps2: float) -> None:
    still = recording(asked_ned_mps2=np.full((len(TIMES_S), 2), asked_mps2))
    assert attitude_lag_s(still) is None


def test_too_short_a_flight_shows_no_lag() -> None:
    short = recording()
    cut = slice(0, 50)
    short = replace(
        short,
        time_s=short.time_s[cut],
        asked_ned_mps2=short.asked_ned_mps2[cut],
        roll_rad=short.roll_rad[cut],
        pitch_rad=short.pitch_rad[cut],
        yaw_rad=short.yaw_rad[cut],
    )
    assert attitude_lag_s(short) is None


def test_the_lag_is_not_looked_for_across_a_gap() -> None:
    whole = recording(0.25)
    late_s = np.where(whole.time_s > 15.0, whole.time_s + 40.0, whole.time_s)
    assert attitude_lag_s(replace(whole, time_s=late_s)) == pytest.approx(0.25, abs=0.011)


def test_the_worst_of_each_is_measured() -> None:
    errors_m = np.full(len(TIMES_S), 0.1)
    errors_m[500] = 0.4
    found = measure(recording(position_error_m=errors_m, notes=("a note",)))
    assert found.tracking_error_m == 0.4
    assert found.worst == "10.0 s after taking control, doing it at 10.00"
    assert found.tracking_error_z_m == pytest.approx(0.05)
    assert found.velocity_error_mps == (0.3, 0.2)
    assert found.heading_error_deg == pytest.approx(math.degrees(0.02))
    assert (found.reaction_time_s, found.notes) == (0.17, ("a note",))
    assert found.tilt_max_deg >= max(found.roll_max_deg, found.pitch_max_deg)
    largest_mps2 = np.hypot(*swaying(TIMES_S).T).max()
    assert found.tilt_asked_deg == pytest.approx(
        math.degrees(math.atan(largest_mps2 / 9.80665)), rel=1e-3
    )


def test_what_a_log_does_not_show_is_none() -> None:
    nothing = np.full((len(TIMES_S), 2), math.nan)
    found = measure(
        recording(
            asked_ned_mps2=nothing,
            velocity_error_mps=np.empty((0, 2)),
            heading_error_rad=np.array([math.nan]),
            reaction_s=None,
        )
    )
    assert found.velocity_error_mps == (None, None)
    assert (found.heading_error_deg, found.tilt_asked_deg) == (None, None)
    assert (found.attitude_lag_s, found.reaction_time_s) == (None, None)


@given(st.floats(-math.pi, math.pi), st.floats(0.6, 9.0), st.floats(-1, 1), st.floats(-1, 1))
def test_velocity_errors_are_along_and_across_the_course(
    course_rad: float, speed_mps: float, along_mps: float, across_mps: float
) -> None:
    ahead = np.array([math.cos(course_rad), math.sin(course_rad)])
    right = np.array([-ahead[1], ahead[0]])
    reference = np.array([speed_mps * ahead])
    flown = reference + along_mps * ahead + across_mps * right
    found = cruise_velocity_error_mps(flown, reference, np.zeros((1, 2)))
    assert found == pytest.approx(np.array([[abs(along_mps), abs(across_mps)]]), abs=1e-9)


@pytest.mark.parametrize(
    ("reference_mps", "asked_mps2", "cruises"),
    [((2.0, 0.0), (0.0, 0.0), 1), ((0.4, 0.0), (0.0, 0.0), 0), ((2.0, 0.0), (0.0, 0.2), 0)],
)
def test_only_steady_flight_is_cruise(
    reference_mps: tuple[float, float], asked_mps2: tuple[float, float], cruises: int
) -> None:
    found = cruise_velocity_error_mps(
        np.zeros((1, 2)), np.array([reference_mps]), np.array([asked_mps2])
    )
    assert len(found) == cruises
