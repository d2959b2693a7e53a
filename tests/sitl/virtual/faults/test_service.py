"""What each fault does to the service's process and to its operator."""

import math
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from gcs_tools.scenario import load_scenario
from onboard.files.mission_file import Mission
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind
from sitl.virtual.faults.service import ServiceFaults, turned
from sitl.virtual.scripted_operator import Operator, Step
from sitl.virtual.simulation import SimulatedFlight, Simulation

SCENARIO = load_scenario(Path(__file__).parents[4] / "config" / "scenarios" / "daemon_dead.yaml")


def simulation_with(*faults: Fault) -> Simulation:
    return Simulation(
        SimulatedFlight(
            SCENARIO.contract,
            SCENARIO.mission,
            SCENARIO.sitl_config(seed=1),
            SCENARIO.obstacles,
            faults=faults,
        )
    )


def applied(kind: FaultKind, amount: float | None = None) -> ServiceFaults:
    schedule = FaultSchedule((Fault(kind=kind, amount=amount),), seed=1)
    schedule.advance(0.0, "cruise")
    faults = ServiceFaults(schedule, SCENARIO.mission)
    faults.apply()
    return faults


class RecordingService:
    """Keeps what the faults ask of a service."""

    def __init__(self) -> None:
        self.missions: list[bytes] = []
        self.log_ends: list[str] = []

    def receive_mission(self, payload: bytes, _: float) -> None:
        self.missions.append(payload)

    def report_log_end(self, failure: object, _: float) -> None:
        self.log_ends.append(str(failure))


@pytest.mark.parametrize(
    ("kind", "dead", "stalled", "limited"),
    [
        ("daemon_dead", True, False, False),
        ("tick_stall", False, True, False),
        ("solver_limited", False, False, True),
        ("gust", False, False, False),
    ],
)
def test_the_process_is_hit_as_named(
    kind: FaultKind, dead: bool, stalled: bool, limited: bool
) -> None:
    faults = applied(kind)
    assert (faults.dead, faults.stalled, faults.solver.limited) == (dead, stalled, limited)


def test_a_solver_is_released_when_the_fault_ends() -> None:
    schedule = FaultSchedule((Fault(kind="solver_limited", duration_s=1.0),), seed=1)
    faults = ServiceFaults(schedule, SCENARIO.mission)
    limited = []
    for now_s in (0.0, 2.0):
        schedule.advance(now_s, "cruise")
        faults.apply()
        limited.append(faults.solver.limited)
    assert limited == [True, False]


def test_a_limited_solver_keeps_what_is_flown_and_says_why() -> None:
    faults, reasons = applied("solver_limited"), list[str]()
    unused: Any = None
    incumbent: Any = object()
    assert faults.solver.plan(unused, None, incumbent, reasons) is incumbent
    assert reasons == ["no QP was solved within its iterations"]


def test_another_mission_is_sent_once() -> None:
    faults, service = applied("mission_changed", 30.0), RecordingService()
    autonomy: Any = service
    for _ in range(3):
        faults.before_tick(autonomy, (1.0, 0.0, -4.0), 0.0)
    (payload,) = service.missions
    assert Mission.model_validate_json(payload).start_ned_m == (1.0, 0.0)
    assert service.log_ends == []


def test_a_full_disk_ends_the_log() -> None:
    faults, service = applied("disk_full"), RecordingService()
    autonomy: Any = service
    faults.before_tick(autonomy, (0.0, 0.0, -4.0), 0.0)
    assert "No space left on device" in service.log_ends[0]


@pytest.mark.parametrize("turn_deg", [-90.0, -30.0, 0.0, 45.0, 90.0])
def test_a_turned_mission_is_as_long_and_bends_to_the_right(turn_deg: float) -> None:
    mission, here_ned_m = SCENARIO.mission, (2.0, 0.0)
    changed = turned(mission, here_ned_m, math.radians(turn_deg))
    (leg,) = changed.legs
    before_m, after_m = mission.legs[-1].end_ned_m, leg.end_ned_m
    assert math.dist(here_ned_m, after_m) == pytest.approx(math.dist(here_ned_m, before_m))
    headings_rad = [
        math.atan2(end_m[1] - here_ned_m[1], end_m[0] - here_ned_m[0])
        for end_m in (before_m, after_m)
    ]
    turn_rad = headings_rad[1] - headings_rad[0]
    assert math.degrees(math.remainder(turn_rad, math.tau)) == pytest.approx(turn_deg)
    assert changed.start_ned_m == here_ned_m


def test_the_operator_takes_over_and_hands_back() -> None:
    schedule = FaultSchedule((Fault(kind="operator_takes_over", duration_s=1.0),), seed=1)
    faults = ServiceFaults(schedule, SCENARIO.mission)
    operator = Operator(1, 4.0)
    operator.step = Step.WATCH
    steps = []
    for now_s in (0.0, 0.5, 1.5):
        schedule.advance(now_s, "cruise")
        faults.command(operator)
        steps.append(operator.step)
    assert steps == [Step.INTERVENE, Step.INTERVENE, Step.HAND_OVER]


def test_a_dead_service_is_silent_and_starts_anew() -> None:
    simulation = simulation_with(Fault(kind="daemon_dead", start_s=1.0, duration_s=1.0))
    services, sent = set(), []
    for _ in range(150):
        before = simulation.autonomy
        simulation.advance()
        services.add(id(before))
        if 1.0 <= simulation.now_s < 2.0:
            sent.append(before.mavlink_to_send())
    assert len(services) == 2
    assert not any(sent)


def test_a_stalled_service_sends_no_heartbeat() -> None:
    simulation = simulation_with(Fault(kind="tick_stall", start_s=0.5, duration_s=1.5))
    for _ in range(25):
        simulation.advance()
    simulation.autonomy.mavlink_to_send()
    for _ in range(60):
        simulation.advance()
    codec = mavlink.MAVLink(None)
    messages = codec.parse_buffer(simulation.autonomy.mavlink_to_send()) or []
    assert "HEARTBEAT" not in {message.get_type() for message in messages}
