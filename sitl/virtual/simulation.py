"""The whole system in virtual time: one seed, one log.

Onboard service, vehicle, sensor and operator exchange the same bytes as over UDP and Zenoh, only
without sockets; simulation shortcuts: bytes and frames arrive in the step in which they were sent,
unless a link or the sensor's latency delays them; the autopilot decides and reports as often as the
service, every 20 ms, not every 10 ms as it does live, and the wind is as constant in between.  Its
telemetry takes 10 ms, so that a pose is 20 ms old when it is used.  The only `sitl` module that
imports how `onboard` flies.
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
from onboard.files.models import Contract, InputSet, Mission
from onboard.files.obstacle_field import ObstacleField
from onboard.guidance.phases import Phase
from onboard.planning.plan import Plan
from onboard.planning.planner import Planner
from onboard.planning.problem import AvoidanceProblem
from onboard.planning.qp.search import QpPlanner
from onboard.recording.flight_log import FlightLog
from onboard.recording.journal import Journal
from onboard.recording.messages import Record
from onboard.recording.writer_thread import StopOnFirstError
from sitl.config import SitlConfig
from sitl.environment.truth_log import TruthLog
from sitl.vehicle.scene import Scene
from sitl.vehicle.vehicle import TICK_RATE_HZ, warm_up
from sitl.virtual.faults.plant import PlantFaults
from sitl.virtual.faults.schedule import Fault, FaultInjector
from sitl.virtual.scripted_operator import Operator, Step
from sitl.virtual.standstill import Standstill

STEPS_PER_OPERATOR: Final = 5
TELEMETRY_DELAY_S: Final = 0.01
# Where virtual time begins; any instant will do, as long as it is always the same.
EPOCH_UNIX_S: Final = 1_790_000_000.0
ONBOARD_LINK, OPERATOR_LINK = 0, 1
# A file that Linux always finds full; where there is none, writing to it fails as well.
FULL_DISK: Final = Path("/dev/full")
# How long the operator waits before landing where the service does not fly: it has died, it refuses
# to depart, the autopilot does not obey it.
PATIENCE_S: Final = 8.0


@dataclass(frozen=True)
class SimulatedFlight:
    """What is to be flown.

    Attributes:
        contract, mission: for the onboard service.
        sitl: vehicle, autopilot, sensors, wind.
        obstacles: the field.
        seed: of everything random.
        faults: what goes wrong.
        input_set: which accelerations plans may use.
        fly_outside_contract: fly although the contract does not comply.
        time_limit_s: the flight is given up after this.
    """

    contract: Contract
    mission: Mission
    sitl: SitlConfig
    obstacles: ObstacleField
    seed: int = 1
    faults: tuple[Fault, ...] = ()
    input_set: InputSet = "inner"
    fly_outside_contract: bool = False
    time_limit_s: float = 600.0


@dataclass(frozen=True)
class SimulationReport:
    """What the logs do not say, since it differs from run to run.

    Attributes:
        virtual_s, wall_s: simulated time and the time it took.
        plan_times_s: wall time of each plan.
        aborted: why the operator did not fly the vehicle and bring it down again; None if so.
    """

    virtual_s: float
    wall_s: float
    plan_times_s: list[float] = field(default_factory=list)
    aborted: str | None = None


class Simulation:
    """One flight, advanced step by step.

    Args:
        flight: what is to be flown.

    Attributes:
        now_s: virtual time.
        flight: what is being flown.
        scene, autonomy, operator: vehicle and world; the service; who arms and lands.
    """

    def __init__(self, flight: SimulatedFlight) -> None:
        config = flight.sitl.model_copy(update={"seed": flight.seed})
        self.now_s = 0.0
        self.scene = Scene(config, flight.obstacles, EPOCH_UNIX_S, round(TICK_S * TICK_RATE_HZ))
        self._solver = _LimitedQp()
        self.autonomy = _start_service(flight, self._solver)
        self.operator = Operator(config.system_id, flight.mission.altitude_m)
        self.flight = flight
        self._faults = FaultInjector(flight.faults, flight.seed)
        self._plant_faults = PlantFaults(
            self.scene.vehicle, config.system_id, config.flavour, OPERATOR_LINK
        )
        self._log = StopOnFirstError()
        self._steps = 0
        self._dead = False
        self._mission_changed = False
        self._idle_since_s = math.inf
        self._standstill = Standstill()

    @property
    def over(self) -> bool:
        """Whether the vehicle is back on the ground."""
        return self.operator.step is Step.DONE

    @property
    def aborted(self) -> str | None:
        """Why the operator did not fly the vehicle and bring it down again; None if so."""
        if self.over:
            return self.operator.gave_up
        return "the vehicle did not land within the time limit"

    def advance(self) -> None:
        """Let 20 ms pass: a tick of the service."""
        self._steps += 1
        self.now_s = self._steps * TICK_S
        self._faults.advance(self.now_s, self.autonomy.navigator.phase)
        self._plant_faults.apply(self._faults, self.now_s)
        self._solver.limited = self._faults.present("solver_limited")
        self.scene.advance(self.now_s)
        self._bury_or_revive()
        self._serve()
        vehicle = self.scene.vehicle
        vehicle.receive(self._faults.rival(), OPERATOR_LINK)
        if self._steps % STEPS_PER_OPERATOR == 0:
            self._operate()

    def _serve(self) -> None:
        """Let the onboard service hear, decide and speak, as far as it lives."""
        vehicle, faults, autonomy = self.scene.vehicle, self._faults, self.autonomy
        payloads = [detection.payload for detection in self.scene.take_detections()]
        frames = faults.detections(payloads, self.now_s, vehicle.truth.position_ned_m)
        telemetry = faults.telemetry(vehicle.bytes_to_send(ONBOARD_LINK))
        if self._dead:
            return
        for frame in frames:
            autonomy.receive_detection(frame, self.now_s)
        if telemetry:
            autonomy.receive_mavlink(telemetry, self.now_s - TICK_S + TELEMETRY_DELAY_S)
        if not faults.present("tick_stall"):
            self._fill_disk()
            self._change_mission()
            autonomy.tick(self.now_s)
            vehicle.receive(faults.setpoints(autonomy.mavlink_to_send()), ONBOARD_LINK)

    def _fill_disk(self) -> None:
        """End the log when the disk is full; simulation shortcut: until then there is none."""
        if self._faults.present("disk_full"):
            self._log.run(_write_to_full_disk)
        if self._log.failure is not None:
            self.autonomy.report_log_end(self._log.failure, self.now_s)

    def _change_mission(self) -> None:
        """Have the operator send another mission, once: what is left of the last leg, turned."""
        turn_deg = self._faults.amount("mission_changed")
        if turn_deg is None or self._mission_changed:
            return
        self._mission_changed = True
        here_ned_m = self.scene.vehicle.truth.position_ned_m
        mission = _turned(self.flight.mission, here_ned_m[:2], math.radians(turn_deg))
        self.autonomy.receive_mission(mission.model_dump_json().encode(), self.now_s)

    def _bury_or_revive(self) -> None:
        dead = self._faults.present("daemon_dead")
        if self._dead and not dead:
            self.autonomy = _start_service(self.flight, self._solver)
        self._dead = dead

    def _operate(self) -> None:
        self.operator.receive(self.scene.vehicle.bytes_to_send(OPERATOR_LINK))
        phase = self.autonomy.navigator.phase
        ended = phase in (Phase.ARRIVED, Phase.HOLD) and not self._dead
        handed_over = self.operator.step in (Step.HAND_OVER, Step.WATCH)
        idle = handed_over and (self._dead or phase is Phase.STANDBY)
        told_ned_m = self.scene.vehicle.estimate.position_ned_m
        stands = self._standstill.reached(self.now_s, told_ned_m, stopping=ended)
        self._idle_since_s = _since(self._idle_since_s, self.now_s, present=idle)
        if self._faults.present("operator_takes_over"):
            self.operator.take_over()
        else:
            self.operator.hand_back()
        # A vehicle without its service is left alone until it has come to rest by itself.
        if stands or self.now_s > self._idle_since_s + PATIENCE_S:
            self.operator.land()
        self.operator.advance(self.now_s)
        self.scene.vehicle.receive(self.operator.bytes_to_send(), OPERATOR_LINK)


def _since(began_s: float, now_s: float, *, present: bool) -> float:
    """Return since when something lasts; infinite while it does not."""
    return min(began_s, now_s) if present else math.inf


def _write_to_full_disk() -> None:
    FULL_DISK.write_text("a line", encoding="ascii")


def _turned(mission: Mission, here_ned_m: tuple[float, float], turn_rad: float) -> Mission:
    """Return a mission of one leg, to where the last one would end if it were turned about here."""
    last = mission.legs[-1]
    (north_m, east_m), (end_north_m, end_east_m) = here_ned_m, last.end_ned_m
    left_m = math.dist(here_ned_m, last.end_ned_m)
    heading_rad = math.atan2(end_east_m - east_m, end_north_m - north_m) + turn_rad
    end_ned_m = (north_m + left_m * math.cos(heading_rad), east_m + left_m * math.sin(heading_rad))
    leg = last.model_copy(update={"end_ned_m": end_ned_m})
    return mission.model_copy(update={"start_ned_m": here_ned_m, "legs": (leg,)})


class _LimitedQp(QpPlanner):
    """Finds no optimum within its iterations while it is limited."""

    limited = False

    def plan(
        self,
        problem: AvoidanceProblem,
        current: Plan | None,
        incumbent: Plan | None,
        reasons: list[str],
    ) -> Plan | None:
        """Return what is flown already; see `QpPlanner.plan`."""
        if self.limited:
            reasons.append("no QP was solved within its iterations")
            return incumbent
        return super().plan(problem, current, incumbent, reasons)


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
    )


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


def ticks(simulation: Simulation, *, shown: bool = True) -> Iterator[list[Record]]:
    """Advance a flight to its end, or its time limit; yield what each tick leaves behind.

    Args:
        simulation: the flight.
        shown: whether people look at it; see `Journal`.
    """
    service = simulation.autonomy
    journal = Journal(service, timed=False, shown=shown)
    with without_cycle_collection():
        while not simulation.over and simulation.now_s < simulation.flight.time_limit_s:
            simulation.advance()
            if service is not simulation.autonomy:  # it died, and was started again
                service = simulation.autonomy
                journal = Journal(service, timed=False, shown=shown)
            yield journal.collect(simulation.now_s)


def fly(
    flight: SimulatedFlight, directory: Path, watch: Callable[[Simulation], None] = lambda _: None
) -> SimulationReport:
    """Fly in virtual time; write ``flight.mcap`` and ``truth.mcap``, the same for the same seed.

    Args:
        flight: what is to be flown.
        directory: for the logs.
        watch: called after every tick, to show how far the flight is.

    Raises:
        OSError: a log cannot be written.
    """
    warm_up()  # once per process: loading compiled code is no part of the flight
    began_s = time.perf_counter()
    simulation = Simulation(flight)
    metadata = {
        "contract": flight.contract.model_dump_json(),
        "contract_sha256": flight.contract.sha256,
        "mission": flight.mission.model_dump_json(),
        "seed": str(flight.seed),
    }
    with ExitStack() as stack:
        flight_log = stack.enter_context(FlightLog(directory / "flight.mcap", metadata))
        truth_log = stack.enter_context(TruthLog(directory / "truth.mcap", EPOCH_UNIX_S))
        for records in ticks(simulation):
            flight_log.write(records)
            truth_log.write(simulation.scene.vehicle.truth, simulation.scene.world)
            watch(simulation)
    return SimulationReport(
        virtual_s=simulation.now_s,
        wall_s=time.perf_counter() - began_s,
        plan_times_s=simulation.autonomy.navigator.plan_times_s,
        aborted=simulation.aborted,
    )
