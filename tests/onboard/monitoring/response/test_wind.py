from dataclasses import replace

import pytest

from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.response.trim import LEARNING_TIME_S, TrimEstimator
from onboard.monitoring.response.wind import CONFIRMATION_S, WindMonitor
from tests.onboard.contract.example_terms import TERMS
from tests.onboard.monitoring.response.trim_flight import Horizontal, poses


def noticed_s(
    wind_mps: Horizontal,
    wind_max_mps: float | None,
    *,
    velocity_mps: Horizontal = (0.0, 0.0),
    lasting_s: float = 12.0,
) -> float | None:
    """Return when a wind is noticed, or None."""
    trim = TrimEstimator()
    monitor, terms = WindMonitor(trim), replace(TERMS, wind_max_mps=wind_max_mps)
    for pose in poses(lasting_s, wind_mps=wind_mps, velocity_mps=velocity_mps):
        trim.learn(pose)
        found = monitor.check(pose.time_s, terms)
        if found is not None:
            assert found.assumption is Assumption.WIND
            assert found.measured > found.limit
            return pose.time_s
    return None


@pytest.mark.parametrize("velocity_mps", [(0.0, 0.0), (2.8, 0.0), (0.0, -2.8)])
@pytest.mark.parametrize("wind_mps", [(8.0, 0.0), (-8.0, 0.0), (0.0, 8.0), (6.0, -6.0)])
def test_a_wind_beyond_the_declared_one_is_noticed(
    wind_mps: Horizontal, velocity_mps: Horizontal
) -> None:
    expected_s = LEARNING_TIME_S + CONFIRMATION_S
    assert noticed_s(wind_mps, 5.0, velocity_mps=velocity_mps) == pytest.approx(expected_s, abs=0.1)


@pytest.mark.parametrize("velocity_mps", [(0.0, 0.0), (2.8, 0.0), (0.0, -2.8)])
@pytest.mark.parametrize(
    ("wind_mps", "wind_max_mps"),
    [((5.0, 0.0), 5.0), ((0.0, 0.0), 0.0), ((-3.5, 3.5), 5.0), ((12.0, 0.0), None)],
)
def test_a_wind_within_the_declared_one_is_none(
    wind_mps: Horizontal, wind_max_mps: float | None, velocity_mps: Horizontal
) -> None:
    assert noticed_s(wind_mps, wind_max_mps, velocity_mps=velocity_mps) is None


def test_a_gust_is_no_wind() -> None:
    trim = TrimEstimator()
    monitor, terms = WindMonitor(trim), replace(TERMS, wind_max_mps=5.0)
    flight = [
        *poses(3.0),
        *poses(2.0, start_s=3.0, wind_mps=(9.0, 0.0)),
        *poses(5.0, start_s=5.0),
    ]
    for pose in flight:
        trim.learn(pose)
        assert monitor.check(pose.time_s, terms) is None
