"""Flights by sensors that publish no boxes: the first part of each shipped scenario.

``clearway fly config/scenarios/sensors/....yaml --virtual`` flies all of one.
"""

import math
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from gcs_tools.scenario import load_scenario
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from sitl.virtual.simulation import SimulatedFlight, Simulation, deliver, without_cycle_collection

SENSORS = Path(__file__).parents[3] / "config" / "scenarios" / "sensors"


def simulation_of(name: str, leg_m: float, *, listening: bool = True, **sitl: Any) -> Simulation:
    """Return a flight of a shipped scenario along the begin of its leg, already in the air."""
    scenario = load_scenario(SENSORS / f"{name}.yaml")
    document = scenario.mission.model_dump(mode="json")
    document["legs"][0]["end_ned_m"] = [leg_m, 0.0]
    start = {"position_ned_m": (0.0, 0.0, -document["altitude_m"])}
    config = scenario.sitl_config(start=start, **sitl)
    flight = SimulatedFlight(
        scenario.contract,
        Mission.model_validate(document),
        config,
        scenario.obstacles,
        sources=scenario.sources if listening else (),
    )
    return Simulation(flight)


@without_cycle_collection()
def flown(simulation: Simulation, time_limit_s: float) -> Simulation:
    """Fly until the service is done; return the simulation."""
    while simulation.now_s < time_limit_s:
        simulation.advance()
        if simulation.autonomy.navigator.phase in (Phase.ARRIVED, Phase.HOLD):
            break
    return simulation


def violations(simulation: Simulation) -> list[str]:
    return [event.text for event in simulation.autonomy.events() if event.name == "violation"]


def test_a_hedge_of_50_m_by_lidar_does_not_stop_a_flight_beside_it() -> None:
    """Although the estimate turns what it sees by all that the contract declares, to and fro."""
    wrong = {"heading_deg": 2.0, "at_bound": True}
    simulation = flown(simulation_of("laserscan_hedge", 12.0, estimator=wrong), 40.0)
    assert simulation.autonomy.navigator.phase is Phase.ARRIVED
    assert abs(simulation.scene.vehicle.autopilot.estimator.error.yaw_rad) > math.radians(0.1)
    assert violations(simulation) == []
    assert len(simulation.autonomy.navigator.obstacles) > 3
    assert simulation.scene.world.collisions == 0


def test_the_autopilots_distances_lead_around_an_obstacle() -> None:
    simulation = flown(simulation_of("obstacle_distance_default_field", 32.0), 50.0)
    assert simulation.autonomy.navigator.phase is Phase.ARRIVED
    assert simulation.scene.world.collisions == 0
    assert abs(simulation.scene.vehicle.truth.position_ned_m[1]) < 8.0


def test_who_walks_up_from_behind_is_seen_by_the_autopilots_distances() -> None:
    behind = {
        "id": "walker", "class": "person", "speed_mps": 1.2,
        "path": {"kind": "pursuit", "start_ned_m": (-7.0, 0.0)},
    }  # fmt: skip
    simulation = simulation_of("obstacle_distance_ring", 9.0, movers=(behind,))
    yielded = False
    while simulation.now_s < 9.0 and not simulation.scene.movers.contacts_at_rest:
        simulation.advance()
        phase = simulation.autonomy.navigator.phase
        yielded |= phase is Phase.YIELD
        assert phase in (Phase.STANDBY, Phase.CRUISE, Phase.YIELD)
    assert yielded
    assert simulation.scene.movers.contacts_at_rest == 1
    assert simulation.scene.movers.contacts_moving == 0
    assert violations(simulation) == []


def test_a_depth_camera_leads_through_a_forest() -> None:
    simulation = flown(simulation_of("pointcloud2_forest", 6.0), 50.0)
    assert simulation.autonomy.navigator.phase is Phase.ARRIVED
    assert violations(simulation) == []
    assert simulation.scene.world.collisions == 0
    # No ground among them, which would be all round.
    assert len(simulation.autonomy.navigator.obstacles) < 40


def test_a_sensor_that_the_daemon_does_not_know_is_not_heard() -> None:
    simulation = flown(simulation_of("laserscan_hedge", 24.0, listening=False), 3.0)
    assert simulation.autonomy.navigator.phase is Phase.STANDBY
    assert simulation.autonomy.supervisor.detections.monitor.sensors == {}


@pytest.mark.parametrize("middleware", ["rmw_zenoh", "zenoh-bridge-ros2dds"])
def test_samples_reach_the_sensor_whose_key_they_match(middleware: str) -> None:
    scenario = load_scenario(SENSORS / "laserscan_hedge.yaml")
    (source,) = scenario.sources
    (sensor,) = scenario.plant.sensors
    ros2 = sensor.ros2.model_copy(update={"middleware": middleware})
    other = sensor.ros2.model_copy(update={"topic": "/scan_rear", "middleware": middleware})
    sensors = (
        sensor.model_copy(update={"ros2": ros2}),
        sensor.model_copy(update={"ros2": other, "source": "rear"}),
    )
    flight = SimulatedFlight(
        scenario.contract,
        scenario.mission,
        scenario.sitl_config().model_copy(update={"sensors": sensors}),
        scenario.obstacles,
        sources=(source.model_copy(update={"middleware": middleware}),),
    )
    simulation = Simulation(flight)
    simulation.scene.advance(0.2)
    sent = simulation.scene.take_detections()
    assert {message.source for message in sent} == {"lidar", "rear"}
    for message in sent:
        deliver(message, simulation.autonomy, 0.2)
    channels = simulation.autonomy.sensors
    assert len(channels._pending["lidar"]) == len([m for m in sent if m.source == "lidar"])
    assert channels.take_news() == []


def test_a_lidar_that_falls_silent_in_flight_is_named() -> None:
    simulation = simulation_of("laserscan_hedge", 24.0)
    while simulation.autonomy.navigator.phase is not Phase.CRUISE:
        simulation.advance()
    with patch.object(simulation.scene, "take_detections", list):
        flown(simulation, simulation.now_s + 0.4)
    (text,) = (e.text for e in simulation.autonomy.events() if e.name == "delayed")
    assert text.startswith("detection_age (lidar)")
    assert "source 'lidar' silent" in text
