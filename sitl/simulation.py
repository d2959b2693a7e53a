"""The whole system in virtual time: one seed, one log.

Onboard service, vehicle, sensor and operator exchange the same bytes as over UDP and Zenoh, only
without sockets; simulation shortcut: bytes and frames arrive in the step in which they were sent,
unless a link or the sensor's latency delays them.  The only `sitl` module that imports `onboard`'s
flight code.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from onboard.agility import InputSet
from onboard.autonomy import Autonomy
from onboard.config import Contract, Mission
from onboard.guidance import Phase
from onboard.journal import Journal
from onboard.recorder import FlightLog
from sitl.config import SitlConfig
from sitl.field import ObstacleField
from sitl.operator import Operator, Step
from sitl.scene import Scene
from sitl.truth_log import TruthLog

STEP_S: Final = 0.01
STEPS_PER_TICK: Final = 2
STEPS_PER_OPERATOR: Final = 10
# Where virtual time begins; any instant will do, as long as it is always the same.
EPOCH_UNIX_S: Final = 1_790_000_000.0
ONBOARD_LINK, OPERATOR_LINK = 0, 1
# How long the vehicle hovers after its mission before it lands.
LINGER_S: Final = 1.0


@dataclass(frozen=True)
class SimulatedFlight:
    """What is to be flown.

    Attributes:
        contract, mission: for the onboard service.
        sitl: vehicle, autopilot, sensors, wind.
        obstacles: the field.
        seed: of everything random.
        input_set: which accelerations plans may use.
        fly_outside_contract: fly although the contract does not comply.
        time_limit_s: the flight is given up after this.
    """

    contract: Contract
    mission: Mission
    sitl: SitlConfig
    obstacles: ObstacleField
    seed: int = 1
    input_set: InputSet = "inner"
    fly_outside_contract: bool = False
    time_limit_s: float = 600.0


@dataclass(frozen=True)
class SimulationReport:
    """What the logs do not say, since it differs from run to run.

    Attributes:
        virtual_s, wall_s: simulated time and the time it took.
        plan_times_s: wall time of each plan.
        landed: whether the operator brought the vehicle down within the time limit.
    """

    virtual_s: float
    wall_s: float
    plan_times_s: list[float] = field(default_factory=list)
    landed: bool = True


class Simulation:
    """One flight, advanced step by step.

    Args:
        flight: what is to be flown.
    """

    def __init__(self, flight: SimulatedFlight) -> None:
        config = flight.sitl.model_copy(update={"seed": flight.seed})
        self.now_s = 0.0
        self.scene = Scene(config, flight.obstacles, EPOCH_UNIX_S)
        self.autonomy = Autonomy(
            flight.contract,
            flight.mission,
            epoch_unix_s=EPOCH_UNIX_S,
            system_id=config.system_id,
            input_set=flight.input_set,
            fly_outside_contract=flight.fly_outside_contract,
            stopwatch=time.perf_counter,
        )
        self.operator = Operator(config.system_id, flight.mission.altitude_m)
        self._steps = 0
        self._mission_over_s: float | None = None

    @property
    def over(self) -> bool:
        """Whether the vehicle is back on the ground."""
        return self.operator.step is Step.DONE

    @property
    def at_tick(self) -> bool:
        """Whether the onboard service decided in the last step."""
        return self._steps % STEPS_PER_TICK == 0

    def advance(self) -> None:
        """Let 10 ms pass."""
        vehicle, autonomy = self.scene.vehicle, self.autonomy
        self._steps += 1
        self.now_s = self._steps * STEP_S
        self.scene.advance(self.now_s)
        for detection in self.scene.take_detections():
            autonomy.receive_detection(detection.payload, self.now_s)
        autonomy.receive_mavlink(vehicle.bytes_to_send(ONBOARD_LINK), self.now_s)
        if self.at_tick:
            autonomy.tick(self.now_s)
            vehicle.receive(autonomy.mavlink_to_send(), ONBOARD_LINK)
        self.operator.receive(vehicle.bytes_to_send(OPERATOR_LINK))
        if self._steps % STEPS_PER_OPERATOR == 0:
            self._operate()

    def _operate(self) -> None:
        if self._mission_over_s is None and self.autonomy.navigator.phase in (
            Phase.ARRIVED,
            Phase.HOLD,
        ):
            self._mission_over_s = self.now_s
        if self._mission_over_s is not None and self.now_s > self._mission_over_s + LINGER_S:
            self.operator.land()
        self.operator.advance(self.now_s)
        self.scene.vehicle.receive(self.operator.bytes_to_send(), OPERATOR_LINK)


def fly(flight: SimulatedFlight, directory: Path) -> SimulationReport:
    """Fly in virtual time; write ``flight.mcap`` and ``truth.mcap``, the same for the same seed.

    Raises:
        OSError: a log cannot be written.
    """
    began_s = time.perf_counter()
    simulation = Simulation(flight)
    metadata = {
        "contract": flight.contract.model_dump_json(),
        "contract_sha256": flight.contract.sha256,
        "seed": str(flight.seed),
    }
    with ExitStack() as stack:
        flight_log = stack.enter_context(FlightLog(directory / "flight.mcap", metadata))
        truth_log = stack.enter_context(TruthLog(directory / "truth.mcap", EPOCH_UNIX_S))
        journal = Journal(simulation.autonomy, timed=False)
        while not simulation.over and simulation.now_s < flight.time_limit_s:
            simulation.advance()
            if simulation.at_tick:
                flight_log.write(journal.collect(simulation.now_s))
                truth_log.write(simulation.scene.vehicle.truth, simulation.scene.world)
    return SimulationReport(
        virtual_s=simulation.now_s,
        wall_s=time.perf_counter() - began_s,
        plan_times_s=simulation.autonomy.navigator.plan_times_s,
        landed=simulation.over,
    )
