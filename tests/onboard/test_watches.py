import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract import TICK_S
from onboard.mavlink import Pose
from onboard.monitor import Assumption, Violation
from onboard.watches import TICK_OVERRUN_S, DetectionWatch, PositionWatch, TickWatch
from tests.onboard.example_terms import TERMS


def names(violations: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in violations]


def test_sensor_that_was_never_heard_is_blind() -> None:
    watch = DetectionWatch()
    violation = watch.check(0.0, TERMS)
    assert violation is not None
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.event(0.0).data["measured"] is None


def test_silence_is_noticed_as_soon_as_it_exceeds_the_frame_age() -> None:
    watch = DetectionWatch()
    assert watch.on_frame("front", 10.0, 10.05, TERMS) == []
    assert watch.check(10.29, TERMS) is None
    assert watch.check(10.31, TERMS) is not None


def test_old_frame_does_not_rejuvenate() -> None:
    watch = DetectionWatch()
    watch.on_frame("front", 10.0, 10.05, TERMS)
    watch.on_frame("front", 9.0, 10.25, TERMS)
    assert watch.age_s(10.3) == pytest.approx(0.3)


def test_silence_of_one_of_two_sensors_is_silence() -> None:
    watch = DetectionWatch()
    watch.on_frame("front", 10.0, 10.0, TERMS)
    for step in range(20):
        watch.on_frame("left", 10.0 + step * 0.05, 10.0 + step * 0.05, TERMS)
    assert watch.check(10.95, TERMS) is not None


@pytest.mark.parametrize(
    ("interval_s", "latency_s", "in_time"), [(0.05, 0.05, True), (0.1, 0.06, False)]
)
def test_reaction_takes_an_interval_and_a_latency(
    interval_s: float, latency_s: float, *, in_time: bool
) -> None:
    watch = DetectionWatch()
    seen = [
        watch.on_frame("front", step * interval_s, step * interval_s + latency_s, TERMS)
        for step in range(4)
    ]
    assert seen[0] == []
    for later in seen[1:]:
        assert names(later) == ([] if in_time else [Assumption.REACTION_TIME])


def test_frame_from_the_future_is_a_clock_fault_and_no_sight() -> None:
    watch = DetectionWatch()
    assert names(watch.on_frame("front", 11.0, 10.0, TERMS)) == [Assumption.SENSOR_CLOCK]
    assert watch.check(10.0, TERMS) is not None


def pose(time_s: float, x_m: float, vx_mps: float = 2.8) -> Pose:
    return Pose(time_s, (x_m, 0.0, -4.0), (vx_mps, 0.0, 0.0), 0.0, 0.0, 0.0)


def test_telemetry_grows_stale() -> None:
    watch = PositionWatch(stale_after_s=0.5)
    assert watch.check_age(pose(1.0, 0.0), 1.5) is None
    stale = watch.check_age(pose(1.0, 0.0), 1.51)
    assert stale is not None
    assert stale.assumption is Assumption.TELEMETRY_AGE
    assert watch.check_age(None, 0.0) is not None


def test_flight_is_no_jump_but_a_reset_is() -> None:
    watch = PositionWatch(stale_after_s=0.5)
    for step in range(50):
        assert watch.check_jump(pose(step * 0.02, step * 0.056)) is None
    reset = watch.check_jump(pose(1.0, 50 * 0.056 + 0.6))
    assert reset is not None
    assert reset.assumption is Assumption.ESTIMATOR_RESET
    assert watch.check_jump(pose(1.02, 51 * 0.056 + 0.6)) is None


def test_ticks_in_time_are_accepted() -> None:
    watch = TickWatch()
    assert not [step for step in range(100) if watch.check(step * TICK_S) is not None]


@pytest.mark.parametrize("step_s", [TICK_OVERRUN_S + 1e-6, 0.0, -1.0])
def test_late_tick_and_time_that_stands_still_are_violations(step_s: float) -> None:
    watch = TickWatch()
    watch.check(10.0)
    found = watch.check(10.0 + step_s)
    assert found is not None
    assert found.assumption is Assumption.TICK_OVERRUN


@given(st.lists(st.floats(0.0, 10.0), min_size=1))
def test_age_is_that_of_the_newest_frame(stamps_s: list[float]) -> None:
    watch = DetectionWatch()
    for stamp_s in stamps_s:
        watch.on_frame("front", stamp_s, 10.0, TERMS)
    assert watch.age_s(10.0) == pytest.approx(10.0 - max(stamps_s))
