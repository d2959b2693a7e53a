from onboard.mavlink.message_requests import (
    EAGER_REQUESTS,
    PATIENT_PERIOD_S,
    REQUEST_PERIOD_S,
    MessageRequests,
)

WANTED = ((32, 50.0), (30, 50.0))


def asked_over(
    requests: MessageRequests, rates_hz: dict[int, float], begin_s: float, end_s: float
) -> list[tuple[float, int]]:
    """What is asked for while messages arrive at these rates, tick by tick."""
    asked = []
    ticks = range(round(begin_s / 0.02), round(end_s / 0.02))
    for tick in ticks:
        for message_id, rate_hz in rates_hz.items():
            arrived = int(tick * 0.02 * rate_hz + 1e-9) - int((tick - 1) * 0.02 * rate_hz + 1e-9)
            for _ in range(arrived):
                requests.heard(message_id)
        asked += [(tick * 0.02, message_id) for message_id, _ in requests.due(WANTED, tick * 0.02)]
    return asked


def test_what_is_silent_is_asked_for_at_once_and_again() -> None:
    asked = asked_over(MessageRequests(), {}, 0.0, 10.0)
    assert len(asked) == 2 * 10.0 / REQUEST_PERIOD_S


def test_what_comes_fast_enough_is_not_asked_for() -> None:
    requests = MessageRequests()
    requests.heard(32)
    requests.heard(30)
    assert asked_over(requests, {32: 50.0, 30: 41.0}, 0.0, 10.0) == []


def test_what_stays_too_slow_is_asked_for_eagerly_and_then_patiently() -> None:
    requests = MessageRequests()
    requests.heard(32)
    requests.heard(30)
    asked = asked_over(requests, {32: 30.0, 30: 50.0}, 0.0, 100.0)
    assert {message_id for _, message_id in asked} == {32}
    times_s = [time_s for time_s, _ in asked]
    assert len(times_s) == EAGER_REQUESTS + (100.0 - 6.0) // PATIENT_PERIOD_S
    assert times_s[EAGER_REQUESTS] - times_s[EAGER_REQUESTS - 1] >= PATIENT_PERIOD_S


def test_autopilot_that_restarts_is_asked_as_eagerly_as_at_first() -> None:
    requests = MessageRequests()
    asked_over(requests, {32: 30.0, 30: 50.0}, 0.0, 20.0)
    asked = asked_over(requests, {}, 20.0, 26.0)  # restarts, and has forgotten
    assert {message_id for _, message_id in asked} == {32, 30}
    again = asked_over(requests, {32: 30.0, 30: 50.0}, 26.0, 40.0)
    assert sum(message_id == 32 for _, message_id in again) == EAGER_REQUESTS
