"""Measures the link delay and the vehicle's clock by TIMESYNC, else by PING and SYSTEM_TIME.

PX4 before November 2025 answers TIMESYNC with an uninitialized target, and MAVSDK drops messages to
other targets.  The same firmware answers PING correctly, which carries no time, and SYSTEM_TIME
carries the time one way: together they bound the same quantities.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

from mavsdk.asyncio import MavsdkError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from gcs_tools.vehicle.query import listening, running

# How often clocks are compared, how long an answer may take, how long SYSTEM_TIME is collected.
PINGS: Final = 8
ANSWER_TIMEOUT_S: Final = 2.0
COLLECT_S: Final = 2.5
_SYSTEM_TIME_HZ: Final = 5.0
# SYSTEM_TIME.time_boot_ms is rounded down.
_RESOLUTION_S: Final = 1e-3
# A Unix time before this has not been set: without GPS, autopilots start at 1970.
_UNIX_TIME_MIN_S: Final = 1.5e9

Exchange = tuple[int, int, int]


@dataclass(frozen=True)
class ClockComparison:
    """Several exchanges with the vehicle.

    Attributes:
        round_trip_s: the slowest.
        unsteady_s: least step of the vehicle's clock that the link delay does not explain; None
            where it told no time.
        source: messages that this was measured by.
        unix_offset_s: the vehicle's Unix time less this computer's; None where it has none.
    """

    round_trip_s: float
    unsteady_s: float | None
    source: str = "TIMESYNC"
    unix_offset_s: float | None = None


@dataclass(frozen=True)
class SystemTime:
    """One SYSTEM_TIME.

    Attributes:
        arrived_s, arrived_unix_s: time of arrival, by this computer's clocks.
        boot_s, unix_s: its content; ``unix_s`` is 0 if the vehicle does not know it.
    """

    arrived_s: float
    arrived_unix_s: float
    boot_s: float
    unix_s: float


async def compare_vehicle_clock(system: Any) -> ClockComparison | None:
    """Measure link delay and clock; None if neither TIMESYNC nor PING was answered.

    Args:
        system: MAVSDK's system.
    """
    direct = MavlinkDirectAsync(system)
    times: list[SystemTime] = []
    with suppress(MavsdkError):  # the vehicle may stream it even if it refuses
        await TelemetryAsync(system).set_rate_unix_epoch_time(_SYSTEM_TIME_HZ)
    async with running(_collect_times(direct, times)):
        collected = asyncio.create_task(asyncio.sleep(COLLECT_S))
        exchanges = await _exchanges(direct, "TIMESYNC", _ask_timesync, _timesync_answer)
        pings = exchanges or await _exchanges(direct, "PING", _ask_ping, _ping_answer)
        await collected
    if exchanges:
        return replace(compare_clocks(exchanges), unix_offset_s=unix_offset_s(times))
    if not pings:
        return None
    round_trip_s = max((received - sent) * 1e-9 for sent, _, received in pings)
    return compare_one_way(round_trip_s, times)


def compare_clocks(exchanges: list[Exchange]) -> ClockComparison:
    """Evaluate several exchanges.

    Args:
        exchanges: sent by our clock, answered by the vehicle's, received by ours; each [ns].
    """
    # The vehicle answered at some instant between the two of ours.
    lowest_s = [(theirs - received) * 1e-9 for _, theirs, received in exchanges]
    highest_s = [(theirs - sent) * 1e-9 for sent, theirs, _ in exchanges]
    trips_s = [high_s - low_s for high_s, low_s in zip(highest_s, lowest_s, strict=True)]
    return ClockComparison(max(trips_s), max(max(lowest_s) - min(highest_s), 0.0))


def compare_one_way(round_trip_s: float, times: list[SystemTime]) -> ClockComparison:
    """Evaluate times that the vehicle streamed.

    Args:
        round_trip_s: the slowest, by PING.
        times: in order of arrival.
    """
    offsets_s = [each.boot_s - each.arrived_s for each in times]
    unsteady_s = None
    if len(offsets_s) > 1:
        allowed_s = round_trip_s + _RESOLUTION_S
        unsteady_s = max(max(offsets_s) - min(offsets_s) - allowed_s, 0.0)
    source = "PING" if unsteady_s is None else "PING and SYSTEM_TIME"
    return ClockComparison(round_trip_s, unsteady_s, source, unix_offset_s(times))


def unix_offset_s(times: list[SystemTime]) -> float | None:
    """Return the vehicle's Unix time less ours, from the message with the shortest transit."""
    known = [each for each in times if each.unix_s > _UNIX_TIME_MIN_S]
    return max((each.unix_s - each.arrived_unix_s for each in known), default=None)


async def _collect_times(direct: MavlinkDirectAsync, times: list[SystemTime]) -> None:
    async with listening(direct, "SYSTEM_TIME") as heard:
        while True:
            fields = json.loads((await heard.get()).fields_json)
            boot_s, unix_s = fields["time_boot_ms"] * 1e-3, fields["time_unix_usec"] * 1e-6
            times.append(SystemTime(time.monotonic(), time.time(), boot_s, unix_s))


async def _exchanges(
    direct: MavlinkDirectAsync,
    name: str,
    ask: Callable[[int, int], dict[str, int]],
    answered: Callable[[dict[str, int]], tuple[int, int] | None],
) -> list[Exchange]:
    """Return several exchanges; none if one answer did not come in time.

    Args:
        direct: of the vehicle.
        name: of the message.
        ask: returns its fields, from a number and our time [ns].
        answered: returns, from the fields of an answer, our time [ns] in the question and the
            vehicle's time [ns]; None if the message is not an answer.
    """
    found: list[Exchange] = []
    async with listening(direct, name) as heard:
        for number in range(PINGS):
            sent_ns = time.monotonic_ns() // 1000 * 1000
            fields = ask(number, sent_ns)
            message = MavlinkMessage(
                name,
                target_system_id=0,
                target_component_id=0,
                fields_json=json.dumps(fields | {"target_system": 0, "target_component": 0}),
            )
            try:
                await direct.send_message(message)
                async with asyncio.timeout(ANSWER_TIMEOUT_S):
                    theirs_ns = await _answer_to(sent_ns, heard, answered)
            except (MavsdkError, TimeoutError):
                return []
            found.append((sent_ns, theirs_ns, time.monotonic_ns()))
    return found


async def _answer_to(
    sent_ns: int,
    heard: asyncio.Queue[Any],
    answered: Callable[[dict[str, int]], tuple[int, int] | None],
) -> int:
    """Wait for the answer to the question of an instant; return the vehicle's time [ns]."""
    while True:
        answer = answered(json.loads((await heard.get()).fields_json))
        if answer is not None and answer[0] == sent_ns:
            return answer[1]


def _ask_timesync(_: int, now_ns: int) -> dict[str, int]:
    return {"tc1": 0, "ts1": now_ns}


def _timesync_answer(fields: dict[str, int]) -> tuple[int, int] | None:
    return None if fields["tc1"] == 0 else (fields["ts1"], fields["tc1"])


def _ask_ping(number: int, now_ns: int) -> dict[str, int]:
    return {"time_usec": now_ns // 1000, "seq": number}


def _ping_answer(fields: dict[str, int]) -> tuple[int, int] | None:
    return None if fields["target_system"] == 0 else (fields["time_usec"] * 1000, 0)
