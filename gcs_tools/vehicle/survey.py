"""Asks a live vehicle, over MAVSDK, for everything that the pre-flight check needs to know.

Every question has a time limit, and each call is awaited to its end, since MAVSDK hangs when it is
closed while one of its calls is in flight.  A question without an answer leaves its fact unknown.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncGenerator, Callable
from contextlib import AsyncExitStack, aclosing
from dataclasses import dataclass, field
from typing import Any

from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import LandedState, TelemetryAsync

from gcs_tools.vehicle.clock import ANSWER_TIMEOUT_S, ClockComparison, compare_vehicle_clock
from gcs_tools.vehicle.geofence import GeographicOrigin
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from gcs_tools.vehicle.query import answer, listening
from onboard.mavlink.profiles.profile import AutopilotProfile
from onboard.mission_items.fence_items import FenceItem

# How long telemetry is counted.
LISTEN_S = 2.0
COUNTED = ("ATTITUDE", "LOCAL_POSITION_NED")

_SYS_STATUS, _AUTOPILOT_VERSION, _HOME_POSITION = 1, 148, 242
_RADIO_RECEIVER = 65536  # MAV_SYS_STATUS_SENSOR
# FIRMWARE_VERSION_TYPE, from which on.
_STAGES = ((255, ""), (192, "rc"), (128, "beta"), (64, "alpha"))


@dataclass(frozen=True)
class EstimatorStatus:
    """How the estimator rates itself.

    Attributes:
        flags: of the message that the profile names.
        worst_ratio: of the innovations of velocity, position and heading to where they are
            rejected; NaN if it reports none.
    """

    flags: int
    worst_ratio: float


@dataclass
class VehicleFacts:
    """What was learnt of a vehicle; None where it did not answer.

    Attributes:
        profile: of its autopilot.
        system_id: of its MAVLink messages.
        version: of the firmware.
        stage: of its development: ``dev``, ``alpha``, ``beta``, ``rc``; empty for a release.
        unhealthy: what is not healthy; empty if everything is.
        parameters: by name.
        parameters_complete: whether they are all that the vehicle has.
        rates_hz: of the messages that the service needs, on this link.
        estimator: how its estimator rates itself.
        on_ground: whether it says that it stands on the ground.
        radio_heard: whether it hears the pilot's radio.
        clock: how the vehicle's clock compares with ours, and how long the link takes.
        home_ned_m: home in the local frame.
        origin: of the local frame on the Earth.
        position_ned_m: where the vehicle stands.
        battery_share: remaining charge, 0 to 1.
        battery_time_s: remaining time, as the vehicle estimates it.
        fence: corners, circles and return points of the geofence on board that is kept like a
            mission, not as parameters.
    """

    profile: AutopilotProfile
    system_id: int = 1
    version: tuple[int, int, int] | None = None
    stage: str = ""
    unhealthy: str = ""
    parameters: dict[str, float] = field(default_factory=dict)
    parameters_complete: bool = False
    rates_hz: dict[str, float] = field(default_factory=dict)
    estimator: EstimatorStatus | None = None
    on_ground: bool = False
    radio_heard: bool | None = None
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
        report: called before each step.

    Raises:
        Interrupted: the operator gave up.
    """
    facts = VehicleFacts(vehicle.profile, vehicle.system_id)
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
    facts.clock = await compare_vehicle_clock(vehicle.system)
    facts.on_ground = vehicle.state.landed is LandedState.ON_GROUND
    # Last: by now it has been streamed for a while.
    if all(map(math.isfinite, vehicle.state.position_ned_m)):
        facts.position_ned_m = vehicle.state.position_ned_m
    return facts


async def _ask_version(vehicle: Vehicle, facts: VehicleFacts) -> None:
    fields = await _answer(vehicle, _AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
    if fields is not None:
        facts.version, facts.stage = version_of(int(fields["flight_sw_version"]))


def version_of(flight_sw_version: int) -> tuple[tuple[int, int, int] | None, str]:
    """Return version and stage of development from AUTOPILOT_VERSION.flight_sw_version."""
    major, minor, patch, kind = flight_sw_version.to_bytes(4, "big")
    if not any((major, minor, patch)):
        return None, ""
    stage = next((name for least, name in _STAGES if kind >= least), "dev")
    return (major, minor, patch), stage


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
    fields = await _answer(vehicle, _HOME_POSITION, "HOME_POSITION")
    if fields is not None:
        facts.home_ned_m = (fields["x"], fields["y"], fields["z"])
        latitude_deg, longitude_deg = fields["latitude"] * 1e-7, fields["longitude"] * 1e-7
        facts.origin = GeographicOrigin.of_home(latitude_deg, longitude_deg, facts.home_ned_m)


async def _ask_estimator(vehicle: Vehicle, facts: VehicleFacts) -> None:
    message = facts.profile.estimator.message
    fields = await _answer(vehicle, message.message_id, message.name)
    if fields is not None:
        ratios = (message.velocity, message.position, message.heading)
        # What is not finite is not a number in the JSON.
        values = [float(fields[each]) for each in ratios if isinstance(fields[each], int | float)]
        facts.estimator = EstimatorStatus(int(fields["flags"]), max(values, default=math.nan))


async def _ask_radio(vehicle: Vehicle, facts: VehicleFacts) -> None:
    fields = await _answer(vehicle, _SYS_STATUS, "SYS_STATUS")
    if fields is not None:
        states = ("present", "enabled", "health")
        masks = (int(fields[f"onboard_control_sensors_{state}"]) for state in states)
        facts.radio_heard = all(mask & _RADIO_RECEIVER for mask in masks)


async def _answer(vehicle: Vehicle, message_id: int, name: str) -> dict[str, Any] | None:
    direct = MavlinkDirectAsync(vehicle.system)
    return await answer(direct, vehicle.system_id, message_id, name)


async def _ask_fence(vehicle: Vehicle, facts: VehicleFacts) -> None:
    try:
        items = await MissionRawAsync(vehicle.system).download_geofence()
    except MavsdkError:
        return
    facts.fence = tuple(
        FenceItem(each.command, each.param1, each.x * 1e-7, each.y * 1e-7) for each in items
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
    "radio": _ask_radio,
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
    await _rate_asked(TelemetryAsync(vehicle.system).set_rate_attitude_euler(10.0))
    async with AsyncExitStack() as stack:
        inboxes = {
            name: await stack.enter_async_context(listening(direct, name)) for name in COUNTED
        }
        await asyncio.sleep(LISTEN_S)
        return {name: heard.qsize() / LISTEN_S for name, heard in inboxes.items()}
