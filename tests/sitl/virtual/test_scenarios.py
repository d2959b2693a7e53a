"""Every broken assumption ends as its scenario expects."""

from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_tools.logs.flight_log import Log, read_log
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


def stays_on_its_line(flight: Log, truth: Log) -> None:
    """It is asked to hold where it believes to be, 3 m beside where it is."""
    del flight
    assert max(abs(each.position_ned_m[1]) for each in truth.truths) < 1.0


def says_once(event: str, text: str) -> Callable[[Log, Log], None]:
    """Return a check that what breaks no assumption is said once."""

    def check(flight: Log, truth: Log) -> None:
        del truth
        assert [each.text for each in flight.events if each.name == event] == [text]

    return check


def flies_over_all_but_the_tree(flight: Log, truth: Log) -> None:
    """The hedge has no end within the leg, and the car stands in the way."""
    assert {plan.obstacle for plan in flight.plans} == {"front/tree"}
    crossed = [each.position_ned_m[1] for each in truth.truths if 15 < each.position_ned_m[0] < 33]
    assert max(map(abs, crossed)) < 1.0


def avoids_the_car(flight: Log, truth: Log) -> None:
    del truth
    assert {plan.obstacle for plan in flight.plans} == {"front/car"}


# What a scenario shows besides what its file expects.
ALSO: dict[str, Callable[[Log, Log], None]] = {
    "estimator_reset": stays_on_its_line,
    "disk_full": says_once(
        "log_ended", "flying on without a log: [Errno 28] No space left on device"
    ),
    "low_hedge_and_car": flies_over_all_but_the_tree,
    "car_of_unknown_height": avoids_the_car,
    "mission_changed": says_once("mission_changed", "mission changed: flying the new mission now"),
}


def test_what_is_checked_besides_is_flown() -> None:
    assert {path.stem for path in SCENARIOS} >= ALSO.keys()


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
    if path.stem in ALSO:
        ALSO[path.stem](*logs)
