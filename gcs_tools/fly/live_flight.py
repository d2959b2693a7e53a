"""One flight in real time: simulation and daemon as processes, an operator over MAVSDK.

The three communicate as on a real vehicle: MAVLink over UDP, detections and status over Zenoh.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import zenoh

from gcs_tools.console.errors import CommandError, Interrupted
from gcs_tools.console.interruption import Interruption, interruptible
from gcs_tools.console.processes import Children, free_ports
from gcs_tools.console.progress import Report
from gcs_tools.fly.live_check import check_before_flight
from gcs_tools.fly.live_configuration import VEHICLE_NAME, Endpoints, write_configuration
from gcs_tools.preflight.live.bus import BusCheck
from gcs_tools.scenario import Scenario
from gcs_tools.vehicle.connection import connected_vehicle
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from onboard.files.mission_file import Mission
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.guidance.phases import Phase
from onboard.zenoh_session import open_session
from sitl.virtual.standstill import PATIENCE_S, Standstill

# The first start compiles the plant, which takes the longest.
START_TIMEOUT_S = 60.0
READY_TIMEOUT_S = 20.0
DEPARTURE_TIMEOUT_S = 15.0
# Time for turns and waits, and the least average speed of a mission that makes progress.
MISSION_TIMEOUT_S = 60.0
PROGRESS_MIN_MPS = 1.0

# Phases in which the daemon has ended its mission.
_OVER = frozenset({Phase.ARRIVED, Phase.HOLD})

# How often the position is reported.
REPORT_PERIOD_S = 0.2


def fly_live(
    scenario: Scenario,
    *,
    seed: int,
    out: Path,
    fly_outside_contract: bool,
    report: Report,
    mavlink_key: bytes | None = None,
) -> str | None:
    """Fly; return why the operator aborted the flight, None if the mission ended by itself.

    With a key, daemon and operator sign by it, and so does the vehicle unless the scenario gives it
    another one.  Leaves ``flight.mcap``, ``truth.mcap``, the configuration and the output of both
    processes in ``out``.  Every process that it started has ended when it returns or raises.

    Raises:
        CommandError: the flight could not begin.
        Interrupted: Ctrl-C or SIGTERM.
    """
    endpoints = Endpoints(*free_ports(4))
    write_configuration(
        scenario,
        endpoints,
        seed=seed,
        out=out,
        fly_outside_contract=fly_outside_contract,
        mavlink_key=mavlink_key,
    )
    with interruptible() as interruption, Children() as children:
        report("starting the simulation and the daemon")
        sitl, onboard = out / "sitl.yaml", out / "onboard.yaml"
        children.start("clearway-sitl", "sitl", "--config", str(sitl), log_path=out / "sitl.log")
        children.start(
            "clearway-onboard", "onboard", "--config", str(onboard), log_path=out / "onboard.log"
        )
        flight = _Flight(scenario, endpoints, children, fly_outside_contract, report, mavlink_key)
        return asyncio.run(_operate(flight, interruption))


@dataclass(frozen=True)
class _Flight:
    """The parts of one flight."""

    scenario: Scenario
    endpoints: Endpoints
    children: Children
    fly_outside_contract: bool
    report: Report
    mavlink_key: bytes | None


class Status:
    """The newest status of the daemon on Zenoh."""

    def __init__(self) -> None:
        self.last: dict[str, Any] = {}

    def receive(self, sample: zenoh.Sample) -> None:
        """Keep a status; Zenoh calls from a thread of its own, and one assignment is atomic."""
        self.last = json.loads(sample.payload.to_bytes())

    @property
    def phase(self) -> str:
        """The daemon's phase; empty before its first status."""
        return str(self.last.get("phase", ""))

    @property
    def airborne(self) -> bool:
        """Whether the daemon knows that the vehicle flies, and so streams setpoints."""
        return self.last.get("airborne") is True

    @property
    def sees(self) -> bool:
        """Whether the daemon gets detections."""
        return self.last.get("detection_age_s") is not None


async def _operate(flight: _Flight, interruption: Interruption) -> str | None:
    endpoints, children = flight.endpoints, flight.children
    bus = ZenohEndpoints(connect=(endpoints.daemon_zenoh, endpoints.sitl_zenoh), listen=())
    try:
        async with connected_vehicle(
            endpoints.operator_url,
            interruption,
            START_TIMEOUT_S,
            children.check,
            mavlink_key=flight.mavlink_key,
        ) as vehicle:
            with open_session(bus) as session:
                status = Status()
                session.declare_subscriber(f"clearway/{VEHICLE_NAME}/status", status.receive)
                operator = Operator(
                    vehicle, status, children, flight.scenario.mission, flight.report
                )
                await operator.wait_ready()
                if not flight.fly_outside_contract:
                    await _check(flight, vehicle, BusCheck(session, VEHICLE_NAME))
                return await operator.fly()
    except zenoh.ZError as error:
        raise CommandError(f"no Zenoh session with {endpoints.daemon_zenoh}: {error}") from error
    except VehicleError:
        children.check()  # an ended process explains the silence better
        raise


async def _check(flight: _Flight, vehicle: Vehicle, bus: BusCheck) -> None:
    """Run the live pre-flight check, without which the daemon does not fly.

    Raises:
        CommandError: the check has not passed.
    """
    flight.report("checking vehicle, detections and daemon")
    # `clearway fly` has checked the contract on paper before.
    findings = await check_before_flight(vehicle, bus, flight.scenario, paper_compliant=True)
    failed = [f"{each.subject} {each.name}: {each.text}" for each in findings if not each.holds]
    if failed:
        raise CommandError(f"the live pre-flight check has not passed: {'; '.join(failed)}")


class Operator:
    """Flies one mission from the ground and back to it.

    Args:
        vehicle: receives the commands.
        status: of the daemon.
        children: processes that must stay alive.
        mission: that the daemon flies.
        report: called with lines on the progress.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        status: Status,
        children: Children,
        mission: Mission,
        report: Report,
    ) -> None:
        self._vehicle = vehicle
        self._status = status
        self._children = children
        self._mission = mission
        self._report = report

    async def wait_ready(self) -> None:
        """Wait until the vehicle may be armed and the daemon receives detections."""
        self._report("waiting for the vehicle to be healthy")
        await self._vehicle.wait_healthy()
        await self._until(lambda: self._status.sees, READY_TIMEOUT_S, "given detections")

    async def fly(self) -> str | None:
        """Take off, hand over, watch, land; return why the mission was aborted, None if not."""
        vehicle, report = self._vehicle, self._report
        report("arming")
        await vehicle.arm()
        mishap = None
        async with self._reporting():
            try:
                await self._fly_mission()
            except Interrupted:
                raise
            except CommandError as error:
                mishap = str(error)
            if vehicle.state.in_air:
                await self._come_down()
        return mishap

    async def _fly_mission(self) -> None:
        vehicle, report = self._vehicle, self._report
        report("taking off")
        await vehicle.take_off(self._mission.altitude_m)
        report("handing over to the daemon")
        await self._until(lambda: self._status.airborne, READY_TIMEOUT_S, "airborne to the daemon")
        await vehicle.hand_over()
        await self._until(
            lambda: self._flying or self._over, DEPARTURE_TIMEOUT_S, "flown by the daemon"
        )
        await self._until(lambda: not self._flying, self._time_limit_s, "done with its mission")
        if not self._over:
            raise VehicleError(f"the daemon lost control to mode {vehicle.state.mode}")

    async def _come_down(self) -> None:
        """Land once the vehicle stands still: it may be close to an obstacle."""
        vehicle, standstill = self._vehicle, Standstill()
        loop = asyncio.get_running_loop()
        await vehicle.until(
            lambda: standstill.reached(loop.time(), vehicle.state.position_ned_m, stopping=True),
            2.0 * PATIENCE_S,
            lambda: "standing still",
        )
        self._report("landing")
        await vehicle.land()

    async def _until(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        def holds() -> bool:
            self._children.check()
            return condition()

        await self._vehicle.until(holds, timeout_s, lambda: what)

    @property
    def _flying(self) -> bool:
        return self._status.phase not in {"", Phase.STANDBY, *_OVER}

    @property
    def _over(self) -> bool:
        return self._status.phase in _OVER

    @property
    def _time_limit_s(self) -> float:
        points = [self._mission.start_ned_m, *(leg.end_ned_m for leg in self._mission.legs)]
        length_m = sum(math.dist(*leg) for leg in pairwise(points))
        return MISSION_TIMEOUT_S + length_m / PROGRESS_MIN_MPS

    @asynccontextmanager
    async def _reporting(self) -> AsyncIterator[None]:
        """Report the vehicle's position every `REPORT_PERIOD_S`."""
        task = asyncio.create_task(self._report_position())
        try:
            yield
        finally:
            task.cancel()  # it only sleeps

    async def _report_position(self) -> None:
        while True:
            state = self._vehicle.state
            if state.in_air:
                north_m, east_m, down_m = state.position_ned_m
                self._report(
                    f"{self._status.phase:<7} N {north_m:5.1f} E {east_m:5.1f} "
                    f"up {-down_m:4.1f} m, {state.speed_mps:3.1f} m/s",
                    state.position_ned_m,
                )
            await asyncio.sleep(REPORT_PERIOD_S)
