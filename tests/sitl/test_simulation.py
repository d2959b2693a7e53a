"""The whole system in virtual time: what issue "the main job" promises of a flight."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from onboard.config import Mission, load_contract
from onboard.guidance import Phase
from onboard.yaml_file import load_yaml
from sitl.config import SitlConfig
from sitl.field import load_field
from sitl.simulation import SimulatedFlight, Simulation, fly

CONFIG = Path(__file__).parents[2] / "config"
TAKE_OFF = {"MIS_TAKEOFF_ALT": 4.0}


def paper_flight(seed: int = 1, field: Path = CONFIG / "paper_field.yaml") -> SimulatedFlight:
    return SimulatedFlight(
        contract=load_contract(CONFIG / "paper_contract.yaml"),
        mission=load_yaml(CONFIG / "paper_mission.yaml", Mission),
        sitl=load_yaml(CONFIG / "paper_sitl.yaml", SitlConfig),
        obstacles=load_field(field),
        seed=seed,
        time_limit_s=120.0,
    )


def messages(log: Path, topic: str) -> Iterator[dict[str, Any]]:
    with log.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=[topic]):
            yield json.loads(message.data)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("paper")
    assert fly(paper_flight(), directory).landed
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
    limit_m = load_contract(CONFIG / "paper_contract.yaml").vehicle.tracking_error_m
    states = list(messages(flown / "flight.mcap", "/state"))
    assert max(state["tracking_error_m"] for state in states) < limit_m


def test_every_plan_is_the_solvers(flown: Path) -> None:
    plans = list(messages(flown / "flight.mcap", "/plan"))
    assert [plan["kind"] for plan in plans] == ["qp"] * 3
    assert {plan["obstacle"] for plan in plans} == {"front/1", "front/2", "front/3"}


def test_paper_flight_climbs_to_gain_agility(flown: Path) -> None:
    plans = list(messages(flown / "flight.mcap", "/plan"))
    highest_m = min(point[2] for plan in plans for point in plan["path_ned_m"])
    assert highest_m < -4.0 - 0.01


def test_same_seed_gives_the_same_bytes(flown: Path, tmp_path: Path) -> None:
    fly(paper_flight(), tmp_path)
    for name in ("flight.mcap", "truth.mcap"):
        first, second = ((place / name).read_bytes() for place in (flown, tmp_path))
        assert hashlib.sha256(first).digest() == hashlib.sha256(second).digest()


def test_intersecting_regions_end_in_hold(tmp_path: Path) -> None:
    moved = tmp_path / "field.yaml"
    moved.write_text(
        '- {id: "1", center_ned_m: [15.0, 0.2], size_m: [1.0, 1.0], yaw_deg: 0.0}\n'
        '- {id: "2", center_ned_m: [21.0, -1.0], size_m: [1.0, 1.0], yaw_deg: 0.0}\n'
    )
    fly(paper_flight(field=moved), tmp_path)
    events = list(messages(tmp_path / "flight.mcap", "/events"))
    assert [e["data"]["to"] for e in events if e["name"] == "phase"][-2:] == ["hold", "standby"]
    (violation,) = [e["data"] for e in events if e["name"] == "violation"]
    assert violation["assumption"] == "roi_intersection"
    *_, last = messages(tmp_path / "truth.mcap", "/truth")
    assert last["collisions"] == 0


def test_daemon_that_dies_in_cruise_is_stopped_by_the_autopilot() -> None:
    simulation = Simulation(paper_flight())
    while simulation.autonomy.navigator.phase is not Phase.CRUISE or simulation.now_s < 10.0:
        simulation.advance()
    scene, died_s = simulation.scene, simulation.now_s
    scene.advance(died_s + 6.0)
    assert scene.vehicle.truth.ground_speed_mps < 0.05
    assert scene.vehicle.truth.position_ned_m[2] == pytest.approx(-4.0, abs=0.3)
    assert scene.world.collisions == 0
