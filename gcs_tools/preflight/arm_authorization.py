"""Answers a vehicle that asks whether it may arm, by the verdict of the pre-flight check.

The protocol is MAVLink's arm authorization, which of the known autopilots only PX4 has; there it
needs COM_ARM_AUTH_REQ 1 and COM_ARM_AUTH_ID `AUTHORIZER_SYSTEM_ID`.  The vehicle does not arm
without an answer, so that it stays disarmed too once this process has ended.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import aclosing
from typing import Any, Final

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkError
from mavsdk.asyncio.plugins.arm_authorizer_server import ArmAuthorizerServerAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.plugins.arm_authorizer_server import RejectionReason

from gcs_tools.console.interruption import Interruption, interruptible
from gcs_tools.preflight.finding import Verdict
from gcs_tools.vehicle.connection import CONNECT_TIMEOUT_S, chosen_system, open_connection, quiet
from gcs_tools.vehicle.operator import VehicleError
from gcs_tools.vehicle.query import listening
from gcs_tools.vehicle.signing_relay import signing_relay

# System id of MAVSDK as a ground station.
AUTHORIZER_SYSTEM_ID: Final = 245
# MAV_COMP_ID_ONBOARD_COMPUTER, to which the vehicle sends its request.
_COMPONENT_ID: Final = 191
# PX4 misses an answer that comes at once (measured), and gives up after 0.4 s by default.
_THINKING_S: Final = 0.05
# How long a permission holds: a second attempt to arm, but no other flight.
_VALID_S: Final = 5
_POLL_S: Final = 0.2
_REQUEST: Final = 3001  # MAV_CMD_ARM_AUTHORIZATION_REQUEST


def answer_arm_requests(
    url: str,
    verdict: Verdict,
    duration_s: float,
    report: Callable[[str], None],
    *,
    system_id: int | None = None,
    mavlink_key: bytes | None = None,
) -> int:
    """Answer every request for a while; return the number of requests.

    Only the vehicle that was checked may arm; a request of any other is denied.

    Args:
        url: MAVSDK connection URL of the vehicle.
        verdict: of the pre-flight check; only `Verdict.HOLDS` permits arming.
        duration_s: how long the verdict is good for.
        report: called with every answer.
        system_id: of the vehicle that was checked; None if there is only one.
        mavlink_key: of a vehicle that signs its messages; None of one that does not.

    Raises:
        UrlError: the URL cannot be opened.
        VehicleError: no autopilot was heard in time, or an answer could not be sent.
        AmbiguousVehicleError: several autopilots were heard, and none was chosen.
    """
    try:
        return asyncio.run(_answer(url, verdict, duration_s, report, system_id, mavlink_key))
    except MavsdkError as error:
        raise VehicleError(f"arm authorization: {error}") from error


async def _answer(
    url: str,
    verdict: Verdict,
    duration_s: float,
    report: Callable[[str], None],
    system_id: int | None,
    mavlink_key: bytes | None,
) -> int:
    identity = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    identity.system_id = AUTHORIZER_SYSTEM_ID
    with interruptible() as interruption:
        async with (
            signing_relay(url, mavlink_key, system_id) as relay,
            quiet() as complaints,
            Mavsdk(identity) as mavsdk,
        ):
            server = ArmAuthorizerServerAsync(await mavsdk.server_component_by_id(_COMPONENT_ID))
            await open_connection(mavsdk, relay.url, complaints)
            checked, _ = await chosen_system(
                mavsdk, url, system_id, CONNECT_TIMEOUT_S, interruption.check
            )
            async with listening(MavlinkDirectAsync(checked), "COMMAND_LONG") as commands:
                report(f"answering arm requests for {duration_s:g} s: {verdict.value}")
                return await _answer_until(
                    asyncio.get_running_loop().time() + duration_s,
                    server,
                    lambda: verdict if _has_asked(commands) else Verdict.UNKNOWN,
                    interruption,
                    report,
                )


def _has_asked(commands: asyncio.Queue[Any]) -> bool:
    """Tell whether the vehicle has sent a request since the last call; requests name no sender."""
    asked = False
    while not commands.empty():
        asked |= json.loads(commands.get_nowait().fields_json)["command"] == _REQUEST
    return asked


async def _answer_until(
    until_s: float,
    server: ArmAuthorizerServerAsync,
    verdict_on: Callable[[], Verdict],
    interruption: Interruption,
    report: Callable[[str], None],
) -> int:
    count, loop = 0, asyncio.get_running_loop()
    async with aclosing(server.subscribe_arm_authorization()) as requests:
        following = asyncio.ensure_future(anext(requests))
        while loop.time() < until_s and not interruption.requested:
            if not (await asyncio.wait({following}, timeout=_POLL_S))[0]:
                continue
            following = asyncio.ensure_future(anext(requests))
            await asyncio.sleep(_THINKING_S)
            verdict = verdict_on()
            await _decide(server, verdict)
            count += 1
            report("arming permitted" if verdict is Verdict.HOLDS else "arming denied")
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
    return count


async def _decide(server: ArmAuthorizerServerAsync, verdict: Verdict) -> None:
    if verdict is Verdict.HOLDS:
        await server.accept_arm_authorization(_VALID_S)
        return
    await server.reject_arm_authorization(
        temporarily=False, reason=RejectionReason.GENERIC, extra_info=0
    )
