"""A live vehicle against its contract: what MAVSDK can learn of it, and what that means.

Every question has a time limit, and none is abandoned half-way, since MAVSDK hangs when it is
closed while one of its calls is in flight.  A question without an answer is a finding of its own.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import aclosing
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from mavsdk.asyncio import Autopilot, MavsdkError
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from gcs_tools.live_check_parameters import check_parameters
from gcs_tools.preflight_finding import Finding, Verdict
from gcs_tools.vehicle import HEALTH_TIMEOUT_S, Vehicle, VehicleError
from onboard.config import Mission
from onboard.contract import Assessment
from onboard.navigator import START_TOLERANCE_M

FLAVOURS: Mapping[Autopilot, str] = {Autopilot.PX4: "px4", Autopilot.ARDUPILOT: "ardupilot"}
# Older firmware behaves in ways that nobody has measured for this service.
OLDEST_VERSION: Mapping[str, tuple[int, int, int]] = {"px4": (1, 14, 0), "ardupilot": (4, 5, 0)}

# How long telemetry is counted, how often clocks are compared, how long an answer may take.
LISTEN_S = 2.0
PINGS = 8
ANSWER_TIMEOUT_S = 2.0
RATE_MIN_HZ = 5.0
# What is left of the battery after the mission: take-off, landing, and a third more than planned.
GROUND_TIME_S = 60.0
TIME_RESERVE = 4.0 / 3.0
CHARGE_RESERVE = 0.2

# MAV_MISSION_TYPE_FENCE and MAV_MISSION_OPERATION_CANCELLED.
_FENCE, _TRANSFER_CANCELLED = 1, 15

_COUNTED = ("ATTITUDE", "LOCAL_POSITION_NED")


@dataclass
class VehicleFacts:
    """What was learnt; None where the vehicle did not say.

    Attributes:
        flavour: ``px4``, ``ardupilot``, or None for another autopilot.
        version: of the firmware.
        unhealthy: what is not healthy; empty if everything is.
        parameters: by name.
        parameters_complete: whether they are all that the vehicle has.
        rates_hz: of the messages that the service lives on, on this link.
        round_trip_s: of TIMESYNC, the slowest of several.
        home_ned_m: home in the local frame.
        position_ned_m: where the vehicle stands.
        battery_share: remaining charge, 0 to 1.
        battery_time_s: remaining time, as the vehicle reckons.
        fence_items: corners, circles and return points of the geofence's polygons on board.
    """

    flavour: str | None
    version: tuple[int, int, int] | None = None
    unhealthy: str = ""
    parameters: dict[str, float] = field(default_factory=dict)
    parameters_complete: bool = False
    rates_hz: dict[str, float] = field(default_factory=dict)
    round_trip_s: float | None = None
    home_ned_m: tuple[float, float, float] | None = None
    position_ned_m: tuple[float, float, float] | None = None
    battery_share: float | None = None
    battery_time_s: float | None = None
    fence_items: int | None = None


# ---------------------------------------------------------------------- what is learnt


async def survey(vehicle: Vehicle, report: Callable[[str], None] = lambda _: None) -> VehicleFacts:
    """Ask a connected vehicle for everything; takes up to a minute of a silent one.

    Args:
        vehicle: to be asked.
        report: told of every step before it is taken.

    Raises:
        Interrupted: the operator gave up.
    """
    facts = VehicleFacts(FLAVOURS.get(vehicle.autopilot))
    report("health")
    try:
        await vehicle.wait_healthy()
    except VehicleError:
        facts.unhealthy = vehicle.state.unhealthy
    for step, ask in _QUESTIONS.items():
        report(step)
        await ask(vehicle, facts)
    report("telemetry rates")
    facts.rates_hz = await _count_messages(vehicle)
    report("link delay")
    facts.round_trip_s = await _ping(vehicle)
    # Last: by now it has been streamed for a while.
    if all(map(math.isfinite, vehicle.state.position_ned_m)):
        facts.position_ned_m = vehicle.state.position_ned_m
    return facts


async def _ask_version(vehicle: Vehicle, facts: VehicleFacts) -> None:
    try:
        version = await InfoAsync(vehicle.system).get_version()
    except MavsdkError:
        return
    numbers = version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch
    facts.version = numbers if any(numbers) else None


async def _ask_parameters(vehicle: Vehicle, facts: VehicleFacts) -> None:
    try:
        found = await ParamAsync(vehicle.system).get_all_params()
    except MavsdkError:
        return
    facts.parameters = {each.name: float(each.value) for each in found.int_params}
    facts.parameters |= {each.name: float(each.value) for each in found.float_params}
    facts.parameters_complete = bool(facts.parameters)


async def _ask_battery(vehicle: Vehicle, facts: VehicleFacts) -> None:
    telemetry = TelemetryAsync(vehicle.system)
    await _rate_asked(telemetry.set_rate_battery(2.0))
    reading = await _first(telemetry.subscribe_battery())
    if reading is None:
        return
    # MAVSDK gives per cent; NaN, or a time of nothing, is its way of not knowing.
    if math.isfinite(reading.remaining_percent) and reading.remaining_percent >= 0.0:
        facts.battery_share = reading.remaining_percent / 100.0
    if math.isfinite(reading.time_remaining_s) and reading.time_remaining_s > 0.0:
        facts.battery_time_s = reading.time_remaining_s


async def _ask_home(vehicle: Vehicle, facts: VehicleFacts) -> None:
    await _rate_asked(TelemetryAsync(vehicle.system).set_rate_home(1.0))
    messages = MavlinkDirectAsync(vehicle.system).subscribe_message("HOME_POSITION")
    message = await _first(messages)
    if message is not None:
        fields = json.loads(message.fields_json)
        facts.home_ned_m = (fields["x"], fields["y"], fields["z"])


async def _ask_fence(vehicle: Vehicle, facts: VehicleFacts) -> None:
    """Ask how many items the geofence has that is kept like a mission, not as parameters."""
    direct, system_id = MavlinkDirectAsync(vehicle.system), await vehicle.system.get_system_id()
    answer = asyncio.create_task(_fence_count(direct))
    await asyncio.sleep(0.0)  # listen first, then ask
    try:
        await _send_of_fence(direct, system_id, "MISSION_REQUEST_LIST", {})
        facts.fence_items = await answer
        if facts.fence_items is not None:  # else the vehicle waits to be asked for the first item
            await _send_of_fence(direct, system_id, "MISSION_ACK", {"type": _TRANSFER_CANCELLED})
    except MavsdkError:
        await answer


async def _fence_count(direct: MavlinkDirectAsync) -> int | None:
    async def counts() -> AsyncGenerator[int, None]:
        async with aclosing(direct.subscribe_message("MISSION_COUNT")) as messages:
            async for message in messages:
                fields = json.loads(message.fields_json)
                if fields.get("mission_type") == _FENCE:
                    yield int(fields["count"])

    return await _first(counts())


async def _send_of_fence(
    direct: MavlinkDirectAsync, system_id: int, name: str, fields: dict[str, int]
) -> None:
    addressed = {
        "target_system": system_id,
        "target_component": 1,
        "mission_type": _FENCE,
        **fields,
    }
    await direct.send_message(
        MavlinkMessage(
            name,
            target_system_id=system_id,
            target_component_id=1,
            fields_json=json.dumps(addressed),
        )
    )


async def _rate_asked(call: Any) -> None:
    """Ask for a message; an autopilot that refuses may send it all the same."""
    try:
        await call
    except MavsdkError:
        return


_QUESTIONS = {
    "firmware": _ask_version,
    "parameters": _ask_parameters,
    "battery": _ask_battery,
    "home": _ask_home,
    "geofence": _ask_fence,
}


async def _first(values: AsyncGenerator[Any, None]) -> Any | None:
    """Return the first value of a subscription, None if none comes in time."""
    async with aclosing(values):
        try:
            return await asyncio.wait_for(anext(values), ANSWER_TIMEOUT_S)
        except TimeoutError:
            return None


async def _count_messages(vehicle: Vehicle) -> dict[str, float]:
    direct = MavlinkDirectAsync(vehicle.system)
    counts = dict.fromkeys(_COUNTED, 0)

    async def count(name: str) -> None:
        async with aclosing(direct.subscribe_message(name)) as messages:
            async for _ in messages:
                counts[name] += 1

    await _rate_asked(TelemetryAsync(vehicle.system).set_rate_attitude_euler(10.0))
    tasks = [asyncio.create_task(count(name)) for name in _COUNTED]
    await asyncio.sleep(LISTEN_S)
    await _cancelled(tasks)
    return {name: count / LISTEN_S for name, count in counts.items()}


async def _cancelled(tasks: list[asyncio.Task[None]]) -> None:
    """Stop tasks that wait for a queue, never for a call into MAVSDK."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _ping(vehicle: Vehicle) -> float | None:
    """Exchange TIMESYNC; return the slowest round trip, None if one was not answered."""
    direct = MavlinkDirectAsync(vehicle.system)
    waiting: dict[int, asyncio.Future[int]] = {}

    async def listen() -> None:
        async with aclosing(direct.subscribe_message("TIMESYNC")) as messages:
            async for message in messages:
                fields = json.loads(message.fields_json)
                answered = waiting.pop(fields["ts1"], None) if fields["tc1"] != 0 else None
                if answered is not None:
                    answered.set_result(time.monotonic_ns())

    listener = asyncio.create_task(listen())
    await asyncio.sleep(0.0)
    try:
        trips_s = [await _round_trip(direct, waiting) for _ in range(PINGS)]
    except (MavsdkError, TimeoutError):
        return None
    finally:
        await _cancelled([listener])
    return max(trips_s)


async def _round_trip(direct: MavlinkDirectAsync, waiting: dict[int, asyncio.Future[int]]) -> float:
    sent_ns = time.monotonic_ns()
    waiting[sent_ns] = asyncio.get_running_loop().create_future()
    answered = waiting[sent_ns]
    fields = json.dumps({"tc1": 0, "ts1": sent_ns, "target_system": 0, "target_component": 0})
    await direct.send_message(
        MavlinkMessage("TIMESYNC", target_system_id=0, target_component_id=0, fields_json=fields)
    )
    return (await asyncio.wait_for(answered, ANSWER_TIMEOUT_S) - sent_ns) * 1e-9


# ---------------------------------------------------------------------- what it means


def judge(
    facts: VehicleFacts, assessment: Assessment, mission: Mission | None, endurance_s: float | None
) -> list[Finding]:
    """Hold what was learnt against a contract, and a mission where there is one.

    Args:
        facts: of the vehicle.
        assessment: the contract.
        mission: for battery, home, start and geofence.
        endurance_s: hover time of a full battery; needed where the vehicle reckons none.
    """
    terms = assessment.terms
    findings = [
        _health(facts),
        _version(facts),
        *(_rate(facts, name) for name in _COUNTED),
        _round_trip_finding(facts, terms.reaction_time_s),
    ]
    if facts.flavour is None:
        findings.append(_unknown("parameters", "neither PX4 nor ArduPilot: nobody knows its names"))
    else:
        findings += check_parameters(
            facts.flavour,
            facts.parameters,
            assessment,
            mission,
            complete=facts.parameters_complete,
        )
    if mission is not None:
        findings += [_home(facts), _start(facts, mission), _fence_polygons(facts)]
        findings.append(_battery(facts, flight_time_s(mission, assessment), endurance_s))
    return findings


def flight_time_s(mission: Mission, assessment: Assessment) -> float:
    """Return how long a mission takes, with take-off, landing and a reserve for avoidances."""
    points = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
    length_m = sum(math.dist(*leg) for leg in pairwise(points))
    return GROUND_TIME_S + TIME_RESERVE * length_m / assessment.terms.cruise_speed_mps


def _known(name: str, *, holds: bool, text: str) -> Finding:
    return Finding("vehicle", name, Verdict.of(holds=holds), text)


def _unknown(name: str, text: str) -> Finding:
    return Finding("vehicle", name, Verdict.UNKNOWN, text)


def _health(facts: VehicleFacts) -> Finding:
    text = facts.unhealthy or "sensors, estimator, position and home"
    failed = f"after {HEALTH_TIMEOUT_S:g} s not ready: {text}"
    return _known("health", holds=not facts.unhealthy, text=failed if facts.unhealthy else text)


def _version(facts: VehicleFacts) -> Finding:
    if facts.version is None or facts.flavour is None:
        return _unknown("firmware", "no version reported")
    oldest = OLDEST_VERSION[facts.flavour]
    found, needed = (".".join(map(str, each)) for each in (facts.version, oldest))
    text = f"{facts.flavour} {found}, needs {needed} or later"
    return _known("firmware", holds=facts.version >= oldest, text=text)


def _rate(facts: VehicleFacts, name: str) -> Finding:
    rate_hz = facts.rates_hz.get(name, 0.0)
    text = f"{rate_hz:.0f} Hz in {LISTEN_S:g} s on this link, needs {RATE_MIN_HZ:g} Hz"
    return _known(name, holds=rate_hz >= RATE_MIN_HZ, text=text)


def _round_trip_finding(facts: VehicleFacts, limit_s: float) -> Finding:
    if facts.round_trip_s is None:
        return _unknown("link delay", f"TIMESYNC not answered within {ANSWER_TIMEOUT_S:g} s")
    text = (
        f"round trip {facts.round_trip_s * 1e3:.0f} ms at most in {PINGS}, "
        f"reaction_time_s of the contract {limit_s * 1e3:.0f} ms"
    )
    return _known("link delay", holds=facts.round_trip_s <= limit_s, text=text)


def _home(facts: VehicleFacts) -> Finding:
    if facts.home_ned_m is None:
        return _unknown("home", f"no HOME_POSITION within {ANSWER_TIMEOUT_S:g} s")
    *_, down_m = facts.home_ned_m
    text = (
        f"{abs(down_m):.1f} m from the height of the local origin, which altitudes count from; "
        f"limit {START_TOLERANCE_M:g} m"
    )
    return _known("home", holds=abs(down_m) <= START_TOLERANCE_M, text=text)


def _start(facts: VehicleFacts, mission: Mission) -> Finding:
    if facts.position_ned_m is None:
        return _unknown("start", "no position reported")
    away_m = math.dist(facts.position_ned_m[:2], mission.start_ned_m)
    text = f"{away_m:.1f} m from the start of the mission, limit {START_TOLERANCE_M:g} m"
    return _known("start", holds=away_m <= START_TOLERANCE_M, text=text)


def _fence_polygons(facts: VehicleFacts) -> Finding:
    name = "geofence polygons"
    if facts.fence_items is None:
        return _unknown(name, f"no answer to what is on board within {ANSWER_TIMEOUT_S:g} s")
    if facts.fence_items:
        text = f"{facts.fence_items} items on board, which are not compared with the mission"
        return _unknown(name, text)
    return _known(name, holds=True, text="none on board")


def _battery(facts: VehicleFacts, needed_s: float, endurance_s: float | None) -> Finding:
    reckoned_s, share = facts.battery_time_s, facts.battery_share
    endured_s = None
    if share is not None and endurance_s is not None:
        endured_s = max(share - CHARGE_RESERVE, 0.0) * endurance_s
    # What a vehicle reckons with its motors off may be days: the shorter time counts.
    left_s = min((each for each in (reckoned_s, endured_s) if each is not None), default=None)
    if left_s is None:
        lacking = "charge" if share is None else "remaining time: give --endurance"
        return _unknown("battery", f"the vehicle reports no {lacking}")
    charge = "" if share is None else f"{100.0 * share:.0f} % charged, "
    text = f"{charge}{left_s:.0f} s of flight, mission needs {needed_s:.0f} s"
    return _known("battery", holds=left_s >= needed_s, text=text)
