"""The live check of ``clearway fly``: the vehicle is armed only once it has passed."""

from __future__ import annotations

import asyncio
import math

from gcs_tools.preflight.finding import Finding
from gcs_tools.preflight.live.bus import BusCheck
from gcs_tools.preflight.live.check import check_vehicle
from gcs_tools.preflight.offline.sensors import rings_of
from gcs_tools.scenario import Plant, Scenario
from gcs_tools.vehicle.operator import Vehicle
from onboard.contract.assessment import assess
from onboard.files.sensor_sources import only_adds_movers
from sitl.plant.multirotor import hover_speed_rpm

# Half-way down the discharge curve of a lithium-polymer cell.
_CELL_V = 3.8
_RADPS_PER_RPM = 2.0 * math.pi / 60.0


async def check_before_flight(
    vehicle: Vehicle, bus: BusCheck, scenario: Scenario, *, paper_compliant: bool
) -> list[Finding]:
    """Check vehicle, detections and daemon at the same time; authorize the daemon if all hold.

    Args:
        vehicle: connected already.
        bus: of the daemon that is to fly.
        scenario: contract, mission, and the plant's battery.
        paper_compliant: whether the check on paper has passed.

    Raises:
        Interrupted: the operator gave up.
    """
    assessment = assess(scenario.contract)
    endurance_s = hover_endurance_s(scenario.plant)
    sensors = tuple(each.name for each in scenario.sources if not only_adds_movers(each))
    rings = rings_of(scenario.sources)
    listening = asyncio.create_task(asyncio.to_thread(bus.run, assessment, sensors, rings))
    try:
        found = await check_vehicle(vehicle, assessment, scenario.mission, endurance_s)
    finally:
        heard = await listening
    findings = found + heard
    given = await asyncio.to_thread(
        bus.authorize, scenario.contract, findings, compliant=paper_compliant
    )
    return [*findings, given]


def hover_endurance_s(plant: Plant) -> float:
    """Return how long the simulated vehicle hovers on a full battery."""
    parameters, battery = plant.multirotor.parameters(), plant.battery
    speed_rpm = hover_speed_rpm(parameters)
    torque_nm = parameters.torque_coefficient_nm_per_rpm2 * speed_rpm**2
    shaft_w = 4.0 * torque_nm * speed_rpm * _RADPS_PER_RPM
    power_w = shaft_w / battery.drive_efficiency + battery.avionics_w
    return battery.capacity_ah * 3600.0 * battery.cells * _CELL_V / power_w
