"""When a vehicle that gets no nearer pauses."""

import math

import pytest

from onboard.guidance.dense.standstill_clock import StandstillClock
from onboard.planning.corridor.guide import FAR_M


def stopped_at_s(
    lefts_m: list[float], step_s: float = 1.0, *, length_m: float = 50.0
) -> float | None:
    clock = StandstillClock()
    clock.begin_leg(0.0, length_m)
    for index, left_m in enumerate(lefts_m):
        if clock.has_stopped(left_m, index * step_s, still=False):
            return index * step_s
    return None


def test_getting_nearer_is_progress() -> None:
    assert stopped_at_s([100.0 - 0.3 * index for index in range(200)]) is None


def test_without_progress_it_stops() -> None:
    assert stopped_at_s([50.0] * 20) == 6.0


def test_a_guide_that_has_become_longer_begins_again() -> None:
    assert stopped_at_s([*[50.0] * 4, *(70.0 - 0.5 * index for index in range(20))]) is None


def test_to_and_fro_for_ever_is_no_progress() -> None:
    lefts_m = [20.0 * lap + 20.0 - 2.0 * step for lap in range(40) for step in range(9)]
    stopped_s = stopped_at_s(lefts_m)
    assert stopped_s is not None
    assert stopped_s > 50.0


def test_the_long_way_round_is_tried_once_and_then_looked_at() -> None:
    # To the end of the leg, back round its start, and to the end again, faster than ever stopping.
    forth = [50.0 - 2.0 * step for step in range(24)]
    back = [120.0 - 2.0 * step for step in range(35)]
    assert stopped_at_s([*forth, *back, *forth]) is None
    stopped_s = stopped_at_s([*forth, *back, *forth, *back])
    assert stopped_s is not None
    assert stopped_s == len([*forth, *back, *forth]) + 5.0


@pytest.mark.parametrize("unknown_m", [FAR_M, math.inf])
def test_a_tick_without_a_way_is_no_detour(unknown_m: float) -> None:
    begun = [50.0 - step for step in range(10)]
    round_m = [75.0 - step for step in range(40)]
    assert stopped_at_s([*begun, unknown_m, *round_m]) is None
    assert stopped_at_s([*begun, *[unknown_m] * 4, *round_m]) is None
    # Where no way is known for long, nothing gets nearer.
    assert stopped_at_s([*begun, *[unknown_m] * 10]) == 9.0 + 6.0
    assert stopped_at_s([unknown_m] * 10) == 6.0


def test_beyond_the_distance_that_stands_for_none_a_way_is_measured_all_the_same() -> None:
    assert stopped_at_s([2.0 * FAR_M - step for step in range(1500)], length_m=2.0 * FAR_M) is None


def test_one_honest_detour_may_be_as_long_as_some_times_the_leg() -> None:
    detour_m = [400.0 - step for step in range(10)] + [600.0 - step for step in range(300)]
    assert stopped_at_s(detour_m, length_m=400.0) is None
    stopped_s = stopped_at_s(detour_m, length_m=20.0)
    assert stopped_s is not None
    assert stopped_s < 20.0


def test_rest_is_known_sooner() -> None:
    clock = StandstillClock()
    clock.begin_leg(0.0, 50.0)
    assert not clock.has_stopped(10.0, 0.0, still=True)
    assert not clock.has_stopped(10.0, 0.4, still=True)
    assert clock.has_stopped(10.0, 0.7, still=True)
