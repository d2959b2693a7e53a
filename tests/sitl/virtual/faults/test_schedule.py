"""When faults are present: windows from the start, and from entries into phases."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.guidance.phases import Phase
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault


def test_nothing_is_present_before_the_first_advance() -> None:
    schedule = FaultSchedule((Fault(kind="gust"),), seed=1)
    assert not schedule.any_present
    assert schedule.amount("gust") is None


@given(
    start_s=st.floats(0.0, 50.0),
    duration_s=st.floats(0.1, 50.0),
    now_s=st.floats(0.0, 120.0),
)
def test_a_window_is_half_open(start_s: float, duration_s: float, now_s: float) -> None:
    fault = Fault(kind="tick_stall", start_s=start_s, duration_s=duration_s)
    schedule = FaultSchedule((fault,), seed=1)
    schedule.advance(now_s, "cruise")
    assert schedule.present("tick_stall") is (0.0 <= now_s - start_s < duration_s)


def test_a_window_without_a_duration_stays_open() -> None:
    schedule = FaultSchedule((Fault(kind="gps_lost", start_s=1.0),), seed=1)
    schedule.advance(1e6, "cruise")
    assert schedule.present("gps_lost")


def test_a_window_counts_from_the_named_entry_into_a_phase() -> None:
    fault = Fault(kind="tick_stall", phase=Phase.AVOID, entry=2, start_s=0.5, duration_s=1.0)
    schedule = FaultSchedule((fault,), seed=1)
    stalled = []
    phases = ["cruise", "avoid", "cruise", "avoid", "avoid", "avoid", "cruise"]
    for step, phase in enumerate(phases):
        schedule.advance(step * 0.5, phase)
        stalled.append(schedule.present("tick_stall"))
    assert stalled == [False, False, False, False, True, True, False]


def test_a_window_of_a_phase_that_never_comes_never_opens() -> None:
    schedule = FaultSchedule((Fault(kind="tick_stall", phase=Phase.HOLD),), seed=1)
    for step in range(100):
        schedule.advance(step * 0.5, "cruise")
        assert not schedule.any_present


def test_a_window_outlasts_the_phase_that_opened_it() -> None:
    schedule = FaultSchedule((Fault(kind="tick_stall", phase=Phase.AVOID, duration_s=3.0),), seed=1)
    schedule.advance(1.0, "avoid")
    schedule.advance(2.0, "cruise")
    assert schedule.present("tick_stall")
    schedule.advance(4.0, "cruise")
    assert not schedule.present("tick_stall")


def test_of_two_faults_of_one_kind_the_later_in_the_list_is_present() -> None:
    faults = (
        Fault(kind="gust", amount=1.0),
        Fault(kind="gust", start_s=2.0, duration_s=1.0, amount=5.0),
    )
    schedule = FaultSchedule(faults, seed=1)
    amounts = []
    for now_s in (0.0, 2.0, 3.0):
        schedule.advance(now_s, "cruise")
        amounts.append(schedule.amount("gust"))
    assert amounts == [1.0, 5.0, 1.0]


def test_amounts_keep_the_order_of_the_scenario() -> None:
    faults = (Fault(kind="gust"), Fault(kind="detections_late"), Fault(kind="attitude_slow"))
    schedule = FaultSchedule(faults, seed=1)
    schedule.advance(0.0, "cruise")
    assert list(schedule.amounts.items()) == [
        ("gust", 6.0),
        ("detections_late", 0.25),
        ("attitude_slow", 3.0),
    ]


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_one_seed_is_one_sequence_of_random_numbers(seed: int) -> None:
    first, second = FaultSchedule((), seed), FaultSchedule((), seed)
    other = FaultSchedule((), seed + 1)
    drawn = [first.chance.random() for _ in range(5)]
    assert drawn == [second.chance.random() for _ in range(5)]
    assert drawn != [other.chance.random() for _ in range(5)]
