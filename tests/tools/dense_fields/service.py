"""Fly legs through the whole service in virtual time: detections, monitors, autopilot and all.

The same legs as `flight` flies at the level of references, with the contract, mission and sensor of
``config/scenarios/uniform_forest.yaml`` and an ArduPilot-like vehicle as it flies in the field.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import Result, result_of
from gcs_tools.scenario import Plant, Scenario, load_scenario
from onboard.files.mission_file import Leg, Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from sitl.config import EstimatorConfig
from sitl.environment.sensor import SensorConfig
from sitl.virtual.simulation import SimulatedFlight
from sitl.virtual.simulation import fly as simulate
from tests.tools.dense_fields.obstacles import Obstacles
from tests.tools.dense_fields.scenes import Scene

ROOT = Path(__file__).parents[3]
_SCENARIO = ROOT / "config" / "scenarios" / "uniform_forest.yaml"
# Of Copter, with the jerk that the contract's lag allows for.
_PARAMETERS = {"GUID_TIMEOUT": 0.5, "PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0}
# Successive legs head that much farther to the right, so that nothing is along an axis by chance.
_TURN_RAD = math.radians(37.0)
# A leg that is flown more slowly than this on average has not been flown.
_SLOWEST_MPS = 0.15


def fly_by_service(scene: Scene, number: int, *, first_turn: bool = True) -> Result:
    """Fly one leg through the whole system.

    Args:
        scene: the leg.
        number: of the leg; seed of the simulation, and where the leg heads.
        first_turn: whether the leg heads elsewhere than north.
    """
    scenario = scenario_of(scene, number * _TURN_RAD if first_turn else 0.0)
    planned = SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=number),
        obstacles=scenario.obstacles,
        seed=number,
        time_limit_s=60.0 + scene.length_m / _SLOWEST_MPS,
    )
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        report = simulate(planned, directory)
        logs = (read_log(directory / f"{log}.mcap") for log in ("flight", "truth"))
        return result_of(
            *logs,
            seed=number,
            aborted=report.aborted,
            plan_times_s=report.plan_times_s,
            progress="best_effort",
        )


def scenario_of(scene: Scene, heading_rad: float) -> Scenario:
    """Return the scenario that flies a leg towards a heading, from the origin."""
    like = load_scenario(_SCENARIO)
    end_ned_m = (scene.length_m * math.cos(heading_rad), scene.length_m * math.sin(heading_rad))
    leg = Leg(end_ned_m=end_ned_m, target_half_width_m=scene.half_width_m)
    sensor = like.contract.sensor
    plant = Plant(
        flavour="ardupilot",
        realism="field",
        # The contract's; a compass alone is worse, and its error would have to be declared.
        estimator=EstimatorConfig(heading_deg=like.contract.vehicle.heading_error_deg),
        parameters=_PARAMETERS,
        sensors=(
            SensorConfig(
                range_m=sensor.detection_range_m,
                field_of_view_deg=sensor.field_of_view_deg,
                uncertainty_m=sensor.position_error_m,
            ),
        ),
    )
    return Scenario(
        name=scene.name,
        contract=like.contract,
        mission=Mission(altitude_m=like.mission.altitude_m, heading="path", legs=(leg,)),
        obstacles=field_of(scene.obstacles, heading_rad),
        plant=plant,
        faults=(),
        field_known=False,
        fly_outside_contract=False,
        expect=like.expect,
    )


def field_of(obstacles: Obstacles, heading_rad: float) -> ObstacleField:
    """Return the field in local NED, leg along a heading; a stem is the box around its trunk."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    turned: FloatArray = obstacles.centre_m @ np.array(((c, s), (-s, c)))
    half_m = obstacles.half_m + obstacles.radius_m[:, None]
    names = tuple(f"obstacle {k}" for k in range(len(half_m)))
    return ObstacleField(names, turned, half_m, obstacles.turn_rad + heading_rad)
