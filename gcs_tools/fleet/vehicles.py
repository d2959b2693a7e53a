"""Simulated vehicles of a fleet: each as its contract says, flown by the service."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Final, Protocol

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight import command as preflight
from gcs_tools.preflight.offline.fleet_files import Member
from gcs_tools.scenario import Expectation, Plant, Scenario
from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.obstacle_field import ObstacleField
from sitl.autopilot.flavours.tuned import TUNED
from sitl.config import HomeConfig, MultirotorConfig, SitlConfig
from sitl.environment.sensor import SensorConfig
from sitl.virtual.faults.schema import Fault
from sitl.virtual.simulation import SimulatedFlight

# A daemon that has died is away for so long; then the operator hands the vehicle over again.
_AWAY_S: Final = (1.0, 10.0)
_HANDED_OVER_AFTER_S: Final = 1.0
NO_OBSTACLES: Final = ObstacleField.of(())


class Join(Protocol):
    """Makes a daemon that starts a member of its fleet."""

    def __call__(self, service: Autonomy, member: Member, boot: str) -> None:
        """Join; ``boot`` is of this run."""


def alone(service: Autonomy, member: Member, boot: str) -> None:
    """Leave a daemon by itself."""


def require_preflight(members: Sequence[Member]) -> None:
    """Refuse a vehicle that its pre-flight check refuses.

    Raises:
        CommandError: names the vehicle and says why.
    """
    for member in members:
        checked = preflight.check(member.assessment.contract, None, member.mission)
        if not checked.may_fly:
            why = "; ".join(checked.refusals)
            raise CommandError(f"{member.name}: the pre-flight check refuses: {why}")


def flight_of(
    member: Member, number: int, *, seed: int, faults: tuple[Fault, ...], time_limit_s: float
) -> SimulatedFlight:
    """Return the flight of a vehicle, among no obstacles but the other vehicles.

    Args:
        member: the vehicle.
        number: of the vehicle in its fleet, from 0.
        seed: of its simulation.
        faults: injected.
        time_limit_s: its time limit.
    """
    contract, mission = member.assessment.contract, member.mission
    scenario = Scenario(
        name=member.name,
        contract=contract,
        mission=mission,
        obstacles=NO_OBSTACLES,
        plant=_plant(member),
        faults=faults,
        field_known=True,
        fly_outside_contract=False,
        expect=Expectation(),
    )
    sitl: SitlConfig = scenario.sitl_config(seed=seed, system_id=number + 1)
    return SimulatedFlight(
        contract=contract,
        mission=mission,
        sitl=sitl,
        obstacles=NO_OBSTACLES,
        seed=seed,
        faults=faults,
        time_limit_s=time_limit_s,
    )


def _plant(member: Member) -> Plant:
    vehicle, origin = member.vehicle, member.vehicle.origin
    north_m, east_m = member.mission.start_ned_m
    contract = member.assessment.contract
    return Plant.model_validate(
        {
            "flavour": vehicle.autopilot,
            "multirotor": MultirotorConfig(radius_m=contract.vehicle.radius_m).model_dump(),
            "parameters": dict(TUNED[vehicle.autopilot]),
            "start": {"position_ned_m": (north_m, east_m, 0.0)},
            "home": HomeConfig(
                latitude_deg=origin.latitude_deg, longitude_deg=origin.longitude_deg
            ).model_dump(),
            "sensors": [each.model_dump() for each in _sensors(contract)],
        }
    )


def _sensors(contract: Contract) -> list[SensorConfig]:
    """Return the sensors that a contract states; they see no vehicle behind another."""
    sensor = contract.sensor
    views = [("front", sensor.detection_range_m, sensor.field_of_view_deg)]
    if sensor.all_round_range_m > 0.0:
        views.append(("ring", sensor.all_round_range_m, 360.0))
    return [
        SensorConfig(
            source=source,
            range_m=range_m,
            field_of_view_deg=view_deg,
            uncertainty_m=sensor.position_error_m,
            message_version=2,
            movers_hidden=True,
        )
        for source, range_m, view_deg in views
    ]


def restarts(draw: random.Random, period_s: float, until_s: float) -> tuple[Fault, ...]:
    """Return when the daemon of a vehicle dies, and is back; then it is handed over again.

    Args:
        draw: all that is random.
        period_s: mean time from being back to dying.
        until_s: end of the flight.
    """
    faults: list[Fault] = []
    dies_s = draw.expovariate(1.0 / period_s)
    while dies_s < until_s:
        away_s = draw.uniform(*_AWAY_S)
        taken_s = away_s + _HANDED_OVER_AFTER_S
        faults += (
            Fault(kind="daemon_dead", start_s=dies_s, duration_s=away_s),
            Fault(kind="operator_takes_over", start_s=dies_s, duration_s=taken_s),
        )
        dies_s += taken_s + draw.expovariate(1.0 / period_s)
    return tuple(faults)


def beside(draw: random.Random, error_m: float) -> tuple[float, float]:
    """Return how far a vehicle is beside where it takes itself to be, north and east."""
    away_m, towards_rad = error_m * math.sqrt(draw.random()), draw.uniform(-math.pi, math.pi)
    return away_m * math.cos(towards_rad), away_m * math.sin(towards_rad)


def boot_of(draw: random.Random) -> str:
    """Return what identifies a run of a daemon."""
    return f"{draw.getrandbits(64):016x}"
