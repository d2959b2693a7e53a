"""The meter of the daemon, and that its hooks hear what happens in a flight."""

from __future__ import annotations

import os

import pytest

from gcs_tools.scenario import load_scenario
from onboard.guidance.phases import Phase
from sitl.virtual.simulation import SimulatedFlight, Simulation
from tests.benchmarks.daemon_meter import DaemonMeter, hooks
from tests.gcs_tools.running import CONFIG


class Clock:
    """A clock that tests set."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_a_detection_waits_for_its_tick(clock: Clock) -> None:
    meter = DaemonMeter(clock, lambda: clock.now_s / 10.0)
    frame = b"frame"
    for now_s in (0.0, 0.02):
        clock.now_s = now_s
        meter.tick_begins()
        meter.sends(Phase.CRUISE, setpoint=True)
    clock.now_s = 0.03
    meter.arrives(frame)
    clock.now_s = 0.035
    meter.taken(frame)
    clock.now_s = 0.04
    meter.tick_begins()
    clock.now_s = 0.041
    meter.sends(Phase.CRUISE, setpoint=True)
    assert meter.latencies_s[Phase.CRUISE] == pytest.approx([0.011])
    assert meter.wall_s[Phase.CRUISE] == pytest.approx(0.04)
    assert meter.processor_s[Phase.CRUISE] == pytest.approx(0.004)


def test_in_dense_flight_a_detection_waits_for_the_plan_that_is_begun_with_it(clock: Clock) -> None:
    meter = DaemonMeter(clock)
    frames = [bytes([number]) for number in range(2)]
    for now_s, frame in ((0.0, frames[0]), (0.1, frames[1])):
        clock.now_s = now_s
        meter.arrives(frame)
        meter.taken(frame)
        meter.tick_begins()
        if frame is frames[0]:
            meter.plan_begins()
        meter.sends(Phase.THREAD, setpoint=True)
    for now_s in (0.2, 0.4):
        clock.now_s = now_s
        meter.tick_begins()
        meter.node_passed()
        meter.plan_begins()
        meter.sends(Phase.THREAD, setpoint=True)
    assert meter.latencies_s[Phase.THREAD] == pytest.approx([0.2, 0.3])


def test_memory_and_start_are_stated(clock: Clock) -> None:
    meter = DaemonMeter(clock)
    assert meter.document(0.0)["start_s"] is None
    clock.now_s = 3.0
    meter.note_ready()
    document = meter.document(1.0)
    assert document["start_s"] == 2.0
    assert 10.0 < document["peak_mb"] < os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def test_the_hooks_hear_a_flight_through_a_forest(monkeypatch: pytest.MonkeyPatch) -> None:
    meter = DaemonMeter()
    for owner, name, hook in hooks(meter):
        monkeypatch.setattr(owner, name, hook)
    scenario = load_scenario(CONFIG / "scenarios" / "uniform_forest.yaml")
    flight = SimulatedFlight(
        scenario.contract, scenario.mission, scenario.sitl_config(seed=1), scenario.obstacles
    )
    simulation = Simulation(flight)
    while len(meter.latencies_s[Phase.THREAD]) < 10 and simulation.now_s < 60.0:
        simulation.advance()
    assert meter.processor_s[Phase.THREAD] > 0.0
    assert min(meter.latencies_s[Phase.THREAD]) > 0.0
