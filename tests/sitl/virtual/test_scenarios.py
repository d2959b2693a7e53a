"""Every broken assumption ends as its scenario expects."""

from pathlib import Path

import pytest

from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import result_of
from gcs_tools.scenario import Scenario, load_scenario
from sitl.virtual.simulation import SimulatedFlight, fly

SCENARIOS = sorted((Path(__file__).parents[3] / "config" / "scenarios").glob("*.yaml"))


def flight_of(scenario: Scenario, time_limit_s: float) -> SimulatedFlight:
    return SimulatedFlight(
        scenario.contract,
        scenario.mission,
        scenario.sitl_config(seed=1),
        scenario.obstacles,
        faults=scenario.faults,
        time_limit_s=time_limit_s,
    )


def test_a_reset_of_the_estimate_does_not_fly_the_vehicle_aside(tmp_path: Path) -> None:
    """It is asked to hold where it believes to be, 3 m beside where it is."""
    scenario = load_scenario(next(path for path in SCENARIOS if path.stem == "estimator_reset"))
    flight = flight_of(scenario, time_limit_s=120.0)
    fly(flight, tmp_path)
    truths = read_log(tmp_path / "truth.mcap").truths
    assert max(abs(truth.position_ned_m[1]) for truth in truths) < 1.0


@pytest.mark.parametrize(
    ("scenario_name", "event", "texts"),
    [
        ("disk_full", "log_ended", ["flying on without a log: [Errno 28] No space left on device"]),
        ("mission_changed", "mission_changed", ["mission changed: flying the new mission now"]),
    ],
)
def test_what_breaks_no_assumption_is_said_once(
    tmp_path: Path, scenario_name: str, event: str, texts: list[str]
) -> None:
    scenario = load_scenario(next(path for path in SCENARIOS if path.stem == scenario_name))
    flight = flight_of(scenario, time_limit_s=30.0)
    fly(flight, tmp_path)
    events = read_log(tmp_path / "flight.mcap").events
    assert [e.text for e in events if e.name == event] == texts


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_broken_assumption_ends_as_expected(path: Path, tmp_path: Path) -> None:
    scenario = load_scenario(path)
    flight = flight_of(scenario, time_limit_s=120.0)
    report = fly(flight, tmp_path)
    logs = [read_log(tmp_path / f"{name}.mcap") for name in ("flight", "truth")]
    result = result_of(*logs, seed=1, aborted=report.aborted)
    assert result.meets(scenario.expect), result
    assert result.collisions == 0
    assert report.virtual_s < 120.0
