"""Flights through the whole service in virtual time: detections, monitors, autopilot and all.

The same legs as `planner_flight` flies at the level of references, with contracts of the
configuration and a vehicle that flies as it does in the field.
"""

from __future__ import annotations

import math
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.scenes import Aloft, Moving, Scene
from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import Log, read_log
from gcs_tools.logs.result import Result, result_of
from gcs_tools.scenario import Expectation, Plant, Scenario
from onboard.contract.assessment import assess
from onboard.contract.heights import half_band_m
from onboard.files.contract_file import Contract, SensorTerms
from onboard.files.mission_file import Leg, Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.files.yaml_file import read_mapping, validate
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import FLYING_PHASES, Phase
from sitl.autopilot.flavours.tuned import TUNED
from sitl.config import EstimatorConfig, MultirotorConfig
from sitl.environment.sensor import SensorConfig
from sitl.virtual.simulation import SimulatedFlight
from sitl.virtual.simulation import fly as simulate

_ALTITUDE_M: Final = 4.0
# Of the vehicle that flies among what moves, or what has a height, in place of the ardupilot's own.
_MOVING_FILE: Final = "moving_boxes_contract.yaml"
_ALOFT_FILE: Final = "spheres_contract.yaml"
_VIEW_DEG: Final = 120.0
# Successive legs head that much farther to the right, so that nothing is along an axis by chance.
_TURN_RAD: Final = math.radians(37.0)


class _Set(NamedTuple):
    """A vehicle: file of its contract, or of a scenario that has it, and how it is set up.

    Where a heading error is stated, declared and simulated, it takes the place of the contract's.
    """

    file: str
    flavour: Literal["px4", "ardupilot"]
    parameters: dict[str, float]
    heading_error_deg: float | None = None


SERVICE_VEHICLES: Final = {
    # Of Copter, with the jerk that the contract's lag allows for, and a heading as two antennas
    # give it: with the 2 degrees of a compass, faces at 12 m are off by 0.4 m more.
    "ardupilot": _Set(
        "uniform_forest.yaml",
        "ardupilot",
        {"GUID_TIMEOUT": 0.5, **TUNED["ardupilot"]},
        heading_error_deg=0.5,
    ),
    "px4": _Set("px4_contract.yaml", "px4", dict(TUNED["px4"])),
}


class Served(NamedTuple):
    """One leg that the service flew.

    Attributes:
        result: as in ``result.json``.
        length_m: of the leg.
        first_look_s: from taking control until it set off, the turn on the spot included.
        waited_s: in YIELD, for movers.
        wait_reason: why it waits where the flight ends waiting; else empty.
        beside_max_m: how far from the line of the leg its centre truly was.
        behind_max_m: and how far behind the start.
    """

    result: Result
    length_m: float
    first_look_s: float
    waited_s: float = 0.0
    wait_reason: str = ""
    beside_max_m: float = 0.0
    behind_max_m: float = 0.0

    @property
    def arrived(self) -> bool:
        """Whether it came to the end of the leg without touching anything."""
        return self.result.outcome == "arrived" and not self.result.collisions

    @property
    def speed_mps(self) -> float:
        """Length of the leg over the time since it set off."""
        return self.length_m / max(self.result.duration_s - self.first_look_s, 1.0)


def service_contract(vehicle: str, wish_m: float = 0.0) -> Contract:
    """Return the contract of a vehicle of `SERVICE_VEHICLES`, for fields that no separation covers.

    Raises:
        FileError: its file cannot be used.
    """
    path = Path(__file__).parent / "scenarios" / SERVICE_VEHICLES[vehicle].file
    document = read_mapping(path)
    contract = validate(document.get("contract", document), Contract, source=str(path))
    heading_deg = SERVICE_VEHICLES[vehicle].heading_error_deg
    heading = {} if heading_deg is None else {"heading_error_deg": heading_deg}
    parts: dict[str, dict[str, Any]] = {
        "vehicle": {"clearance_wish_m": wish_m, **heading},
        "sensor": {"field_of_view_deg": _VIEW_DEG},
        "requirements": {"progress": "best_effort"},
        "environment": {"obstacle_separation_min_m": 1.0},
    }
    changed = {
        name: getattr(contract, name).model_copy(update=update) for name, update in parts.items()
    }
    return contract.model_copy(update=changed)


def moving_contract(moving: Moving, wish_m: float = 0.0) -> Contract:
    """Return the contract of the vehicle that flies among what moves in a scene.

    Raises:
        FileError: its file cannot be used.
    """
    path = Path(__file__).parent / "scenarios" / _MOVING_FILE
    contract = validate(read_mapping(path), Contract, source=str(path))
    heading_deg = SERVICE_VEHICLES["ardupilot"].heading_error_deg
    vehicle = {"clearance_wish_m": wish_m, "heading_error_deg": heading_deg}
    bounds = {"speed_max_mps": moving.speed_max_mps, "size_max_m": moving.size_max_m}
    classes = tuple(each.model_copy(update=bounds) for each in contract.environment.movers)
    return contract.model_copy(
        update={
            "vehicle": contract.vehicle.model_copy(update=vehicle),
            "environment": contract.environment.model_copy(update={"movers": classes}),
        }
    )


def aloft_contract(scene: Scene, wish_m: float = 0.0) -> Contract:
    """Return the contract of the vehicle that flies where obstacles have heights.

    Raises:
        FileError: its file cannot be used.
    """
    path = Path(__file__).parent / "scenarios" / _ALOFT_FILE
    contract = validate(read_mapping(path), Contract, source=str(path))
    half_m = scene.obstacles.half_m + scene.obstacles.radius_m[:, None]
    # A box that is turned is larger along the axes.
    size_m = 2.0 * math.sqrt(2.0) * float(half_m.max(initial=0.5))
    environment = {"obstacle_size_max_m": size_m}
    vehicle = {"clearance_wish_m": wish_m}
    return contract.model_copy(
        update={
            "vehicle": contract.vehicle.model_copy(update=vehicle),
            "environment": contract.environment.model_copy(update=environment),
        }
    )


def contract_of(scene: Scene, vehicle: str, wish_m: float = 0.0) -> Contract:
    """Return the contract under which a vehicle flies a scene.

    Raises:
        FileError: its file cannot be used.
        CommandError: the vehicle flies neither among what moves nor where obstacles have heights.
    """
    if scene.moving is None and scene.aloft is None:
        return service_contract(vehicle, wish_m)
    if vehicle != "ardupilot":
        what = "obstacles with heights" if scene.moving is None else "what moves"
        raise CommandError(
            f"--vehicle {vehicle}: {scene.field} has {what}, among which only ardupilot flies"
        )
    if scene.moving is None:
        return aloft_contract(scene, wish_m)
    return moving_contract(scene.moving, wish_m)


def service_margin_m(scene: Scene, vehicle: str) -> float:
    """Return how far the contract of a scene keeps the reference from a reported face."""
    return assess(contract_of(scene, vehicle)).inflation_m()


def service_reach_m(scene: Scene, vehicle: str) -> float:
    """Return how far above and below the flight a reported obstacle may be in its way."""
    terms = assess(contract_of(scene, vehicle)).terms
    return half_band_m(terms) + 2.0 * (terms.position_error_z_m or 0.0)


def fly_by_service(
    scene: Scene,
    number: int,
    *,
    vehicle: str = "ardupilot",
    seed: int | None = None,
    wish_m: float = 0.0,
    time_max_s: float = 600.0,
) -> Served:
    """Fly one leg through the whole system.

    Args:
        scene: the leg.
        number: of the leg, which decides where it heads.
        vehicle: of `SERVICE_VEHICLES`.
        seed: of the simulation; None takes the number.
        wish_m: distance to obstacles that is preferred.
        time_max_s: the flight is given up after this.
    """
    seed = number if seed is None else seed
    scenario = scenario_of(scene, number * _TURN_RAD, vehicle, wish_m)
    planned = SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=seed),
        obstacles=scenario.obstacles,
        seed=seed,
        time_limit_s=time_max_s,
    )
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        report = simulate(planned, directory)
        flight, truth = (read_log(directory / f"{log}.mcap") for log in ("flight", "truth"))
    result = result_of(flight, truth, seed=seed, aborted=report.aborted, progress="best_effort")
    flown = [state for state in flight.states if state.phase in FLYING_PHASES]
    moving = (state.time_s - flown[0].time_s for state in flown if state.phase == Phase.THREAD)
    strayed_m = strayed(truth, scenario.mission.legs[0].end_ned_m)
    return Served(result, scene.length_m, next(moving, 0.0), *waits_of(flight), *strayed_m)


def strayed(truth: Log, end_ned_m: tuple[float, float]) -> tuple[float, float]:
    """Return how far a vehicle was from the line of its leg, and behind the start, at most.

    Args:
        truth: where it was.
        end_ned_m: of the leg, which begins at the origin.
    """
    places_ned_m = np.array([record.position_ned_m[:2] for record in truth.truths]).reshape(-1, 2)
    c, s = np.array(end_ned_m) / math.hypot(*end_ned_m)
    along_m, across_m = places_ned_m @ np.array((c, s)), places_ned_m @ np.array((-s, c))
    return float(np.abs(across_m).max(initial=0.0)), float((-along_m).max(initial=0.0))


def waits_of(flight: Log) -> tuple[float, str]:
    """Return how long a flight waited for movers, and why it waits where it ends; else empty."""
    states = flight.states
    waited_s = sum(
        later.time_s - state.time_s
        for state, later in pairwise(states)
        if state.phase == Phase.YIELD
    )
    flown = [state for state in states if state.phase in FLYING_PHASES]
    if not flown or flown[-1].phase != Phase.YIELD:
        return waited_s, ""
    waits = [event for event in flight.events if event.data.get("to") == Phase.YIELD]
    return waited_s, waits[-1].text if waits else ""


def scenario_of(scene: Scene, heading_rad: float, vehicle: str, wish_m: float = 0.0) -> Scenario:
    """Return the scenario that flies a leg towards a heading, from the origin.

    What moves is square along north and east, so that a scene with movers heads north.
    """
    contract, chosen = contract_of(scene, vehicle, wish_m), SERVICE_VEHICLES[vehicle]
    movers = () if scene.moving is None else scene.moving.movers
    heading_rad = 0.0 if movers else heading_rad
    end_ned_m = (scene.length_m * math.cos(heading_rad), scene.length_m * math.sin(heading_rad))
    leg = Leg(end_ned_m=end_ned_m, target_half_width_m=scene.half_width_m)
    plant = Plant(
        flavour=chosen.flavour,
        realism="field",
        multirotor=MultirotorConfig(radius_m=contract.vehicle.radius_m),
        estimator=EstimatorConfig(heading_deg=chosen.heading_error_deg),
        parameters=chosen.parameters,
        sensors=(_sensor_of(scene, contract.sensor),),
        movers=movers,
    )
    aloft = scene.aloft
    mission = Mission(
        altitude_m=_ALTITUDE_M if aloft is None else aloft.altitude_m,
        start_clear_m=None if aloft is None else aloft.start_clear_m,
        heading="path",
        legs=(leg,),
    )
    return Scenario(
        name=scene.name,
        contract=contract,
        mission=mission,
        obstacles=field_of(scene.obstacles, heading_rad, scene.aloft),
        plant=plant,
        faults=(),
        field_known=False,
        fly_outside_contract=False,
        expect=Expectation(),
    )


def _sensor_of(scene: Scene, sensor: SensorTerms) -> SensorConfig:
    """Return the sensor that a contract declares; its heights err by what that allows."""
    moves = scene.moving is not None and bool(scene.moving.movers)
    seen = SensorConfig(
        range_m=sensor.detection_range_m,
        field_of_view_deg=sensor.field_of_view_deg,
        uncertainty_m=sensor.position_error_m,
        message_version=2 if moves else 1,
    )
    if scene.aloft is None:
        return seen
    error_z_m = sensor.position_error_z_m or 0.0
    heights = {
        "frame": "body_frd",
        "vertical_field_of_view_deg": sensor.vertical_field_of_view_deg,
        "height_noise_m": error_z_m,
        "height_uncertainty_m": error_z_m,
    }
    return seen.model_copy(update=heights)


def field_of(obstacles: Obstacles, heading_rad: float, aloft: Aloft | None = None) -> ObstacleField:
    """Return the field in local NED, leg along a heading; a stem is the box around its trunk."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    turned: FloatArray = obstacles.centre_m @ np.array(((c, s), (-s, c)))
    half_m = obstacles.half_m + obstacles.radius_m[:, None]
    names = tuple(f"obstacle {k}" for k in range(len(half_m)))
    down_m = None if aloft is None else aloft.down_m
    return ObstacleField(names, turned, half_m, obstacles.turn_rad + heading_rad, down_m)
