"""Requests single messages from a vehicle: subscribes first, then asks, several times.

An autopilot on the same computer answers within a millisecond, so that a subscription made after
the request misses the answer; and a busy one may drop a request.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Coroutine
from contextlib import aclosing, asynccontextmanager, suppress
from typing import Any, Final

from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage

# How often a message is requested, and how long each answer may take: the slowest stream that this
# relies on (ESTIMATOR_STATUS of PX4 on a radio link) comes every 2 s.
TRIES: Final = 4
WAIT_S: Final = 0.75

_REQUEST_MESSAGE: Final = 512  # MAV_CMD
_AUTOPILOT: Final = 1  # MAV_COMP_ID


@asynccontextmanager
async def listening(direct: MavlinkDirectAsync, name: str) -> AsyncIterator[asyncio.Queue[Any]]:
    """Collect the autopilot's messages of one name for the duration of the context.

    Those of companions of the same system are ignored.
    """
    heard: asyncio.Queue[Any] = asyncio.Queue()

    async def take() -> None:
        async with aclosing(direct.subscribe_message(name)) as messages:
            async for message in messages:
                if message.component_id == _AUTOPILOT:
                    heard.put_nowait(message)

    async with running(take()):
        yield heard


@asynccontextmanager
async def running(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Run a task during the context; it may wait for queues, never for a call into MAVSDK."""
    task = asyncio.create_task(work)
    await asyncio.sleep(0.0)  # the task runs up to its first wait
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def answer(
    direct: MavlinkDirectAsync, system_id: int, message_id: int, name: str
) -> dict[str, Any] | None:
    """Request one message, up to `TRIES` times; return its fields, None without an answer.

    Args:
        direct: of the vehicle.
        system_id: of the vehicle.
        message_id: number of the message.
        name: of the same message.
    """
    parameters = dict.fromkeys((f"param{number}" for number in range(2, 8)), 0.0)
    asked = {"command": _REQUEST_MESSAGE, "confirmation": 0, "param1": message_id, **parameters}
    async with listening(direct, name) as heard:
        for _ in range(TRIES):
            with suppress(MavsdkError):  # the vehicle may stream it even if it refuses
                await send(direct, system_id, "COMMAND_LONG", asked)
            with suppress(TimeoutError):
                message = await asyncio.wait_for(heard.get(), WAIT_S)
                fields: dict[str, Any] = json.loads(message.fields_json)
                return fields
    return None


async def send(
    direct: MavlinkDirectAsync, system_id: int, name: str, fields: dict[str, Any]
) -> None:
    """Send a message to the autopilot.

    Raises:
        MavsdkError: it cannot be sent.
    """
    addressed = {"target_system": system_id, "target_component": _AUTOPILOT, **fields}
    await direct.send_message(
        MavlinkMessage(
            name,
            target_system_id=system_id,
            target_component_id=_AUTOPILOT,
            fields_json=json.dumps(addressed),
        )
    )
