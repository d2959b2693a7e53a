"""Real MAVSDK against a scripted autopilot: what real firmware does and the simulation does not."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from typing import Any

import pytest
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.console.interruption import Interruption
from gcs_tools.console.processes import free_ports
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.check import LiveRequest, check_live
from gcs_tools.vehicle.clock import ClockComparison, compare_vehicle_clock
from gcs_tools.vehicle.connection import AmbiguousVehicleError, connected_vehicle
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from gcs_tools.vehicle.query import TRIES, answer
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG
from tests.gcs_tools.vehicle.fake_autopilot import (
    Behaviour,
    FakeAutopilot,
    answers_ping,
    answers_request,
    answers_timesync,
    autopilots,
    misaddresses_timesync,
    says_nothing,
    tells_time,
)

# MAVSDK waits for what does not come: of their minute these tests compute for four seconds.
pytestmark = [pytest.mark.real_time, pytest.mark.waiting]

ESTIMATOR_STATUS = 230


def connected(
    port: int, ask: Callable[[Vehicle], Awaitable[Any]], system_id: int | None = None
) -> Any:
    """Return what a question to the vehicle on a port gives."""

    async def run() -> Any:
        url = f"udpin://127.0.0.1:{port}"
        async with connected_vehicle(url, Interruption(), 3.0, system_id=system_id) as vehicle:
            return await ask(vehicle)

    return asyncio.run(run())


def estimator_status(autopilot: FakeAutopilot) -> None:
    autopilot.link.mav.estimator_status_send(0, 0x3FF, *(0.1,) * 8)


async def ask_estimator(vehicle: Vehicle) -> dict[str, Any] | None:
    direct = MavlinkDirectAsync(vehicle.system)
    return await answer(direct, vehicle.system_id, ESTIMATOR_STATUS, "ESTIMATOR_STATUS")


async def ask_clock(vehicle: Vehicle) -> ClockComparison | None:
    return await compare_vehicle_clock(vehicle.system)


@pytest.mark.parametrize("dropped", [0, TRIES - 1])
def test_an_answer_that_comes_at_once_is_not_missed(dropped: int) -> None:
    (port,) = free_ports(1)
    behaviour = answers_request(ESTIMATOR_STATUS, estimator_status, dropped)

    async def ask_often(vehicle: Vehicle) -> list[dict[str, Any] | None]:
        return [await ask_estimator(vehicle) for _ in range(5)]

    with FakeAutopilot(port, behaviour={"COMMAND_LONG": behaviour}):
        for found in connected(port, ask_often, 1):
            assert found is not None
            assert found["flags"] == 0x3FF


def test_only_the_autopilot_itself_answers_for_it() -> None:
    (port,) = free_ports(1)
    companion = FakeAutopilot(
        port, 1, mavlink.MAV_AUTOPILOT_INVALID, component_id=196, stream=estimator_status
    )
    with autopilots(companion, FakeAutopilot(port)):
        assert connected(port, ask_estimator, 1) is None


def test_no_answer_is_none() -> None:
    (port,) = free_ports(1)
    with FakeAutopilot(port):
        assert connected(port, ask_estimator, 1) is None


@pytest.mark.parametrize(
    ("timesync", "ping", "ahead_s", "source"),
    [
        (answers_timesync, answers_ping, 30.0, "TIMESYNC"),
        (misaddresses_timesync, answers_ping, -1199.9, "PING and SYSTEM_TIME"),
        (misaddresses_timesync, answers_ping, None, "PING"),
        (misaddresses_timesync, None, 30.0, None),
    ],
)
def test_the_clock_is_known_by_what_the_vehicle_answers(
    timesync: Behaviour, ping: Behaviour | None, ahead_s: float | None, source: str | None
) -> None:
    (port,) = free_ports(1)
    behaviour = {"TIMESYNC": timesync} | ({} if ping is None else {"PING": ping})
    stream = says_nothing if ahead_s is None else tells_time(ahead_s)
    with FakeAutopilot(port, behaviour=behaviour, stream=stream):
        found = connected(port, ask_clock, 1)
    if source is None:
        assert found is None
        return
    assert found.source == source
    assert 0.0 < found.round_trip_s < 0.5
    if ahead_s is None:
        assert (found.unsteady_s, found.unix_offset_s) == (None, None)
    else:
        assert found.unsteady_s < 0.1
        assert found.unix_offset_s == pytest.approx(ahead_s, abs=0.5)


def test_the_clock_of_a_companion_is_left_out() -> None:
    """It answers and tells the time under the same system id."""
    (port,) = free_ports(1)
    companion = FakeAutopilot(
        port,
        kind=mavlink.MAV_AUTOPILOT_INVALID,
        component_id=191,
        behaviour={"TIMESYNC": answers_timesync, "PING": answers_ping},
        stream=tells_time(-50.0),
    )
    autopilot = FakeAutopilot(port, behaviour={"PING": answers_ping}, stream=tells_time(30.0))
    with autopilots(companion, autopilot):
        found = connected(port, ask_clock, 1)
    assert found.source == "PING and SYSTEM_TIME"
    assert found.unsteady_s < 0.1
    assert found.unix_offset_s == pytest.approx(30.0, abs=0.5)


async def identity(vehicle: Vehicle) -> int:
    return vehicle.system_id


def test_of_two_vehicles_one_has_to_be_chosen() -> None:
    (port,) = free_ports(1)
    ardupilot = FakeAutopilot(port, 2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    with autopilots(FakeAutopilot(port, 1), ardupilot):
        with pytest.raises(AmbiguousVehicleError, match=r"system ids 1, 2: .*--system-id"):
            connected(port, identity)
        assert connected(port, identity, 2) == 2
        with pytest.raises(VehicleError, match=r"no autopilot of system id 7 .*only .* 1, 2"):
            connected(port, identity, 7)


def test_a_companion_of_the_same_system_makes_no_second_vehicle() -> None:
    (port,) = free_ports(1)
    companion = FakeAutopilot(port, 1, mavlink.MAV_AUTOPILOT_INVALID, component_id=196)
    with autopilots(companion, FakeAutopilot(port, 1)):
        assert connected(port, identity) == 1


async def climb(vehicle: Vehicle) -> tuple[str, str]:
    """Ask for a take-off, which the scripted autopilot refuses; tell the profile and the answer."""
    with pytest.raises(VehicleError) as refused:
        await vehicle.take_off(4.0)
    return vehicle.profile.key, str(refused.value)


def test_ardupilot_takes_off_by_its_profile_although_a_companion_is_heard_first() -> None:
    """MAVSDK takes the autopilot to be what the first heartbeat of the system states."""
    (port,) = free_ports(1)
    told: list[tuple[int, float]] = []

    def refuse(autopilot: FakeAutopilot, message: Any) -> None:
        if message.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            told.append((message.command, message.param7))
            autopilot.link.mav.command_ack_send(message.command, mavlink.MAV_RESULT_DENIED)

    companion = FakeAutopilot(port, 1, mavlink.MAV_AUTOPILOT_INVALID, component_id=196)
    ardupilot = FakeAutopilot(
        port, 1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, behaviour={"COMMAND_LONG": refuse}
    )

    async def run() -> tuple[str, str]:
        url = f"udpin://127.0.0.1:{port}"
        with ExitStack() as stack:
            stack.enter_context(companion)
            late = asyncio.get_running_loop().call_later(1.0, stack.enter_context, ardupilot)
            async with connected_vehicle(url, Interruption(), 10.0) as vehicle:
                late.cancel()
                return await climb(vehicle)

    assert asyncio.run(run()) == (
        "ardupilot", "taking off: refused by the vehicle (MAV_RESULT 2)",
    )  # fmt: skip
    assert set(told) == {(mavlink.MAV_CMD_NAV_TAKEOFF, 4.0)}


@pytest.mark.parametrize(
    ("foreign", "named"),
    [
        ([(255, 190)], ""),  # a ground station
        ([(1, 196)], ", only system ids 1"),  # a daemon whose autopilot is silent
        ([(40, 154), (3, 191), (255, 190)], ", only system ids 3, 40"),
    ],
)
def test_traffic_without_an_autopilot_is_named(foreign: list[tuple[int, int]], named: str) -> None:
    (port,) = free_ports(1)
    silent = mavlink.MAV_AUTOPILOT_INVALID
    others = [FakeAutopilot(port, number, silent, part) for number, part in foreign]
    contract = assess(load_contract(CONFIG / "paper_contract.yaml"))
    request = LiveRequest(f"udpin://127.0.0.1:{port}", connect_timeout_s=1.5)
    with autopilots(*others):
        (finding,) = check_live(request, contract, None, paper_compliant=True)
    assert finding.verdict is Verdict.UNKNOWN
    assert finding.text.endswith(f"no autopilot heard in 1.5 s{named}")
