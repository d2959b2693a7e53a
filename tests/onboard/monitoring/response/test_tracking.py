import math

import pytest

from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.response.tracking import CONFIRMATIONS, TrackingMonitor
from tests.onboard.contract.example_terms import TERMS

Error = tuple[float, float, float]
NONE: Error = (0.0, 0.0, 0.0)


def track(
    monitor: TrackingMonitor,
    error_m: Error = NONE,
    velocity_mps: tuple[float, float] = (2.8, 0.0),
    *,
    cruising: bool = True,
) -> list[Assumption]:
    found = monitor.check(error_m, velocity_mps, (2.8, 0.0), TERMS, cruising=cruising)
    return [violation.assumption for violation in found]


@pytest.mark.parametrize("cruising", [True, False])
@pytest.mark.parametrize(
    ("error_m", "expected"),
    [
        ((0.2, 0.2, 0.0), [Assumption.TRACKING_ERROR]),
        ((-0.2, -0.2, 0.9), [Assumption.TRACKING_ERROR]),
        ((0.2, 0.0, 0.9), []),
        ((0.0, 0.0, 1.01), [Assumption.TRACKING_ERROR_Z]),
        ((0.0, 0.0, -1.01), [Assumption.TRACKING_ERROR_Z]),
        ((0.3, 0.0, 2.0), [Assumption.TRACKING_ERROR, Assumption.TRACKING_ERROR_Z]),
    ],
)
def test_an_error_counts_once_confirmed(
    error_m: Error, expected: list[Assumption], *, cruising: bool
) -> None:
    monitor = TrackingMonitor()
    seen = [track(monitor, error_m, cruising=cruising) for _ in range(CONFIRMATIONS)]
    assert seen == [[]] * (CONFIRMATIONS - 1) + [expected]
    assert monitor.position_error_m == pytest.approx(math.hypot(*error_m[:2]))
    assert monitor.vertical_error_m == pytest.approx(abs(error_m[2]))


@pytest.mark.parametrize("error_m", [(0.3, 0.0, 0.0), (0.0, 0.0, 1.5)])
def test_single_glitch_is_forgiven(error_m: Error) -> None:
    monitor = TrackingMonitor()
    for _ in range(5):
        assert track(monitor, error_m) == []
        assert track(monitor) == []


@pytest.mark.parametrize("velocity_mps", [(3.01, 0.0), (2.8, 0.11), (2.8, -0.11)])
def test_velocity_error_counts_in_cruise_only(velocity_mps: tuple[float, float]) -> None:
    monitor = TrackingMonitor()
    for _ in range(CONFIRMATIONS):
        assert track(monitor, velocity_mps=velocity_mps, cruising=False) == []
    seen = [track(monitor, velocity_mps=velocity_mps) for _ in range(CONFIRMATIONS)]
    assert seen[-1] == [Assumption.VELOCITY_ERROR]


def test_slower_than_cruise_is_no_violation() -> None:
    monitor = TrackingMonitor()
    for _ in range(CONFIRMATIONS):
        assert track(monitor, velocity_mps=(1.0, 0.0)) == []
