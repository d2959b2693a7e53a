"""A scripted autopilot on UDP, for what the bundled simulation does too well."""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, Self

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

# What PX4 of February 2025 leaves in the target of its TIMESYNC answers.
UNINITIALISED: Final = 83

Behaviour = Callable[["FakeAutopilot", Any], None]


class FakeAutopilot:
    """One MAVLink system that says little of its own.

    Args:
        port: of the operator, on this computer.
        system_id: of its messages.
        kind: MAV_AUTOPILOT.
        component_id: of its messages.
        behaviour: what it does, by the name of the message that it receives.
        stream: called 20 times a second.
    """

    def __init__(
        self,
        port: int,
        system_id: int = 1,
        kind: int = mavlink.MAV_AUTOPILOT_PX4,
        component_id: int = 1,
        behaviour: dict[str, Behaviour] | None = None,
        stream: Callable[[FakeAutopilot], None] | None = None,
    ) -> None:
        self.kind = kind
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=system_id, source_component=component_id
        )
        self.started_s = time.monotonic()
        self._behaviour, self._stream = behaviour or {}, stream or says_nothing
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self.link.close()

    @property
    def boot_ms(self) -> int:
        """Time since its start."""
        return round((time.monotonic() - self.started_s) * 1e3)

    def _run(self) -> None:
        heartbeat_s = stream_s = 0.0
        while not self._stop.is_set():
            now_s = time.monotonic()
            if now_s >= heartbeat_s:
                heartbeat_s = now_s + 0.5
                kind = mavlink.MAV_TYPE_QUADROTOR
                self.link.mav.heartbeat_send(kind, self.kind, 0, 0, mavlink.MAV_STATE_STANDBY)
            if now_s >= stream_s:
                stream_s = now_s + 0.05
                self._stream(self)
            with contextlib.suppress(ConnectionRefusedError):  # the operator listens later
                message = self.link.recv_match(blocking=True, timeout=0.005)
                if message is not None:
                    self._receive(message)

    def _receive(self, message: Any) -> None:
        kind = message.get_type()
        rate = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        if kind == "COMMAND_LONG" and message.command == rate:
            self.link.mav.command_ack_send(rate, mavlink.MAV_RESULT_ACCEPTED)
        if kind in self._behaviour:
            self._behaviour[kind](self, message)


@contextmanager
def autopilots(*each: FakeAutopilot) -> Iterator[None]:
    """Run several at once."""
    with contextlib.ExitStack() as stack:
        for autopilot in each:
            stack.enter_context(autopilot)
        yield


def says_nothing(_: FakeAutopilot) -> None:
    """Stream nothing."""


def answers_ping(autopilot: FakeAutopilot, message: Any) -> None:
    """Answer a request as every autopilot does: to the one that asks."""
    if message.target_system == 0:
        asker = message.get_srcSystem(), message.get_srcComponent()
        autopilot.link.mav.ping_send(message.time_usec, message.seq, *asker)


def answers_timesync(autopilot: FakeAutopilot, message: Any) -> None:
    """Answer to the one that asks."""
    _answer_timesync(autopilot, message, message.get_srcSystem(), message.get_srcComponent())


def misaddresses_timesync(autopilot: FakeAutopilot, message: Any) -> None:
    """Answer as PX4 did until November 2025: to a system that is not there."""
    _answer_timesync(autopilot, message, UNINITIALISED, UNINITIALISED)


def _answer_timesync(
    autopilot: FakeAutopilot, message: Any, target_system: int, target_component: int
) -> None:
    """Send the message with its target, which pymavlink's own does not have."""
    if message.tc1 != 0:
        return
    sender = autopilot.link.mav
    times_ns = autopilot.boot_ms * 1_000_000, message.ts1
    payload = struct.pack("<qqBB", *times_ns, target_system, target_component)
    answer = mavlink.MAVLink_timesync_message(*times_ns)
    autopilot.link.write(answer._pack(sender, answer.crc_extra, payload))
    sender.seq = (sender.seq + 1) % 256


def tells_time(unix_ahead_s: float) -> Callable[[FakeAutopilot], None]:
    """Stream SYSTEM_TIME of a vehicle whose Unix time is ahead of this computer's."""

    def stream(autopilot: FakeAutopilot) -> None:
        unix_us = round((time.time() + unix_ahead_s) * 1e6)
        autopilot.link.mav.system_time_send(unix_us, autopilot.boot_ms)

    return stream


def answers_request(number: int, reply: Callable[[FakeAutopilot], None], dropped: int) -> Behaviour:
    """Answer MAV_CMD_REQUEST_MESSAGE at once, but for the first few requests.

    Args:
        number: of the message.
        reply: sends it.
        dropped: how many requests it ignores.
    """
    left = [dropped]

    def answer(autopilot: FakeAutopilot, message: Any) -> None:
        if (message.command, message.param1) != (mavlink.MAV_CMD_REQUEST_MESSAGE, number):
            return
        if left[0]:
            left[0] -= 1
            return
        reply(autopilot)
        autopilot.link.mav.command_ack_send(message.command, mavlink.MAV_RESULT_ACCEPTED)

    return answer
