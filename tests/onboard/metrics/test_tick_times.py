import pytest

from onboard.metrics.tick_times import BUCKETS_S, LATE_TICK_S, LateCause, TickTimes


def test_a_tick_that_is_little_late_is_not_late() -> None:
    ticks = TickTimes()
    assert ticks.begin(LATE_TICK_S, 0.0, 0.0) is None
    assert sum(ticks.late.values()) == 0


@pytest.mark.parametrize(
    ("ran_s", "waited_s", "cause"),
    [
        (0.001, 0.08, LateCause.STARVED),
        (0.001, 0.05, LateCause.OWN),  # the wait explains part of it only
        (0.001, 0.0, LateCause.OWN),
        # It ran for longer than a tick may take: whatever another thread waited for.
        (0.09, 0.08, LateCause.OWN),
    ],
)
def test_a_late_tick_is_starved_where_a_wait_for_a_processor_explains_it(
    ran_s: float, waited_s: float, cause: LateCause
) -> None:
    ticks = TickTimes()
    ticks.begin(0.0, 0.02, 0.0)
    assert ticks.begin(0.1, ran_s, waited_s) is cause
    assert ticks.late == dict.fromkeys(LateCause, 0) | {cause: 1}
    assert ticks.late_max_s[cause] == 0.1


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
