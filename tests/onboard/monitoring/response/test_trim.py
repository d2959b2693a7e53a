import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.monitoring.response.trim import LEARNING_TIME_S, TrimEstimator
from onboard.vehicle_state import Pose
from tests.onboard.monitoring.response.trim_flight import Horizontal, poses

COMPONENT = st.floats(-6.0, 6.0)


def learn(trim: TrimEstimator, flight: Iterable[Pose]) -> None:
    for pose in flight:
        trim.learn(pose)


@given(st.tuples(COMPONENT, COMPONENT), st.floats(-math.pi, math.pi))
def test_the_trim_of_a_hover_is_the_drag_of_the_wind(wind_mps: Horizontal, yaw_rad: float) -> None:
    trim = TrimEstimator()
    learn(trim, poses(3.0, wind_mps=wind_mps, yaw_rad=yaw_rad))
    assert trim.ready
    assert trim.trim_mps2 == pytest.approx(tuple(-0.45 * w for w in wind_mps), abs=1e-6)


def test_an_acceleration_is_not_learnt_as_wind() -> None:
    trim = TrimEstimator()
    learn(trim, poses(2.5, acceleration_mps2=(1.2, -0.8), wind_mps=(5.0, 0.0), drag_per_s=0.0))
    assert trim.trim_mps2 == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_turn_keeps_the_wind() -> None:
    trim = TrimEstimator()
    learn(trim, poses(3.0, wind_mps=(5.0, 0.0)))
    before_mps2 = trim.trim_mps2
    learn(trim, poses(0.1, start_s=3.0, wind_mps=(5.0, 0.0), yaw_rad=2.0))
    assert trim.trim_mps2 == pytest.approx(before_mps2, abs=1e-6)


def test_it_is_ready_after_the_stated_time_and_never_in_a_gap() -> None:
    trim = TrimEstimator()
    learn(trim, poses(LEARNING_TIME_S - 0.1))
    assert not trim.ready
    learn(trim, poses(0.02, start_s=60.0))
    assert not trim.ready
    learn(trim, poses(0.2, start_s=61.0))
    assert trim.ready
    trim.forget()
    assert not trim.ready


@pytest.mark.parametrize("jump_mps", [(0.5, 0.0), (0.0, -3.0)])
def test_a_velocity_that_the_estimator_resets_is_not_learnt(jump_mps: Horizontal) -> None:
    trim = TrimEstimator()
    learn(trim, poses(3.0, drag_per_s=0.0))
    learn(trim, poses(1.0, start_s=3.0, velocity_mps=jump_mps, drag_per_s=0.0))
    assert trim.trim_mps2 == pytest.approx((0.0, 0.0), abs=1e-6)
