"""How the nose turns in flight, and when it is known where it points."""

import math

import numpy as np
import pytest

from onboard.contract.assessment import TICK_S
from onboard.guidance.dense.nose import Nose
from onboard.guidance.reference import Reference
from onboard.perception.seen_free import SeenFree
from onboard.planning.corridor.horizon import PIECE_S
from onboard.planning.corridor.look import TURN_MAX_RADPS, Outlook

PATH_LEG_M = np.array([(0.0, 0.0), (0.0, 5.0)])


def turned_rad(nose: Nose, reference: Reference, begin_s: float = 0.0) -> float:
    """Turn for the time of one node."""
    before_rad = reference.heading_rad
    for tick in range(round(PIECE_S / TICK_S)):
        nose.turn(begin_s + tick * TICK_S)
    return reference.heading_rad - before_rad


def test_the_nose_follows_the_path_no_faster_than_the_limits_allow_for() -> None:
    reference = Reference()
    nose = Nose(reference)
    seen = SeenFree()
    seen.confirm(0.0, 0.0, 9.0)
    outlook = Outlook((0.0, 0.0), 0.0, math.radians(45.0), PATH_LEG_M, seen.grid(), 0.5)
    nose.follow(outlook, 0.3)
    assert turned_rad(nose, reference) == pytest.approx(0.3 * PIECE_S)
    nose.follow(outlook, 2.0)
    assert 0.3 * PIECE_S < turned_rad(nose, reference) <= 2.0 * PIECE_S + 1e-9


def test_it_returns_to_the_leg_so_slowly_that_frames_count() -> None:
    reference = Reference()
    reference.heading_rad = -0.5
    nose = Nose(reference)
    nose.return_to_leg()
    assert turned_rad(nose, reference) == pytest.approx(TURN_MAX_RADPS * PIECE_S)
    reference.heading_rad = 0.01
    nose.return_to_leg()
    assert turned_rad(nose, reference) == pytest.approx(-0.01)


def test_it_is_steady_a_while_after_a_turn_or_a_look_and_not_before() -> None:
    reference = Reference()
    nose = Nose(reference)
    nose.rest(0.0)
    turned_rad(nose, reference, 0.5)
    assert not nose.steady
    turned_rad(nose, reference, 1.2)
    assert nose.steady
    nose.rest(2.0)
    assert not nose.steady
    reference.heading_rad = 0.5
    nose.return_to_leg()
    turned_rad(nose, reference, 4.0)
    assert not nose.steady
