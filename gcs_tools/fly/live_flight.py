"""One flight in real time: simulation and daemon as processes, an operator over MAVSDK.

The three talk as they would on a real vehicle: MAVLink over UDP, detections and status over Zenoh.
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
from pydantic import BaseModel

from gcs_tools.console.errors import CommandError, Interrupted
from gcs_tools.console.interruption import Interruption, interruptible
from gcs_tools.console.processes import Children, free_ports
from gcs_tools.console.progress import Report
from gcs_tools.fly.live_check import check_before_flight
from gcs_tools.preflight.live.bus import BusCheck
from gcs_tools.scenario import Scenario, obstacle_list
from gcs_tools.vehicle.connection import connected_vehicle
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from onboard.files.models import DaemonConfig, MavlinkLink, Mission
from onboard.files.yaml_file import dump_document
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.zenoh_session import open_session
from sitl.virtual.standstill import PATIENCE_S, Standstill

VEHICLE_NAME = "vehicle"
# Compiling the plant for the first time takes the longest.
START_TIMEOUT_S = 60.0
READY_TIMEOUT_S = 20.0
DEPARTURE_TIMEOUT_S = 15.0
# Turning and waiting; and slower than this on average is not flying the mission.
MISSION_TIMEOUT_S = 60.0
PROGRESS_MIN_MPS = 1.0

# The parameter of each flavour that says that there is no radio.
_WITHOUT_RADIO = {"px4": ("COM_RC_IN_MODE", 4.0), "ardupilot": ("FS_THR_ENABLE", 0.0)}

# How often it is said where the vehicle is.
REPORT_PERIOD_S = 0.2


@dataclass(frozen=True)
class Endpoints:
    """Where the three parts meet on this computer."""

    daemon_mavlink_port: int
    operator_mavlink_port: int
    sitl_zenoh_port: int
    daemon_zenoh_port: int

    @property
    def operator_url(self) -> str:
        """MAVSDK connection URL of the operator."""
        return f"udpin://127.0.0.1:{self.operator_mavlink_port}"

    @property
    def sitl_zenoh(self) -> str:
        """Zenoh endpoint on which the simulation listens."""
        return f"tcp/127.0.0.1:{self.sitl_zenoh_port}"

    @property
    def daemon_zenoh(self) -> str:
        """Zenoh endpoint on which the daemon listens."""
        return f"tcp/127.0.0.1:{self.daemon_zenoh_port}"


def fly_live(
    scenario: Scenario, *, seed: int, out: Path, forced: bool, report: Report
) -> str | None:
    """Fly; return why the operator gave the flight up, None if the mission came to its end.

    Leaves ``flight.mcap``, ``truth.mcap``, the configuration and the output of both processes in
    ``out``; has stopped everything that it started when it returns or raises.

    Raises:
        CommandError: the flight could not even begin.
        Interrupted: Ctrl-C or SIGTERM.
    """
    endpoints = Endpoints(*free_ports(4))
    write_configuration(scenario, endpoints, seed=seed, out=out, forced=forced)
    with interruptible() as interruption, Children() as children:
        report("starting the simulation and the daemon")
        sitl, onboard = out / "sitl.yaml", out / "onboard.yaml"
        children.start("clearway-sitl", "sitl", "--config", str(sitl), log_path=out / "sitl.log")
        children.start(
            "clearway-onboard", "onboard", "--config", str(onboard), log_path=out / "onboard.log"
        )
        flight = _Flight(scenario, endpoints, children, forced, report)
        return asyncio.run(_operate(flight, interruption))


@dataclass(frozen=True)
class _Flight:
    """What one flight is made of, for those who run it."""

    scenario: Scenario
    endpoints: Endpoints
    children: Children
    forced: bool
    report: Report


def write_configuration(
    scenario: Scenario, endpoints: Endpoints, *, seed: int, out: Path, forced: bool
) -> None:
    """Write what the two processes read; the directory is then complete in itself.

    Raises:
        CommandError: a file cannot be written.
    """
    onboard = DaemonConfig(
        vehicle=VEHICLE_NAME,
        contract=Path("contract.yaml"),
        mission=Path("mission.yaml"),
        mavlink=MavlinkLink(
            url=f"udpin://127.0.0.1:{endpoints.daemon_mavlink_port}",
            system_id=scenario.plant.system_id,
            telemetry_timeout_s=0.5,
        ),
        zenoh=ZenohEndpoints(connect=(endpoints.sitl_zenoh,), listen=(endpoints.daemon_zenoh,)),
        log_directory=Path(),
        log_file=Path("flight.mcap"),
        fly_outside_contract=forced,
        require_preflight=not forced,
    )
    sitl = scenario.sitl_config(
        vehicle=VEHICLE_NAME,
        mavlink=(
            f"udpout://127.0.0.1:{endpoints.daemon_mavlink_port}",
            f"udpout://127.0.0.1:{endpoints.operator_mavlink_port}",
        ),
        zenoh={"listen": (endpoints.sitl_zenoh,), "connect": ()},
        field="field.yaml",
        seed=seed,
        truth_log="truth.mcap",
    )
    # This flight has no radio, so its loss triggers none.
    sitl = sitl.model_copy(
        update={"parameters": dict([_WITHOUT_RADIO[sitl.flavour]]) | sitl.parameters}
    )
    documents: dict[str, Any] = {
        name: _plain(model)
        for name, model in {
            "contract": scenario.contract,
            "mission": scenario.mission,
            "onboard": onboard,
            "sitl": sitl,
        }.items()
    }
    documents["field"] = [_plain(obstacle) for obstacle in obstacle_list(scenario.obstacles)]
    try:
        for name, document in documents.items():
            text = dump_document(document)
            (out / f"{name}.yaml").write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{out}: cannot be written: {error.strerror or error}") from error


def _plain(model: BaseModel) -> Any:
    return model.model_dump(mode="json")


class Status:
    """What the daemon last said on Zenoh."""

    def __init__(self) -> None:
        self.last: dict[str, Any] = {}

    def receive(self, sample: zenoh.Sample) -> None:
        """Keep a status; Zenoh calls from a thread of its own, and one assignment is atomic."""
        self.last = json.loads(sample.payload.to_bytes())

    @property
    def phase(self) -> str:
        """The daemon's phase; empty before it has said anything."""
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
            endpoints.operator_url, interruption, START_TIMEOUT_S, children.check
        ) as vehicle:
            with open_session(bus) as session:
                status = Status()
                session.declare_subscriber(f"clearway/{VEHICLE_NAME}/status", status.receive)
                operator = Operator(
                    vehicle, status, children, flight.scenario.mission, flight.report
                )
                await operator.wait_ready()
                if not flight.forced:
                    await _check(flight, vehicle, BusCheck(session, VEHICLE_NAME))
                return await operator.fly()
    except zenoh.ZError as error:
        raise CommandError(f"no Zenoh session with {endpoints.daemon_zenoh}: {error}") from error
    except VehicleError:
        children.check()  # a dead process explains more than the silence that it leaves
        raise


async def _check(flight: _Flight, vehicle: Vehicle, bus: BusCheck) -> None:
    """Look at everything live; the daemon flies only what has passed.

    Raises:
        CommandError: the check has not passed.
    """
    flight.report("checking vehicle, detections and daemon")
    # On paper the flight is compliant: it would not have come this far otherwise.
    findings = await check_before_flight(vehicle, bus, flight.scenario, paper_compliant=True)
    against = [f"{each.subject} {each.name}: {each.text}" for each in findings if not each.holds]
    if against:
        raise CommandError(f"the live pre-flight check has not passed: {'; '.join(against)}")


class Operator:
    """Flies one mission from the ground and back to it.

    Args:
        vehicle: where the commands go.
        status: what the daemon says.
        children: the processes that must stay alive.
        mission: where the daemon flies.
        report: takes lines on the progress.
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
        """Wait until the vehicle may be armed and the daemon sees."""
        self._report("waiting for the vehicle to be healthy")
        await self._vehicle.wait_healthy()
        await self._until(lambda: self._status.sees, READY_TIMEOUT_S, "given detections")

    async def fly(self) -> str | None:
        """Take off, hand over, watch, land; return why the mission was given up, if it was."""
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
            raise VehicleError(f"the daemon lost control to mode {vehicle.state.mode.name}")

    async def _come_down(self) -> None:
        """Land, but not while the vehicle still moves: it may be close to an obstacle."""
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
        return self._status.phase in {"cruise", "avoid"}

    @property
    def _over(self) -> bool:
        return self._status.phase in {"arrived", "hold"}

    @property
    def _time_limit_s(self) -> float:
        points = [self._mission.start_ned_m, *(leg.end_ned_m for leg in self._mission.legs)]
        length_m = sum(math.dist(*leg) for leg in pairwise(points))
        return MISSION_TIMEOUT_S + length_m / PROGRESS_MIN_MPS

    @asynccontextmanager
    async def _reporting(self) -> AsyncIterator[None]:
        """Say now and then where the vehicle is."""
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
