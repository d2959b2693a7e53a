import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.monitoring.response.sent_setpoints import SENT_MEMORY_S, SentSetpoints
from onboard.vehicle_state import Setpoint


def setpoint(north: float) -> Setpoint:
    return Setpoint((north, 0.0, -4.0), (0.0, north, 0.0), (north, -north, 0.5), 0.1)


def sent(*times_s: float) -> SentSetpoints:
    setpoints = SentSetpoints()
    for time_s in times_s:
        setpoints.add(setpoint(time_s), time_s)
    return setpoints


def test_without_setpoints_no_acceleration_was_asked_for() -> None:
    assert SentSetpoints().acceleration_ned_mps2(0.0) == (0.0, 0.0, 0.0)
    assert list(SentSetpoints().newest_first()) == []


@pytest.mark.parametrize(
    ("time_s", "north_mps2"), [(0.5, 1.0), (1.0, 1.0), (1.01, 1.2), (1.2, 1.2), (1.4, 1.4)]
)
def test_what_was_asked_for_is_the_first_setpoint_from_then_on(
    time_s: float, north_mps2: float
) -> None:
    found = sent(1.0, 1.2, 1.4).acceleration_ned_mps2(time_s)
    assert found == (north_mps2, -north_mps2, 0.5)


def test_after_the_last_setpoint_nothing_was_asked_for() -> None:
    assert sent(1.0, 1.2).acceleration_ned_mps2(1.21) == (0.0, 0.0, 0.0)


def test_targets_come_newest_first_with_position_and_velocity() -> None:
    assert list(sent(1.0, 1.2).newest_first()) == [
        ((1.2, 0.0, -4.0), (0.0, 1.2, 0.0)),
        ((1.0, 0.0, -4.0), (0.0, 1.0, 0.0)),
    ]


@given(st.lists(st.floats(0.001, 0.5), min_size=1, max_size=60))
def test_as_much_is_remembered_as_the_echo_may_lag(steps_s: list[float]) -> None:
    times_s = [sum(steps_s[: index + 1]) for index in range(len(steps_s))]
    remembered = [position[0] for position, _ in sent(*times_s).newest_first()]
    expected = [time_s for time_s in reversed(times_s) if time_s >= times_s[-1] - SENT_MEMORY_S]
    assert remembered == expected
