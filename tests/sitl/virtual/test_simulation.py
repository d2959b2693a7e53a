"""The whole system in virtual time: what issue "the main job" promises of a flight."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from gcs_tools.scenario import load_scenario
from onboard.guidance.phases import Phase
from sitl.virtual.faults.schema import Fault
from sitl.virtual.scripted_operator import Step
from sitl.virtual.simulation import SimulatedFlight, Simulation, fly
from sitl.virtual.standstill import STILL_FOR_S

CONFIG = Path(__file__).parents[3] / "config"


def flight_of(scenario: str, seed: int = 1) -> SimulatedFlight:
    read = load_scenario(CONFIG / scenario)
    return SimulatedFlight(
        contract=read.contract,
        mission=read.mission,
        sitl=read.sitl_config(seed=seed),
        obstacles=read.obstacles,
        seed=seed,
        fly_outside_contract=read.fly_outside_contract,
        time_limit_s=120.0,
    )


def pure_form(flight: SimulatedFlight) -> SimulatedFlight:
    """The same flight without the invariant, as the paper flies: it may climb, and it may HOLD."""
    requirements = flight.contract.requirements.model_copy(update={"stop": False})
    contract = flight.contract.model_copy(update={"requirements": requirements})
    return dataclasses.replace(flight, contract=contract)


def messages(log: Path, topic: str) -> Iterator[dict[str, Any]]:
    with log.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=[topic]):
            yield json.loads(message.data)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("paper")
    assert fly(flight_of("paper.yaml"), directory).aborted is None
    return directory


def test_paper_flight_arrives_without_violation(flown: Path) -> None:
    events = list(messages(flown / "flight.mcap", "/events"))
    assert [event["text"] for event in events if event["name"] == "violation"] == []
    phases = [event["data"]["to"] for event in events if event["name"] == "phase"]
    assert phases == ["cruise", *["avoid", "cruise"] * 3, "arrived", "standby"]


def test_paper_flight_stays_clear_and_ends_where_the_paper_does(flown: Path) -> None:
    truth = list(messages(flown / "truth.mcap", "/truth"))
    assert truth[-1]["collisions"] == 0
    assert truth[-1]["clearance_min_m"] > 0.0
    states = list(messages(flown / "flight.mcap", "/state"))
    arrived = next(state for state in states if state["phase"] == "arrived")
    assert arrived["position_ned_m"] == pytest.approx([46.0, 0.3, -4.0], abs=0.5)


def test_paper_flight_is_tracked_within_its_contract(flown: Path) -> None:
    limit_m = flight_of("paper.yaml").contract.vehicle.tracking_error_m
    states = list(messages(flown / "flight.mcap", "/state"))
    assert max(state["tracking_error_m"] for state in states) < limit_m


def test_every_plan_is_the_solvers(flown: Path) -> None:
    plans = list(messages(flown / "flight.mcap", "/plan"))
    assert [plan["kind"] for plan in plans] == ["qp"] * 3
    assert {plan["obstacle"] for plan in plans} == {"front/1", "front/2", "front/3"}


def test_paper_flight_climbs_to_gain_agility(tmp_path: Path) -> None:
    assert fly(pure_form(flight_of("paper.yaml")), tmp_path).aborted is None
    plans = list(messages(tmp_path / "flight.mcap", "/plan"))
    highest_m = min(point[2] for plan in plans for point in plan["path_ned_m"])
    assert highest_m < -4.0 - 0.01


def test_same_seed_gives_the_same_bytes(flown: Path, tmp_path: Path) -> None:
    fly(flight_of("paper.yaml"), tmp_path)
    for name in ("flight.mcap", "truth.mcap"):
        first, second = ((place / name).read_bytes() for place in (flown, tmp_path))
        assert hashlib.sha256(first).digest() == hashlib.sha256(second).digest()


def test_intersecting_regions_end_in_hold(tmp_path: Path) -> None:
    fly(pure_form(flight_of("intersecting_rois.yaml")), tmp_path)
    events = list(messages(tmp_path / "flight.mcap", "/events"))
    assert [e["data"]["to"] for e in events if e["name"] == "phase"][-2:] == ["hold", "standby"]
    (violation,) = [e["data"] for e in events if e["name"] == "violation"]
    assert violation["assumption"] == "roi_intersection"
    *_, last = messages(tmp_path / "truth.mcap", "/truth")
    assert last["collisions"] == 0


def test_intersecting_regions_are_passed_on_certified_ways(tmp_path: Path) -> None:
    fly(flight_of("intersecting_rois.yaml"), tmp_path)
    events = list(messages(tmp_path / "flight.mcap", "/events"))
    assert [e["data"]["to"] for e in events if e["name"] == "phase"][-2:] == ["arrived", "standby"]
    assert all(s["phase"] != "hold" for s in messages(tmp_path / "flight.mcap", "/state"))
    *_, last = messages(tmp_path / "truth.mcap", "/truth")
    assert last["collisions"] == 0


def test_a_hold_is_flown_to_standstill_before_the_operator_lands() -> None:
    simulation = Simulation(pure_form(flight_of("intersecting_rois.yaml")))
    speeds_mps = []
    while simulation.operator.step is not Step.LAND:
        simulation.advance()
        if simulation.autonomy.navigator.phase is Phase.HOLD:
            speeds_mps.append(simulation.scene.vehicle.truth.ground_speed_mps)
    assert speeds_mps[0] > 1.0
    assert max(speeds_mps[-round(0.9 * STILL_FOR_S / 0.02) :]) < 0.3


def test_daemon_that_dies_in_cruise_is_stopped_by_the_autopilot() -> None:
    simulation = Simulation(flight_of("paper.yaml"))
    while simulation.autonomy.navigator.phase is not Phase.CRUISE or simulation.now_s < 10.0:
        simulation.advance()
    scene, died_s = simulation.scene, simulation.now_s
    scene.advance(died_s + 6.0)
    assert scene.vehicle.truth.ground_speed_mps < 0.05
    assert scene.vehicle.truth.position_ned_m[2] == pytest.approx(-4.0, abs=0.3)
    assert scene.world.collisions == 0


def test_the_operator_lands_a_vehicle_that_waits_for_its_sensor_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sitl.virtual.simulation.PAUSE_PATIENCE_S", 3.0)
    flight = flight_of("scenarios/resume_best_effort.yaml")
    blind = Fault(kind="detections_off", phase=Phase.PAUSE, start_s=0.1)
    simulation = Simulation(dataclasses.replace(flight, faults=(blind,)))
    paused_s = 0.0
    while not simulation.over and simulation.now_s < 60.0:
        simulation.advance()
        paused_s += 0.02 * (simulation.autonomy.navigator.phase is Phase.PAUSE)
    assert simulation.over
    assert 3.0 <= paused_s < 5.0
