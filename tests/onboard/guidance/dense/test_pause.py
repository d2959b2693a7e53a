import math
from dataclasses import replace

import numpy as np
import pytest

from onboard.geometry.frames import wrap_angle
from onboard.guidance.dense import pause as module
from onboard.guidance.dense.pause import Pause
from onboard.guidance.reference import Reference
from onboard.perception.seen_free import SeenFree
from onboard.planning.corridor.guide import Guide
from onboard.planning.corridor.look import Outlook


@pytest.fixture(scope="module")
def outlook() -> Outlook:
    path_leg_m = np.array([(0.0, 0.0), (3.0, 4.0), (10.0, 4.0)])
    return Outlook((0.0, 0.0), 0.0, math.radians(60.0), path_leg_m, SeenFree().grid(), 0.5)


@pytest.fixture
def pause() -> Pause:
    return Pause(Reference(), Guide((20.0, 0.0), 0.5))


def headings(pause: Pause) -> list[float]:
    """Look with a nose that follows at once and frames in every tick; return where it dwelt."""
    dwelt: list[float] = []
    reference = pause._reference
    for tick in range(5000):
        before = reference.heading_rad
        pause.advance(before, tick, 0.02 * tick)
        if not pause.looking:
            return dwelt
        if reference.heading_rad == before and (not dwelt or dwelt[-1] != before):
            dwelt.append(before)
    pytest.fail("the look is never over")


def test_the_first_look_is_along_the_guide_the_second_all_round(
    pause: Pause, outlook: Outlook
) -> None:
    pause.begin(outlook, 2, 0.0)
    first = headings(pause)
    assert pause._guide.penalized_leg_m == []
    pause.begin(outlook, 2, 0.0)
    assert len(headings(pause)) > len(first)
    # 0.8 m ahead on the guide another gap becomes cheaper.
    assert pause._guide.penalized_leg_m == [pytest.approx((0.48, 0.64))]
    assert pause.count == 2


def test_progress_begins_with_the_guide_again(pause: Pause, outlook: Outlook) -> None:
    pause.note_progress(20.0)
    pause.begin(outlook, 1, 0.0)
    pause.note_progress(18.0)
    pause.begin(outlook, 1, 0.0)
    assert pause._guide.penalized_leg_m == []
    pause.note_progress(17.5)
    pause.begin(outlook, 1, 0.0)
    assert len(pause._guide.penalized_leg_m) == 1


def test_after_a_look_planning_has_its_time(pause: Pause) -> None:
    pause.look_round((), 1)
    assert not pause.advance(0.0, 0, 10.0)
    assert not pause.advance(0.0, 0, 10.9)
    assert pause.advance(0.0, 0, 11.0)


def test_looking_is_exhausted_after_so_many_pauses_of_a_leg(pause: Pause, outlook: Outlook) -> None:
    for _ in range(module.PAUSES_MAX):
        assert not pause.exhausted
        pause.begin(outlook, 1, 0.0)
    assert pause.exhausted
    said = pause.exhaustion(0.0)
    assert said is not None
    assert "pauses" in str(said)
    pause.begin_leg()
    assert not pause.exhausted
    assert pause.exhaustion(1e6) is None


def test_looking_from_one_place_is_exhausted_after_a_time(pause: Pause, outlook: Outlook) -> None:
    """Obstacles stand still: what a few looks all round do not show, more of them do not either."""
    for number in range(module.PAUSES_HERE_MAX + 2):
        pause.begin(outlook, 1, 20.0 * number)
        said = pause.exhaustion(20.0 * (number + 1))
        assert (said is not None) is (20.0 * (number + 1) > module.HERE_MAX_S)
    elsewhere = replace(outlook, position_leg_m=(0.0, 5.0))
    pause.begin(elsewhere, 1, 200.0)
    assert pause.exhaustion(1000.0) is None


def test_a_few_looks_are_made_however_long_they_take(pause: Pause, outlook: Outlook) -> None:
    for number in range(module.PAUSES_HERE_MAX - 1):
        pause.begin(outlook, 1, 200.0 * number)
        assert pause.exhaustion(200.0 * (number + 1)) is None


def test_along_the_leg_a_look_ends_with_the_nose_back(pause: Pause, outlook: Outlook) -> None:
    pause.begin(outlook, 1, 0.0)
    headings(pause)
    assert abs(pause._reference.heading_rad) > math.radians(30.0)
    pause.begin(outlook, 1, 0.0, along_leg=True)
    headings(pause)
    assert wrap_angle(pause._reference.heading_rad) == pytest.approx(0.0)
