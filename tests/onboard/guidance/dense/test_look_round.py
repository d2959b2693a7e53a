import math

import pytest

from onboard.contract.assessment import TICK_S
from onboard.guidance.dense.look_round import LookRound, points_at
from onboard.guidance.reference import Reference

HEADINGS = (math.radians(100.0), math.radians(-100.0), 0.0)


def look(frame_ticks: int, seconds: float = 60.0) -> tuple[list[float], float]:
    """Look round with a nose that follows exactly; return where it dwelt, and for how long."""
    reference, looks = Reference(), LookRound(HEADINGS, 3)
    dwelt: list[float] = []
    frames = 0
    for tick in range(round(seconds / TICK_S)):
        frames += tick % frame_ticks == 0
        before = reference.heading_rad
        if looks.advance(reference, before, frames):
            return dwelt, tick * TICK_S
        if reference.heading_rad == before:
            dwelt.append(before)
    return dwelt, math.inf


def test_the_nose_dwells_at_each_heading_until_enough_frames_have_counted() -> None:
    dwelt, duration_s = look(5)
    for place_rad in HEADINGS:
        frames = sum(points_at(heading_rad, place_rad) for heading_rad in dwelt) / 5
        assert 2.0 <= frames <= 4.0
    assert duration_s == pytest.approx((100.0 + 160.0 + 100.0) / 60.0 + 3 * 0.3, abs=0.6)


def test_without_frames_the_look_is_never_over() -> None:
    assert look(10**9)[1] == math.inf


def test_a_nose_that_does_not_follow_sees_nothing() -> None:
    reference, looks = Reference(), LookRound(HEADINGS, 1)
    assert not any(looks.advance(reference, math.pi, frames) for frames in range(2000))


def test_without_headings_the_look_is_over_at_once() -> None:
    reference = Reference()
    assert LookRound((), 3).advance(reference, 0.0, 0)
    assert reference.heading_rad == 0.0


def test_headings_are_compared_round_the_circle() -> None:
    assert points_at(math.pi - 0.01, -math.pi + 0.01)
    assert not points_at(0.1, 0.0)
