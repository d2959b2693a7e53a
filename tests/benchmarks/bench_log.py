"""What the flight log costs: per tick while flying, and for the report of ten minutes of it."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from gcs_tools.flight_report.command import write_report
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import read_flight
from gcs_tools.scenario import load_scenario
from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.mission_file import Leg, Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.recording.flight_log import Direction, FlightLog
from onboard.recording.journal import Journal
from onboard.recording.recorder import FlightRecorder
from sitl.virtual.simulation import EPOCH_UNIX_S, SimulatedFlight, Simulation, fly
from tests.benchmarks.measurement import Measurement, sized
from tests.gcs_tools.running import CONFIG

# The most that logging may cost of a tick's time, in per cent.
BOUND_PERCENT = 5.0
TEN_MINUTES_S = 600
HALF_A_MINUTE_S = 30
# Of the paper's flight, where only the benchmark itself is tried: the climb and some cruise.
FEW_SECONDS_S = 12
# In virtual time ticks come faster than a log's thread can follow, which it need not.
_PAUSE_S = 0.002


@dataclass
class Costs:
    """Processor time spent, in seconds.

    Attributes:
        ticks: how many.
        deciding_s: in the service.
        handing_over_s: until the log's thread had everything.
        logging_s: in collecting, and in what that thread does with it.
        crossed: what crossed the MAVLink link since the last tick.
    """

    ticks: int = 0
    deciding_s: float = 0.0
    handing_over_s: float = 0.0
    logging_s: float = 0.0
    crossed: list[tuple[Direction, bytes]] = field(default_factory=list)


def bench_log_share_of_a_tick() -> Measurement:
    """Processor time of collecting, encoding, compressing, as a share of a tick's 20 ms."""
    costs = _costs_of_the_paper_s_flight()
    share = 100.0 * costs.logging_s / (costs.ticks * TICK_S)
    return Measurement(share, "% of 20 ms", limit=BOUND_PERCENT)


def bench_log_wait_of_a_tick() -> Measurement:
    """How long a tick waits for its log, as a share of the time in which it decides."""
    costs = _costs_of_the_paper_s_flight()
    share = 100.0 * costs.handing_over_s / costs.deciding_s
    return Measurement(share, "% of deciding", limit=BOUND_PERCENT)


def bench_report_of_ten_minutes() -> Measurement:
    """From the log of ten minutes to the page; its size has to stay below 10 MB."""
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        fly(_ten_minutes(), directory)
        began_s = time.process_time()
        document = document_of(read_flight(directory))
        write_report([document], directory / "report.html")
        spent_s = time.process_time() - began_s
        assert document["span_s"][1] > _duration_s() - 20.0, document["span_s"]
        assert (directory / "report.html").stat().st_size < 10e6
    return Measurement(spent_s, "s", limit=5.0)


class _Timed:
    """A service whose own time is counted."""

    def __init__(self, autonomy: Autonomy, costs: Costs) -> None:
        self._autonomy, self._costs = autonomy, costs

    def __getattr__(self, name: str) -> object:
        return getattr(self._autonomy, name)

    def receive_detection(self, data: bytes, now_s: float) -> None:
        began_s = time.thread_time()
        self._autonomy.receive_detection(data, now_s)
        self._costs.deciding_s += time.thread_time() - began_s

    def receive_mavlink(self, data: bytes, now_s: float) -> None:
        self._costs.crossed.append(("received", data))
        began_s = time.thread_time()
        self._autonomy.receive_mavlink(data, now_s)
        self._costs.deciding_s += time.thread_time() - began_s

    def tick(self, now_s: float) -> None:
        began_s = time.thread_time()
        self._autonomy.tick(now_s)
        self._costs.deciding_s += time.thread_time() - began_s

    def mavlink_to_send(self) -> bytes:
        data = self._autonomy.mavlink_to_send()
        self._costs.crossed.append(("sent", data))
        return data


def _costs_of_the_paper_s_flight() -> Costs:
    scenario = load_scenario(CONFIG / "paper.yaml")
    simulation = Simulation(
        SimulatedFlight(
            scenario.contract,
            scenario.mission,
            scenario.sitl_config(seed=1),
            scenario.obstacles,
        )
    )
    costs = Costs()
    journal = Journal(simulation.autonomy, timed=True)
    simulation.autonomy = _Timed(simulation.autonomy, costs)  # type: ignore[assignment]
    with (
        tempfile.TemporaryDirectory() as name,
        FlightLog(Path(name) / "here.mcap", {}) as here,
        FlightRecorder(Path(name) / "there.mcap", {}) as there,
    ):
        until_s = sized(TEN_MINUTES_S, FEW_SECONDS_S)
        while not simulation.over and simulation.now_s < until_s:
            simulation.advance()
            _log(journal, here, there, costs, simulation.now_s)
    return costs


def _log(
    journal: Journal, here: FlightLog, there: FlightRecorder, costs: Costs, now_s: float
) -> None:
    """Log everything twice: in this thread, and as the daemon does."""
    time_unix_s, began_s = EPOCH_UNIX_S + now_s, time.thread_time()
    records = journal.collect(now_s)
    here.write(records)
    for direction, data in costs.crossed:
        here.write_mavlink(direction, time_unix_s, data)
    logged_s = time.thread_time()
    there.write(records)
    for direction, data in costs.crossed:
        there.write_mavlink(direction, time_unix_s, data)
    costs.handing_over_s += time.thread_time() - logged_s
    costs.logging_s += logged_s - began_s
    costs.crossed.clear()
    costs.ticks += 1
    time.sleep(_PAUSE_S)


def _duration_s() -> int:
    return sized(TEN_MINUTES_S, HALF_A_MINUTE_S)


def _ten_minutes() -> SimulatedFlight:
    """Thirty obstacles, as far apart as a contract asks for, on either side of a long leg."""
    scenario = load_scenario(CONFIG / "default.yaml")
    length_m = scenario.contract.vehicle.cruise_speed_mps * _duration_s()
    obstacles = [
        Obstacle(id=str(n), center_ned_m=(30.0 + 50.0 * n, (-1.0) ** n * 0.4), size_m=(1.5, 1.5))
        for n in range(30)
    ]
    leg = Leg(end_ned_m=(length_m, 0.0), target_half_width_m=12.0)
    return SimulatedFlight(
        scenario.contract,
        Mission(altitude_m=scenario.mission.altitude_m, legs=(leg,)),
        scenario.sitl_config(seed=1),
        ObstacleField.of(obstacles),
        time_limit_s=1.2 * TEN_MINUTES_S,
    )
