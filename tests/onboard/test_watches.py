import pytest

from onboard.contract import TICK_S
from onboard.mavlink import Pose
from onboard.monitor import Assumption, Violation
from onboard.watches import TICK_OVERRUN_S, PositionWatch, TickWatch


def names(violations: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in violations]


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
