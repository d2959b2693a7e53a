import pytest

from onboard.event_limiter import _KINDS_MAX, EVENT_PERIOD_S, EventLimiter


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


def test_of_a_flood_of_kinds_only_the_latest_are_remembered() -> None:
    limiter = EventLimiter()
    limiter.allows("first", 0.0)
    for number in range(_KINDS_MAX - 1):
        limiter.allows(f"obstacle {number}", 0.0)
    assert not limiter.allows("first", 1.0)
    limiter.allows("one more", 1.0)
    assert len(limiter._allowed_s) == _KINDS_MAX
    assert limiter.allows("first", 1.0)  # forgotten


def test_a_kind_that_is_refused_does_not_put_off_its_turn() -> None:
    limiter = EventLimiter()
    assert limiter.allows("merged", 0.0)
    assert not limiter.allows("merged", 0.9 * EVENT_PERIOD_S)
    assert limiter.allows("merged", EVENT_PERIOD_S)


def test_a_kind_that_was_said_again_outlives_older_ones() -> None:
    limiter = EventLimiter()
    limiter.allows("kept", 0.0)
    limiter.allows("old", 0.0)
    limiter.allows("kept", EVENT_PERIOD_S)
    for number in range(_KINDS_MAX - 1):
        limiter.allows(f"obstacle {number}", EVENT_PERIOD_S)
    assert not limiter.allows("kept", EVENT_PERIOD_S + 1.0)
    assert "old" not in limiter._allowed_s
