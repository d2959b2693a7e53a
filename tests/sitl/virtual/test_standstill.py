"""When a vehicle that should stop may be landed."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from onboard.geometry.rest import MOVED_MAX_M, WINDOW_S
from sitl.virtual.standstill import PATIENCE_S, STILL_FOR_S, Standstill

STEP_S = 0.1


def at(north_m: float) -> tuple[float, float, float]:
    return north_m, 0.0, -4.0


def landed_after_s(north_m: Callable[[float], float]) -> float:
    standstill = Standstill()
    for index in range(1000):
        now_s = index * STEP_S
        if standstill.reached(now_s, at(north_m(now_s)), stopping=True):
            return now_s
    return math.inf


@pytest.mark.parametrize(
    ("north_m", "expected_s"),
    [
        (lambda _: 0.0, WINDOW_S + STILL_FOR_S),
        # Brakes with 1 m/s² from 2.8 m/s; rest when a second moves it by less than half a metre.
        (
            lambda t: -((2.8 - min(t, 2.8)) ** 2) / 2.0,
            2.8 - math.sqrt(2.0 * MOVED_MAX_M) + WINDOW_S + STILL_FOR_S,
        ),
        (
            lambda t: 0.3 * math.sin(t),
            WINDOW_S + STILL_FOR_S,
        ),  # hovers, by an estimate that wanders
        (lambda t: 1.0 * t, PATIENCE_S),  # drifts on and on
        (lambda _: math.nan, PATIENCE_S),  # does not stop
    ],
)
def test_rest_has_to_last_but_is_not_waited_for_for_ever(
    north_m: Callable[[float], float], expected_s: float
) -> None:
    assert landed_after_s(north_m) == pytest.approx(expected_s, abs=2 * STEP_S)


def test_it_begins_anew_when_the_vehicle_flies_on() -> None:
    standstill = Standstill()
    assert not standstill.reached(0.0, at(0.0), stopping=True)
    assert not standstill.reached(2.0, at(0.0), stopping=False)
    assert not standstill.reached(2.1, at(0.0), stopping=True)
    assert not standstill.reached(2.1 + WINDOW_S, at(0.0), stopping=True)
    assert standstill.reached(2.1 + WINDOW_S + STILL_FOR_S + STEP_S, at(0.0), stopping=True)
