"""What MAVSDK can learn of a live vehicle.

Every question has a time limit, and none is abandoned half-way, since MAVSDK hangs when it is
closed while one of its calls is in flight.  A question without an answer leaves its fact unknown.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import aclosing, suppress
from dataclasses import dataclass, field
from typing import Any

from mavsdk.asyncio import Autopilot, MavsdkError
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from gcs_tools.geofence import FenceItem, GeographicOrigin
from gcs_tools.vehicle import Vehicle, VehicleError

FLAVOURS: Mapping[Autopilot, str] = {Autopilot.PX4: "px4", Autopilot.ARDUPILOT: "ardupilot"}
# How long telemetry is counted, how often clocks are compared, how long an answer may take.
LISTEN_S = 2.0
PINGS = 8
ANSWER_TIMEOUT_S = 2.0
COUNTED = ("ATTITUDE", "LOCAL_POSITION_NED")

# ESTIMATOR_STATUS and EKF_STATUS_REPORT: number, and the fields of its test ratios.
_ESTIMATOR = {
    "px4": (230, "ESTIMATOR_STATUS", ("vel_ratio", "pos_horiz_ratio", "mag_ratio")),
    "ardupilot": (
        193,
        "EKF_STATUS_REPORT",
        ("velocity_variance", "pos_horiz_variance", "compass_variance"),
    ),
}
_REQUEST_MESSAGE = 512  # MAV_CMD


@dataclass(frozen=True)
class EstimatorStatus:
    """The estimator's own judgement.

    Attributes:
        flags: ESTIMATOR_STATUS_FLAGS of PX4, EKF_STATUS_FLAGS of ArduPilot.
        worst_ratio: of the innovations of velocity, position and heading to where they are
            rejected; NaN if it gives none.
    """

    flags: int
    worst_ratio: float


@dataclass(frozen=True)
class ClockComparison:
    """Several exchanges of TIMESYNC.

    Attributes:
        round_trip_s: the slowest.
        offset_s: the vehicle's clock less ours, from the quickest exchange; counted from any zero.
        unsteady_s: by how much the offset changed for certain, round trips allowed for.
    """

    round_trip_s: float
    offset_s: float
    unsteady_s: float


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
        estimator: what its estimator says of itself.
        clock: how TIMESYNC compares the vehicle's clock with ours.
        home_ned_m: home in the local frame.
        origin: of the local frame on the Earth.
        position_ned_m: where the vehicle stands.
        battery_share: remaining charge, 0 to 1.
        battery_time_s: remaining time, as the vehicle reckons.
        fence: corners, circles and return points of the geofence on board that is kept like a
            mission, not as parameters.
    """

    flavour: str | None
    version: tuple[int, int, int] | None = None
    unhealthy: str = ""
    parameters: dict[str, float] = field(default_factory=dict)
    parameters_complete: bool = False
    rates_hz: dict[str, float] = field(default_factory=dict)
    estimator: EstimatorStatus | None = None
    clock: ClockComparison | None = None
    home_ned_m: tuple[float, float, float] | None = None
    origin: GeographicOrigin | None = None
    position_ned_m: tuple[float, float, float] | None = None
    battery_share: float | None = None
    battery_time_s: float | None = None
    fence: tuple[FenceItem, ...] | None = None


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
    facts.clock = await _compare_clocks(vehicle)
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
        latitude_deg, longitude_deg = fields["latitude"] * 1e-7, fields["longitude"] * 1e-7
        facts.origin = GeographicOrigin.of_home(latitude_deg, longitude_deg, facts.home_ned_m)


async def _ask_estimator(vehicle: Vehicle, facts: VehicleFacts) -> None:
    if facts.flavour is None:
        return
    message_id, name, ratios = _ESTIMATOR[facts.flavour]
    direct = MavlinkDirectAsync(vehicle.system)
    answer = asyncio.create_task(_first(direct.subscribe_message(name)))
    await asyncio.sleep(0.0)  # listen first, then ask
    parameters = dict.fromkeys((f"param{number}" for number in range(2, 8)), 0.0)
    asked = {"command": _REQUEST_MESSAGE, "confirmation": 0, "param1": message_id, **parameters}
    with suppress(MavsdkError):  # it may be streamed all the same
        await _send(direct, await vehicle.system.get_system_id(), "COMMAND_LONG", asked)
    message = await answer
    if message is not None:
        fields = json.loads(message.fields_json)
        # What is not finite is not in the JSON as a number.
        values = [float(fields[each]) for each in ratios if isinstance(fields[each], int | float)]
        facts.estimator = EstimatorStatus(int(fields["flags"]), max(values, default=math.nan))


async def _ask_fence(vehicle: Vehicle, facts: VehicleFacts) -> None:
    try:
        items = await MissionRawAsync(vehicle.system).download_geofence()
    except MavsdkError:
        return
    facts.fence = tuple(
        FenceItem(each.command, each.param1, each.x * 1e-7, each.y * 1e-7) for each in items
    )


async def _send(
    direct: MavlinkDirectAsync, system_id: int, name: str, fields: dict[str, Any]
) -> None:
    addressed = {"target_system": system_id, "target_component": 1, **fields}
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
    "estimator": _ask_estimator,
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
    counts = dict.fromkeys(COUNTED, 0)

    async def count(name: str) -> None:
        async with aclosing(direct.subscribe_message(name)) as messages:
            async for _ in messages:
                counts[name] += 1

    await _rate_asked(TelemetryAsync(vehicle.system).set_rate_attitude_euler(10.0))
    tasks = [asyncio.create_task(count(name)) for name in COUNTED]
    await asyncio.sleep(LISTEN_S)
    await _cancelled(tasks)
    return {name: count / LISTEN_S for name, count in counts.items()}


async def _cancelled(tasks: list[asyncio.Task[None]]) -> None:
    """Stop tasks that wait for a queue, never for a call into MAVSDK."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _compare_clocks(vehicle: Vehicle) -> ClockComparison | None:
    """Exchange TIMESYNC several times; return None if one was not answered."""
    direct = MavlinkDirectAsync(vehicle.system)
    waiting: dict[int, asyncio.Future[tuple[int, int]]] = {}

    async def listen() -> None:
        async with aclosing(direct.subscribe_message("TIMESYNC")) as messages:
            async for message in messages:
                fields = json.loads(message.fields_json)
                answered = waiting.pop(fields["ts1"], None) if fields["tc1"] != 0 else None
                if answered is not None:
                    answered.set_result((time.monotonic_ns(), int(fields["tc1"])))

    listener = asyncio.create_task(listen())
    await asyncio.sleep(0.0)
    try:
        return compare_clocks([await _exchange(direct, waiting) for _ in range(PINGS)])
    except (MavsdkError, TimeoutError):
        return None
    finally:
        await _cancelled([listener])


async def _exchange(
    direct: MavlinkDirectAsync, waiting: dict[int, asyncio.Future[tuple[int, int]]]
) -> tuple[int, int, int]:
    sent_ns = time.monotonic_ns()
    waiting[sent_ns] = asyncio.get_running_loop().create_future()
    answered = waiting[sent_ns]
    fields = json.dumps({"tc1": 0, "ts1": sent_ns, "target_system": 0, "target_component": 0})
    await direct.send_message(
        MavlinkMessage("TIMESYNC", target_system_id=0, target_component_id=0, fields_json=fields)
    )
    received_ns, theirs_ns = await asyncio.wait_for(answered, ANSWER_TIMEOUT_S)
    return sent_ns, theirs_ns, received_ns


def compare_clocks(exchanges: list[tuple[int, int, int]]) -> ClockComparison:
    """Reckon with several exchanges.

    Args:
        exchanges: sent by our clock, answered by the vehicle's, received by ours; each [ns].
    """
    # The vehicle answered at some instant between the two of ours.
    lowest_s = [(theirs - received) * 1e-9 for _, theirs, received in exchanges]
    highest_s = [(theirs - sent) * 1e-9 for sent, theirs, _ in exchanges]
    trips_s = [high_s - low_s for high_s, low_s in zip(highest_s, lowest_s, strict=True)]
    quickest = trips_s.index(min(trips_s))
    return ClockComparison(
        round_trip_s=max(trips_s),
        offset_s=(lowest_s[quickest] + highest_s[quickest]) / 2.0,
        unsteady_s=max(max(lowest_s) - min(highest_s), 0.0),
    )
