import pytest

from onboard.event_limiter import EVENT_PERIOD_S, EventLimiter


@pytest.mark.parametrize("period_s", [0.02, 1.0, EVENT_PERIOD_S, 7.0])
def test_one_kind_is_said_at_most_once_in_a_period(period_s: float) -> None:
    limiter = EventLimiter()
    times_s = [step * period_s for step in range(round(60.0 / period_s))]
    said_s = [time_s for time_s in times_s if limiter.allows("adapted obstacle_size", time_s)]
    assert said_s[0] == 0.0
    assert len(said_s) == len(times_s) if period_s >= EVENT_PERIOD_S else len(said_s) == 12


def test_kinds_do_not_silence_each_other_however_many_there_are() -> None:
    limiter = EventLimiter()
    assert all(limiter.allows(f"obstacle {number}", 0.0) for number in range(10_000))
    assert not limiter.allows("obstacle 9999", 1.0)
