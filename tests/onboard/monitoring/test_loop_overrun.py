import pytest

from onboard.contract.assessment import TICK_S
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.loop_overrun import TICK_OVERRUN_S, LoopOverrunMonitor


def test_ticks_in_time_are_accepted() -> None:
    monitor = LoopOverrunMonitor()
    assert not [step for step in range(100) if monitor.check(step * TICK_S) is not None]


@pytest.mark.parametrize("step_s", [TICK_OVERRUN_S + 1e-6, 0.0, -1.0])
def test_late_tick_and_time_that_stands_still_are_violations(step_s: float) -> None:
    monitor = LoopOverrunMonitor()
    monitor.check(10.0)
    found = monitor.check(10.0 + step_s)
    assert found is not None
    assert found.assumption is Assumption.TICK_OVERRUN
