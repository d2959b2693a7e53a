"""When messages are due on a link."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.streams import StreamSchedule, messages_of_data_stream
from sitl.autopilot.protocol.telemetry import BUILDERS

FAST, SLOW = 30, 0


def due_times_s(schedule: StreamSchedule, message_id: int, until_s: float) -> list[float]:
    ticks = range(round(until_s / 0.01) + 1)
    return [tick * 0.01 for tick in ticks if message_id in schedule.due(tick * 0.01)]


def test_messages_come_at_their_default_rates_from_the_start() -> None:
    schedule = StreamSchedule({FAST: 50.0, SLOW: 1.0})
    assert len(due_times_s(schedule, FAST, 0.99)) == 50
    assert due_times_s(StreamSchedule({SLOW: 1.0}), SLOW, 2.5) == pytest.approx([0.0, 1.0, 2.0])


def test_what_has_no_rate_never_comes() -> None:
    schedule = StreamSchedule({SLOW: 1.0})
    assert schedule.interval_s(FAST) == math.inf
    assert due_times_s(schedule, FAST, 5.0) == []


def test_an_interval_counts_from_the_request() -> None:
    schedule = StreamSchedule({SLOW: 1.0})
    schedule.set_interval(FAST, 0.5, 1.0)
    assert schedule.interval_s(FAST) == 0.5
    assert due_times_s(schedule, FAST, 2.4) == pytest.approx([1.0, 1.5, 2.0])


def test_a_stopped_message_comes_again_after_a_reset() -> None:
    schedule = StreamSchedule({SLOW: 1.0})
    schedule.set_interval(SLOW, math.inf, 0.0)
    assert due_times_s(schedule, SLOW, 3.0) == []
    schedule.reset_interval(SLOW, 4.0)
    assert schedule.interval_s(SLOW) == 1.0
    assert schedule.due(4.0) == [SLOW]


def test_resetting_a_message_without_a_default_stops_it() -> None:
    schedule = StreamSchedule({SLOW: 1.0})
    schedule.set_interval(FAST, 0.1, 0.0)
    schedule.reset_interval(FAST, 1.0)
    assert schedule.interval_s(FAST) == math.inf
    assert FAST not in schedule.due(2.0)


def test_a_pause_owes_one_message_at_most() -> None:
    schedule = StreamSchedule({FAST: 100.0})
    schedule.due(0.0)
    assert schedule.due(10.0) == [FAST]
    assert schedule.due(10.001) == [FAST]  # the phase starts again at the call
    assert schedule.due(10.002) == []


def test_an_empty_schedule_has_nothing_due() -> None:
    assert StreamSchedule({}).due(1e6) == []


@given(rate_hz=st.floats(0.5, 50.0))
def test_the_rate_is_kept_over_time(rate_hz: float) -> None:
    count = len(due_times_s(StreamSchedule({FAST: rate_hz}), FAST, 10.0))
    assert abs(count - 10.0 * rate_hz) <= 2.0


def test_every_message_of_a_data_stream_can_be_built() -> None:
    everything = messages_of_data_stream(mavlink.MAV_DATA_STREAM_ALL)
    assert set(everything) <= set(BUILDERS)
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in everything
    assert messages_of_data_stream(mavlink.MAV_DATA_STREAM_EXTRA1) == (
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
    )
    assert messages_of_data_stream(99) == ()
