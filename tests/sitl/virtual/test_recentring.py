"""Flights that come back to their leg line, beside the same flights that do not (theory F)."""

from dataclasses import replace
from pathlib import Path

import pytest

from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import Result, result_of
from gcs_tools.scenario import Scenario, load_scenario, with_run_on
from onboard.files.contract_file import load_contract
from sitl.virtual.simulation import SimulatedFlight, fly

CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(CONFIG / "recentring.yaml")


def flown(scenario: Scenario, directory: Path) -> Result:
    report = fly(
        SimulatedFlight(
            contract=scenario.contract,
            mission=scenario.mission,
            sitl=scenario.sitl_config(seed=1),
            obstacles=scenario.obstacles,
        ),
        directory,
    )
    assert report.aborted is None
    return result_of(
        read_log(directory / "flight.mcap"), read_log(directory / "truth.mcap"), seed=1
    )


def test_it_ends_on_the_line(scenario: Scenario, tmp_path: Path) -> None:
    result = flown(scenario, tmp_path)
    assert (result.outcome, result.collisions, result.violations) == ("arrived", 0, ())
    assert result.obstacles_avoided == 2
    assert result.final_position_ned_m is not None
    assert abs(result.final_position_ned_m[1]) < 0.2


def test_without_recentring_it_leaves_the_line_and_threads_back(
    scenario: Scenario, tmp_path: Path
) -> None:
    contract = load_contract(CONFIG / "default_contract.yaml")
    contract = with_run_on(contract, scenario.plant)
    result = flown(replace(scenario, contract=contract), tmp_path)
    assert (result.outcome, result.collisions, result.threaded) == ("arrived", 0, True)
    # Before, it cruised metres beside the line, with nothing in its way.
    states = read_log(tmp_path / "flight.mcap").states
    beside_m = [
        abs(s.position_ned_m[1]) for s in states if s.state == "cruising" and s.position_ned_m
    ]
    assert beside_m[-1] > 1.0
