"""The whole system in virtual time: one seed, one log.

Onboard service, vehicle, sensor and operator exchange the same bytes as over UDP and Zenoh, only
without sockets; simulation shortcuts: bytes and frames arrive in the step in which they were sent,
unless a link or the sensor's latency delays them; the autopilot decides and reports as often as the
service, every 20 ms, not every 10 ms as it does live, and the wind is constant in between.  Its
telemetry takes 10 ms, so that a pose is 20 ms old when it is used.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract, InputSet
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.files.sensor_sources import AnySource
from onboard.guidance.phases import Phase
from onboard.mavlink.signing import LinkSigning, timestamp_at
from onboard.perception.sources.registry import zenoh_key
from onboard.planning.planner import Planner
from onboard.planning.qp.search import QpPlanner
from onboard.recording.flight_log import FlightLog
from onboard.recording.journal import Journal
from onboard.recording.messages import Record
from sitl.autopilot.protocol.signing import signing_key
from sitl.config import SitlConfig
from sitl.environment.sensor_message import ZenohMessage
from sitl.environment.truth_log import TruthLog
from sitl.vehicle.scene import Scene
from sitl.vehicle.vehicle import TICK_RATE_HZ, warm_up
from sitl.virtual.faults.detections import DetectionFaults
from sitl.virtual.faults.mavlink import MavlinkFaults
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault
from sitl.virtual.faults.service import ServiceFaults
from sitl.virtual.faults.vehicle import VehicleFaults
from sitl.virtual.scripted_operator import Operator, Step
from sitl.virtual.standstill import Standstill

STEPS_PER_OPERATOR: Final = 5
TELEMETRY_DELAY_S: Final = 0.01
# Where virtual time begins; any instant will do, as long as it is always the same.
EPOCH_UNIX_S: Final = 1_790_000_000.0
ONBOARD_LINK, OPERATOR_LINK = 0, 1
# How long the operator waits before landing a vehicle that its service does not fly: it has died,
# it refuses to depart, or the autopilot does not obey it.
PATIENCE_S: Final = 8.0
# And one that pauses for longer than any look round: its sensor stays silent, for instance.
PAUSE_PATIENCE_S: Final = 180.0


@dataclass(frozen=True)
class SimulatedFlight:
    """One flight to simulate.

    Attributes:
        contract, mission: for the onboard service.
        sitl: vehicle, autopilot, sensors, wind.
        obstacles: the field.
        seed: of everything random.
        faults: see `sitl.virtual.faults.schema`.
        sources: sensors that the service relies on, besides those that publish JSON.
        input_set: which accelerations plans may use.
        fly_outside_contract: fly although the contract's clauses are not met.
        mavlink_key: of the service's link; None: that of `sitl`, if any.
        time_limit_s: the simulation ends after this, landed or not.
    """

    contract: Contract
    mission: Mission
    sitl: SitlConfig
    obstacles: ObstacleField
    seed: int = 1
    faults: tuple[Fault, ...] = ()
    sources: tuple[AnySource, ...] = ()
    input_set: InputSet = "inner"
    fly_outside_contract: bool = False
    mavlink_key: bytes | None = None
    time_limit_s: float = 600.0


@dataclass(frozen=True)
class SimulationReport:
    """What the logs leave out because it differs from run to run.

    Attributes:
        virtual_s, wall_s: simulated time and the time it took.
        plan_times_s: wall time of each plan.
        aborted: why the operator did not complete the flight; None if it landed.
    """

    virtual_s: float
    wall_s: float
    plan_times_s: list[float] = field(default_factory=list)
    aborted: str | None = None


class Simulation:
    """One flight, advanced step by step.

    Args:
        flight: to simulate.
        equip: called with each service before its first tick; a restart makes one more.

    Attributes:
        now_s: virtual time.
        flight: as given.
        scene, autonomy, operator: vehicle and world; the service; who arms and lands.
    """

    def __init__(
        self,
        flight: SimulatedFlight,
        equip: Callable[[Autonomy], None] = lambda _: None,
    ) -> None:
        config = flight.sitl.model_copy(update={"seed": flight.seed})
        self.now_s = 0.0
        self.scene = Scene(config, flight.obstacles, EPOCH_UNIX_S, round(TICK_S * TICK_RATE_HZ))
        schedule = self._schedule = FaultSchedule(flight.faults, flight.seed)
        self._detection_faults = DetectionFaults(schedule)
        self._mavlink_faults = MavlinkFaults(schedule)
        self._vehicle_faults = VehicleFaults(
            schedule, self.scene.vehicle, config.system_id, config.flavour, OPERATOR_LINK
        )
        self._service_faults = ServiceFaults(schedule, flight.mission)
        self._equip = equip
        self.flight = flight
        self.autonomy = self._started_service()
        self.operator = Operator(
            config.system_id, flight.mission.altitude_m, _signing(_vehicle_key(flight))
        )
        self._steps = 0
        self._dead = False
        self._idle_since_s = self._paused_since_s = math.inf
        self._standstill = Standstill()

    @property
    def over(self) -> bool:
        """Whether the vehicle is back on the ground."""
        return self.operator.step is Step.DONE

    @property
    def service_runs(self) -> bool:
        """Whether the service's process runs."""
        return not self._dead

    @property
    def aborted(self) -> str | None:
        """Why the operator did not complete the flight; None if it landed."""
        if self.over:
            return self.operator.gave_up
        return "the vehicle did not land within the time limit"

    def advance(self) -> None:
        """Advance by one tick of the service, 20 ms."""
        self._steps += 1
        self.now_s = self._steps * TICK_S
        self._schedule.advance(self.now_s, self.autonomy.navigator.phase)
        self._vehicle_faults.apply()
        self._service_faults.apply()
        self.scene.advance(self.now_s)
        self._restart_daemon_if_killed()
        self._serve()
        self.scene.vehicle.receive(self._mavlink_faults.second_commander(), OPERATOR_LINK)
        if self._steps % STEPS_PER_OPERATOR == 0:
            self._operate()

    def _serve(self) -> None:
        """Let the onboard service receive, decide and send, unless it is dead."""
        vehicle, autonomy = self.scene.vehicle, self.autonomy
        here_ned_m = vehicle.truth.position_ned_m
        frames = self._detection_faults.arriving(self.scene.take_detections(), here_ned_m)
        telemetry = self._mavlink_faults.telemetry(vehicle.bytes_to_send(ONBOARD_LINK))
        if self._dead:
            return
        for frame in frames:
            deliver(frame, autonomy, self.now_s)
        if telemetry:
            autonomy.receive_mavlink(telemetry, self.now_s - TICK_S + TELEMETRY_DELAY_S)
        if not self._service_faults.stalled:
            self._service_faults.before_tick(autonomy, here_ned_m, self.now_s)
            autonomy.tick(self.now_s)
            setpoints = self._mavlink_faults.setpoints(autonomy.mavlink_to_send())
            vehicle.receive(setpoints, ONBOARD_LINK)

    def _restart_daemon_if_killed(self) -> None:
        dead = self._service_faults.dead
        if self._dead and not dead:
            self.autonomy = self._started_service()
        self._dead = dead

    def _started_service(self) -> Autonomy:
        service = _start_service(self.flight, self._service_faults.solver)
        self._equip(service)
        return service

    def _operate(self) -> None:
        self.operator.receive(self.scene.vehicle.bytes_to_send(OPERATOR_LINK))
        phase = self.autonomy.navigator.phase
        ended = phase in (Phase.ARRIVED, Phase.HOLD) and not self._dead
        handed_over = self.operator.step in (Step.HAND_OVER, Step.WATCH)
        idle = handed_over and (self._dead or phase is Phase.STANDBY)
        estimate_ned_m = self.scene.vehicle.estimate.position_ned_m
        stands = self._standstill.reached(self.now_s, estimate_ned_m, stopping=ended)
        self._idle_since_s = _since(self._idle_since_s, self.now_s, present=idle)
        pausing = phase in (Phase.PAUSE, Phase.YIELD)
        self._paused_since_s = _since(self._paused_since_s, self.now_s, present=pausing)
        tired = (
            self.now_s > self._idle_since_s + PATIENCE_S
            or self.now_s > self._paused_since_s + PAUSE_PATIENCE_S
        )
        self._service_faults.command(self.operator)
        # The operator lands a vehicle without its service only once it has come to rest by itself.
        waits = phase is Phase.HOLD and self._service_faults.waits_to_resume
        if (stands and not waits) or tired:
            self.operator.land()
        self.operator.advance(self.now_s)
        self.scene.vehicle.receive(self.operator.bytes_to_send(), OPERATOR_LINK)


def deliver(message: ZenohMessage, autonomy: Autonomy, now_s: float) -> None:
    """Pass a sample on to whatever subscribes to its key, as Zenoh does."""
    if message.key is None:
        autonomy.receive_detection(message.payload, now_s)
        return
    for name, sensor in autonomy.sensors.sensors.items():
        wanted = zenoh_key(sensor.config)
        if wanted == message.key or (
            wanted is not None
            and wanted.endswith("/**")
            and message.key.startswith(wanted.removesuffix("**"))
        ):
            autonomy.sensors.receive(
                name, message.payload, now_s, key=message.key, attachment=message.attachment
            )


def _since(began_s: float, now_s: float, *, present: bool) -> float:
    """Return when a condition began; infinite while it is absent."""
    return min(began_s, now_s) if present else math.inf


def _start_service(flight: SimulatedFlight, solver: QpPlanner) -> Autonomy:
    return Autonomy(
        flight.contract,
        flight.mission,
        epoch_unix_s=EPOCH_UNIX_S,
        system_id=flight.sitl.system_id,
        input_set=flight.input_set,
        fly_outside_contract=flight.fly_outside_contract,
        stopwatch=time.perf_counter,
        planner=Planner(solver),
        sensors=flight.sources,
        signing=_signing(flight.mavlink_key or _vehicle_key(flight)),
    )


def _vehicle_key(flight: SimulatedFlight) -> bytes | None:
    """Return the key that the simulated vehicle signs with; None if it does not."""
    return signing_key(flight.sitl)


def _signing(key: bytes | None) -> LinkSigning | None:
    return None if key is None else LinkSigning(key, 0, timestamp_at(EPOCH_UNIX_S))


@contextmanager
def without_cycle_collection() -> Iterator[None]:
    """Leave cyclic garbage until after the flight: looking for it costs a tenth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class ServiceJournal:
    """Collects the records of a flight's service, also where it is restarted.

    Args:
        simulation: the flight.
        shown: whether a display shows the flight; see `Journal`.
    """

    def __init__(self, simulation: Simulation, *, shown: bool = True) -> None:
        self._simulation, self._shown = simulation, shown
        self._journal = Journal(simulation.autonomy, timed=False, shown=shown)

    def collect(self) -> list[Record]:
        """Return the records of the tick that has just been simulated."""
        service = self._simulation.autonomy
        if self._journal.autonomy is not service:
            self._journal = Journal(service, timed=False, shown=self._shown)
        return self._journal.collect(self._simulation.now_s)


def ticks(simulation: Simulation, *, shown: bool = True) -> Iterator[list[Record]]:
    """Advance a flight to its end, or its time limit; yield the records of each tick.

    Args:
        simulation: the flight.
        shown: whether a display shows the flight; see `Journal`.
    """
    journal = ServiceJournal(simulation, shown=shown)
    with without_cycle_collection():
        while not simulation.over and simulation.now_s < simulation.flight.time_limit_s:
            simulation.advance()
            yield journal.collect()


def log_metadata(flight: SimulatedFlight) -> dict[str, str]:
    """Return what the flight log says of a flight."""
    return {
        "contract": flight.contract.model_dump_json(),
        "contract_sha256": flight.contract.sha256,
        "mission": flight.mission.model_dump_json(),
        "seed": str(flight.seed),
    }


def fly(
    flight: SimulatedFlight, directory: Path, watch: Callable[[Simulation], None] = lambda _: None
) -> SimulationReport:
    """Fly in virtual time; write ``flight.mcap`` and ``truth.mcap``, the same for the same seed.

    Args:
        flight: to simulate.
        directory: for the logs.
        watch: called after every tick, to show progress.

    Raises:
        OSError: a log cannot be written.
    """
    warm_up()  # once per process, so that the flight does not include loading compiled code
    began_s = time.perf_counter()
    simulation = Simulation(flight)
    with ExitStack() as stack:
        flight_log = stack.enter_context(FlightLog(directory / "flight.mcap", log_metadata(flight)))
        truth_log = stack.enter_context(
            TruthLog(directory / "truth.mcap", EPOCH_UNIX_S, simulation.scene.world.field)
        )
        for records in ticks(simulation):
            flight_log.write(records)
            scene = simulation.scene
            truth_log.write(scene.vehicle.truth, scene.world, scene.movers)
            watch(simulation)
    return SimulationReport(
        virtual_s=simulation.now_s,
        wall_s=time.perf_counter() - began_s,
        plan_times_s=simulation.autonomy.navigator.plan_times_s,
        aborted=simulation.aborted,
    )
