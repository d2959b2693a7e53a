"""Fly legs through the whole service in virtual time: detections, monitors, autopilot and all.

The same legs as `flight` flies at the level of references, with the contract, mission and sensor of
``config/scenarios/uniform_forest.yaml`` and an ArduPilot-like vehicle as it flies in the field.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gcs_tools.logs.flight_log import read_log
from gcs_tools.logs.result import Result, result_of
from gcs_tools.scenario import Plant, Scenario, load_scenario
from onboard.contract.assessment import assess
from onboard.files.mission_file import Leg, Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES, Phase
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
# As two antennas give it.  With the 2 degrees of a compass, faces at 12 m are off by 0.4 m more.
_HEADING_ERROR_DEG = 0.5
# Successive legs head that much farther to the right, so that nothing is along an axis by chance.
_TURN_RAD = math.radians(37.0)


class Served(NamedTuple):
    """One leg that the service flew.

    Attributes:
        result: as in ``result.json``.
        length_m: of the leg.
        first_look_s: from taking control until it set off, the turn on the spot included.
    """

    result: Result
    length_m: float
    first_look_s: float

    @property
    def arrived(self) -> bool:
        """Whether it came to the end of the leg without touching anything."""
        return self.result.outcome == "arrived" and not self.result.collisions

    @property
    def speed_mps(self) -> float:
        """Length of the leg over the time since it set off."""
        return self.length_m / max(self.result.duration_s - self.first_look_s, 1.0)

    def row(self) -> str:
        """Return what became of the leg."""
        result = self.result
        clearance_m = math.inf if result.clearance_min_m is None else result.clearance_min_m
        return (
            f"{result.outcome} ({result.reason}), {self.speed_mps:.2f} m/s after a first look of "
            f"{self.first_look_s:.1f} s, {result.pauses - 1} pauses, {result.collisions} "
            f"collisions, clearance {clearance_m:+.2f} m, "
            f"tracking error {result.tracking_error_max_m:.2f} m"
        )


def margin_m() -> float:
    """Return how far the service's contract keeps the reference from a reported face."""
    return assess(load_scenario(_SCENARIO).contract).inflation_m()


def fly_by_service(
    scene: Scene,
    number: int,
    *,
    turned: bool = True,
    wish_m: float = 0.0,
    time_max_s: float = 600.0,
) -> Served:
    """Fly one leg through the whole system.

    Args:
        scene: the leg.
        number: of the leg; seed of the simulation, and where the leg heads.
        turned: whether legs head elsewhere than north.
        wish_m: distance to obstacles that is preferred.
        time_max_s: the flight is given up after this.
    """
    scenario = scenario_of(scene, number * _TURN_RAD if turned else 0.0, wish_m)
    planned = SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=number),
        obstacles=scenario.obstacles,
        seed=number,
        time_limit_s=time_max_s,
    )
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        report = simulate(planned, directory)
        flight, truth = (read_log(directory / f"{log}.mcap") for log in ("flight", "truth"))
    result = result_of(flight, truth, seed=number, aborted=report.aborted, progress="best_effort")
    flown = [state for state in flight.states if state.phase in FLYING_PHASES]
    moving = (state.time_s - flown[0].time_s for state in flown if state.phase == Phase.THREAD)
    return Served(result, scene.length_m, next(moving, 0.0))


def sum_of(flown: list[tuple[bool, Served]]) -> str:
    """Return the summary of legs, each with whether it is passable."""
    passable = [served for is_open, served in flown if is_open]
    arrived = [served for _, served in flown if served.arrived]
    overall_mps = [served.length_m / served.result.duration_s for served in arrived]
    return (
        f"{len(flown)} legs, {len(passable)} passable, "
        f"{sum(served.arrived for served in passable)} of these arrived, "
        f"{sum(served.result.collisions for _, served in flown)} collisions, "
        f"mean {np.mean(overall_mps) if arrived else 0.0:.2f} m/s "
        f"({np.mean([served.speed_mps for served in arrived]) if arrived else 0.0:.2f} without the "
        f"first look)"
    )


def scenario_of(scene: Scene, heading_rad: float, wish_m: float = 0.0) -> Scenario:
    """Return the scenario that flies a leg towards a heading, from the origin."""
    like = load_scenario(_SCENARIO)
    end_ned_m = (scene.length_m * math.cos(heading_rad), scene.length_m * math.sin(heading_rad))
    leg = Leg(end_ned_m=end_ned_m, target_half_width_m=scene.half_width_m)
    changes = {"clearance_wish_m": wish_m, "heading_error_deg": _HEADING_ERROR_DEG}
    vehicle = like.contract.vehicle.model_copy(update=changes)
    contract = like.contract.model_copy(update={"vehicle": vehicle})
    sensor = contract.sensor
    plant = Plant(
        flavour="ardupilot",
        realism="field",
        # The contract's; a compass alone is worse, and its error would have to be declared.
        estimator=EstimatorConfig(heading_deg=vehicle.heading_error_deg),
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
        contract=contract,
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
