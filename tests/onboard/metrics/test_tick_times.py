import pytest

from onboard.metrics.tick_times import BUCKETS_S, LATE_TICK_S, LateCause, TickTimes


def test_a_tick_that_is_little_late_is_not_late() -> None:
    ticks = TickTimes()
    assert ticks.begin(LATE_TICK_S, 0.0) is None
    assert sum(ticks.late.values()) == 0


def test_a_late_tick_is_starved_where_the_wait_for_a_processor_explains_it() -> None:
    ticks = TickTimes()
    ticks.begin(0.0, 5.0)
    assert ticks.begin(0.1, 5.08) is LateCause.STARVED
    # The wait counts once: what was waited for before explains no further lateness.
    assert ticks.begin(0.1, 5.08) is LateCause.OWN
    assert ticks.late == {LateCause.OWN: 1, LateCause.STARVED: 1}
    assert ticks.late_max_s == {LateCause.OWN: 0.1, LateCause.STARVED: 0.1}


def test_a_wait_that_explains_part_of_it_only_leaves_it_our_own() -> None:
    ticks = TickTimes()
    ticks.begin(0.0, 0.0)
    assert ticks.begin(0.1, 0.05) is LateCause.OWN


def test_the_first_tick_knows_no_wait() -> None:
    assert TickTimes().begin(0.1, 9.0) is LateCause.OWN


def test_durations_are_counted_by_bucket() -> None:
    ticks = TickTimes()
    for duration_s in (0.0005, 0.001, 0.004, 9.0):
        ticks.end(duration_s)
    counts = dict(ticks.cumulative())
    assert counts[BUCKETS_S[0]] == 2
    assert counts[0.005] == 3
    assert counts[BUCKETS_S[-1]] == 3
    assert counts[float("inf")] == ticks.count == 4
    assert ticks.duration_max_s == 9.0
    assert ticks.duration_sum_s == pytest.approx(9.0055)
