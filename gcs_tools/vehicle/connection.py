"""Opens MAVSDK connections, and finds the one autopilot on them."""

from __future__ import annotations

import asyncio
import json
import logging
import math
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing, asynccontextmanager
from typing import Any

from mavsdk import LogLevel, log_subscribe, log_unsubscribe
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync

from gcs_tools.console.errors import CommandError
from gcs_tools.console.interruption import Interruption
from gcs_tools.vehicle.operator import UrlError, Vehicle, VehicleError
from gcs_tools.vehicle.signing_relay import Relay, signing_relay
from onboard.mavlink.profiles.profile import AutopilotProfile
from onboard.mavlink.profiles.registry import OTHER, profile_of

log = logging.getLogger("mavsdk")

CONNECT_TIMEOUT_S = 20.0
# A vehicle of which every message is refused for so long has another key, or none.
REFUSED_TIMEOUT_S = 5.0
# How long another autopilot may take to be heard too; heartbeats come every second.
COMPANY_S = 1.5
IDENTIFY_TIMEOUT_S = 3.0

_POLL_S = 0.05
_AUTOPILOT_COMPONENT = 1
# MAVSDK's messages go to the log, not to the operator; its last error explains what went wrong.
_LOG_LEVELS = (logging.DEBUG, logging.DEBUG, logging.INFO, logging.INFO)
_URLS = "udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial://DEVICE:BAUD"


class AmbiguousVehicleError(CommandError):
    """Several vehicles are on one connection, and none was chosen."""


@asynccontextmanager
async def connected_vehicle(
    url: str,
    interruption: Interruption,
    timeout_s: float = CONNECT_TIMEOUT_S,
    while_waiting: Callable[[], None] = lambda: None,
    system_id: int | None = None,
    mavlink_key: bytes | None = None,
) -> AsyncIterator[Vehicle]:
    """Connect to the autopilot on a MAVSDK URL, and keep its state up to date.

    Args:
        url: of the connection.
        interruption: set by an operator who gives up.
        timeout_s: how long to wait for an autopilot.
        while_waiting: called repeatedly until one is heard; may raise.
        system_id: of the autopilot; None if there is only one.
        mavlink_key: of a vehicle that signs its messages; None of one that does not.

    Raises:
        UrlError: the URL cannot be opened.
        VehicleError: no autopilot, or not this one, was heard in time.
        AmbiguousVehicleError: several autopilots were heard, and none was chosen.
        Interrupted: the operator gave up.
    """
    identity = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with (
        signing_relay(url, mavlink_key, system_id) as relay,
        quiet() as complaints,
        Mavsdk(identity) as mavsdk,
    ):
        await open_connection(mavsdk, relay.url, complaints)

        waiting = _all_of(interruption.check, while_waiting, _all_refused(relay, url))

        try:
            system, number = await chosen_system(mavsdk, url, system_id, timeout_s, waiting)
        except VehicleError as error:
            reasons = [str(error), *complaints[-1:], *relay.complaints]
            raise VehicleError("; ".join(reasons)) from error
        vehicle = Vehicle(system, number, await _profile_of(system), interruption)
        async with _watched(vehicle):
            yield vehicle


def _all_of(*checks: Callable[[], None]) -> Callable[[], None]:
    def check_all() -> None:
        for check in checks:
            check()

    return check_all


def _all_refused(relay: Relay, url: str) -> Callable[[], None]:
    """Return what raises once a vehicle has been heard for some time, and none of it was genuine.

    It raises `VehicleError`.
    """
    loop = asyncio.get_running_loop()
    patient_until_s = loop.time() + REFUSED_TIMEOUT_S

    def check() -> None:
        if relay.refuses_all and loop.time() >= patient_until_s:
            text = "the vehicle's messages are refused: is this the vehicle's key?"
            raise VehicleError(f"{url}: {text}")

    return check


@asynccontextmanager
async def _watched(vehicle: Vehicle) -> AsyncIterator[None]:
    """Keep a vehicle's state up to date during the context."""
    tasks = [asyncio.ensure_future(watcher) for watcher in vehicle.watchers()]
    try:
        await vehicle.request_rates()
        yield
    finally:
        # These wait for a queue, never for a call into MAVSDK, so they may be cancelled.
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def open_connection(mavsdk: Mavsdk, url: str, complaints: list[str]) -> None:
    """Open a connection.

    Args:
        mavsdk: to connect.
        url: of the connection.
        complaints: errors that MAVSDK has logged so far, from `quiet`.

    Raises:
        UrlError: it cannot be opened.
    """
    try:
        await mavsdk.add_any_connection(url)
    except MavsdkError as error:
        reason = (complaints or [str(error)])[-1]
        raise UrlError(f"{url!r} cannot be opened: {reason}; expected {_URLS}") from error


async def chosen_system(
    mavsdk: Mavsdk,
    url: str,
    system_id: int | None,
    timeout_s: float,
    waiting: Callable[[], None],
) -> tuple[Any, int]:
    """Wait for the one autopilot, or for the one of a system id; return it and its id.

    Raises:
        VehicleError: no autopilot, or not this one, was heard in time.
        AmbiguousVehicleError: several autopilots were heard, and none was chosen.
    """
    loop = asyncio.get_running_loop()
    deadline_s, settled_s = loop.time() + timeout_s, math.inf
    while True:
        systems = {await each.get_system_id(): each for each in await mavsdk.get_systems()}
        autopilots = {n: each for n, each in systems.items() if await each.has_autopilot()}
        if system_id is not None and system_id in autopilots:
            return autopilots[system_id], system_id
        if system_id is None and autopilots:
            settled_s = min(settled_s, loop.time() + COMPANY_S)
        if loop.time() >= settled_s:
            if len(autopilots) > 1:
                found = ", ".join(map(str, sorted(autopilots)))
                text = f"{url}: autopilots of system ids {found}: choose one by --system-id"
                raise AmbiguousVehicleError(text)
            ((number, system),) = autopilots.items()
            return system, number
        waiting()
        if loop.time() >= deadline_s and not math.isfinite(settled_s):
            raise VehicleError(_not_heard(url, system_id, timeout_s, sorted(systems)))
        await asyncio.sleep(_POLL_S)


def _not_heard(url: str, system_id: int | None, timeout_s: float, others: list[int]) -> str:
    wanted = "autopilot" if system_id is None else f"autopilot of system id {system_id}"
    heard = f", only system ids {', '.join(map(str, others))}" if others else ""
    return f"{url}: no {wanted} heard in {timeout_s:g} s{heard}"


async def _profile_of(system: Any) -> AutopilotProfile:
    """Return the profile of the autopilot, by its own heartbeat.

    MAVSDK goes by the first heartbeat of the system, which may be the daemon's.
    """
    heartbeats = MavlinkDirectAsync(system).subscribe_message("HEARTBEAT")
    try:
        async with aclosing(heartbeats), asyncio.timeout(IDENTIFY_TIMEOUT_S):
            async for message in heartbeats:
                if message.component_id == _AUTOPILOT_COMPONENT:
                    return profile_of(json.loads(message.fields_json).get("autopilot"))
    except TimeoutError:
        log.debug("no heartbeat of an autopilot in %g s", IDENTIFY_TIMEOUT_S)
    return OTHER


@asynccontextmanager
async def quiet() -> AsyncIterator[list[str]]:
    """Send MAVSDK's output to the ``mavsdk`` logger, not the terminal; collect its errors."""
    complaints: list[str] = []

    def receive(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
        log.log(_LOG_LEVELS[level], message)
        if level == LogLevel.ERROR:
            complaints.append(message)
        return True

    log_subscribe(receive)
    try:
        yield complaints
    finally:
        log_unsubscribe()
