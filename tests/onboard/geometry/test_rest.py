import math
from collections.abc import Callable, Iterable

import pytest

from onboard.geometry.rest import WINDOW_S, RestDetector

Vector = tuple[float, float, float]
RATE_HZ = 10.0


def fed(motion: Callable[[float], Vector], seconds: float = 3.0) -> RestDetector:
    detector = RestDetector()
    for number in range(round(seconds * RATE_HZ) + 1):
        detector.add(number / RATE_HZ, motion(number / RATE_HZ))
    return detector


def wandering(speed_mps: float, turn_radps: float) -> Callable[[float], Vector]:
    """Go round in a circle, as an estimate does while the vehicle stands."""
    radius_m = speed_mps / turn_radps
    return lambda t: (
        radius_m * math.cos(turn_radps * t),
        radius_m * math.sin(turn_radps * t),
        -4.0,
    )


@pytest.mark.parametrize(
    "motion",
    [
        lambda _: (1.0, 2.0, -4.0),
        lambda t: (0.4 * t, 0.0, -4.0),
        wandering(0.8, 4.0),  # the fastest that a recorded hover read
        wandering(0.45, 0.3),
    ],
)
def test_a_hover_is_one_however_its_estimate_wanders(motion: Callable[[float], Vector]) -> None:
    assert fed(motion).at_rest


@pytest.mark.parametrize(
    "motion",
    [
        lambda t: (0.6 * t, 0.0, -4.0),
        lambda t: (0.0, -0.6 * t, -4.0),
        lambda t: (0.0, 0.0, -4.0 - 0.6 * t),
        lambda t: (math.nan, 0.0, -4.0 * t),
    ],
)
def test_motion_in_any_direction_is_no_hover(motion: Callable[[float], Vector]) -> None:
    assert not fed(motion).at_rest


def test_a_hover_takes_a_second_to_tell() -> None:
    assert not RestDetector().at_rest
    assert not fed(lambda _: (0.0, 0.0, -4.0), WINDOW_S - 0.1).at_rest
    assert fed(lambda _: (0.0, 0.0, -4.0), WINDOW_S).at_rest


def test_a_vehicle_that_has_just_stopped_is_told_a_second_later() -> None:
    def stopping(t: float) -> Vector:
        return (2.0 * min(t, 2.0), 0.0, -4.0)

    assert not fed(stopping, 2.0).at_rest
    assert fed(stopping, 2.0 + WINDOW_S).at_rest


def test_a_clock_that_begins_anew_begins_anew() -> None:
    detector = fed(lambda _: (0.0, 0.0, -4.0))
    detector.add(0.0, (0.0, 0.0, -4.0))
    assert not detector.at_rest
    later: Iterable[int] = range(1, 11)
    for number in later:
        detector.add(number / RATE_HZ, (0.0, 0.0, -4.0))
    assert detector.at_rest
