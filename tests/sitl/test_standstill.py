"""When a vehicle that was told to stop may be landed."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from sitl.standstill import PATIENCE_S, STILL_FOR_S, STILL_MPS, Standstill

STEP_S = 0.1


def landed_after_s(speed_mps: Callable[[float], float]) -> float:
    standstill = Standstill()
    for index in range(1000):
        if standstill.reached(index * STEP_S, speed_mps(index * STEP_S), stopping=True):
            return index * STEP_S
    return float("inf")


@pytest.mark.parametrize(
    ("speed_mps", "expected_s"),
    [
        (lambda _: 0.0, STILL_FOR_S),
        (lambda now_s: max(2.8 - now_s, 0.0), 2.8 - STILL_MPS + STILL_FOR_S),
        (lambda _: 0.4, PATIENCE_S),  # drifts on and on
        (
            lambda now_s: 0.5 * (round(now_s / STEP_S) % 8 == 0),
            PATIENCE_S,
        ),  # slow, but not for long
    ],
)
def test_slowness_has_to_last_but_is_not_waited_for_for_ever(
    speed_mps: Callable[[float], float], expected_s: float
) -> None:
    assert landed_after_s(speed_mps) == pytest.approx(expected_s, abs=2 * STEP_S)


def test_it_begins_anew_when_the_vehicle_flies_on() -> None:
    standstill = Standstill()
    assert not standstill.reached(0.0, 0.0, stopping=True)
    assert not standstill.reached(2.0, 0.0, stopping=False)
    assert not standstill.reached(2.1, 0.0, stopping=True)
    assert standstill.reached(2.1 + STILL_FOR_S, 0.0, stopping=True)
