"""The daemon: the only onboard part with sockets, threads, a clock and a Zenoh session.

It feeds `onboard.autonomy` with what arrives, ticks it at 50 Hz, and carries out what it says.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import zenoh

from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.models import Contract, DaemonConfig, Mission
from onboard.mavlink.connections import Link, open_link
from onboard.recording.event_log import EventLog
from onboard.recording.flight_logs import Logs
from onboard.recording.journal import Journal
from onboard.recording.record import Record
from onboard.timing import Clock
from onboard.zenoh_session import open_session

log = logging.getLogger(__name__)

STATUS_PERIOD_S: Final = 0.2
# What lasts is said again this often, for those who have joined since.
REPEAT_PERIOD_S: Final = 1.0
# A tick this late means that the computer cannot keep up, or was suspended.
LATE_TICK_S: Final = 2.0 * TICK_S
# The lowest there is: ahead of everything that asks for nothing, behind the kernel's own threads.
REALTIME_PRIORITY: Final = 1
# Key on Zenoh by topic of the journal.
_KEYS: Final = {
    "state": "status",
    "events": "events",
    "plan": "plan",
    "obstacles": "map",
    "margins": "margins",
    "monitors": "monitors",
}
_LASTING: Final = frozenset({"plan", "obstacles", "margins"})


async def run(config: DaemonConfig, contract: Contract, mission: Mission, log_path: Path) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        LinkError: the MAVLink link cannot be opened.
        LogFileError: the flight log cannot be written.
        zenoh.ZError: no Zenoh session with this configuration.
    """
    claim_priority()
    clock = Clock()
    autonomy = Autonomy(
        contract,
        mission,
        epoch_unix_s=clock.epoch_unix_s,
        system_id=config.mavlink.system_id,
        telemetry_timeout_s=config.mavlink.telemetry_timeout_s,
        input_set=config.input_set,
        fly_outside_contract=config.fly_outside_contract,
        preflight_age_max_s=config.preflight_age_max_s if config.require_preflight else None,
        stopwatch=time.perf_counter,
    )
    logs: Logs | None = None

    def receive(data: bytes) -> None:
        now_s = clock.now_s()
        autonomy.receive_mavlink(data, now_s)
        if logs is not None:
            logs.write_mavlink("received", clock.epoch_unix_s + now_s, data)

    with contextlib.ExitStack() as stack:
        link = await open_link(config.mavlink.url, receive, config.mavlink.system_id)
        stack.callback(link.close)
        session = stack.enter_context(open_session(config.zenoh))
        # Last: a daemon that cannot start leaves no log behind.
        logs = stack.enter_context(Logs(log_path, _metadata(contract, mission)))
        bus = Bus(session, config.vehicle, contract)
        bus.subscribe(autonomy, clock, mission_changes=config.accept_mission_updates)
        stop = _stop_on_signals()
        spare_the_collector()
        log.info(
            "ready: %s, contract %s, log %s", config.mavlink.url, contract.sha256[:12], logs.path
        )
        await _serve(autonomy, link, logs, bus, clock, stop)
    log.info("stopped")


def claim_priority() -> None:
    """Have Linux run this process, all its threads, before others; where that is allowed.

    A tick that waits for somebody else's work is late, and a late tick ends in a hover.
    """
    if not hasattr(os, "sched_setscheduler"):
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REALTIME_PRIORITY))
    except PermissionError:
        log.info("not allowed to run before other processes (needs CAP_SYS_NICE)")


def spare_the_collector() -> None:
    """Take what start-up has left out of all later garbage collections.

    One that walks every imported module takes several ticks on a small computer.
    """
    gc.collect()
    gc.freeze()


def _stop_on_signals() -> asyncio.Event:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    # A terminal that closes, or an SSH connection that drops, must not end a flight.
    loop.add_signal_handler(signal.SIGHUP, lambda: log.warning("SIGHUP ignored: flying on"))
    return stop


async def _serve(
    autonomy: Autonomy,
    link: Link,
    logs: Logs,
    bus: Bus,
    clock: Clock,
    stop: asyncio.Event,
) -> None:
    journal, event_log = Journal(autonomy, timed=True), EventLog()
    due_s = clock.now_s()
    while not stop.is_set():
        now_s = clock.now_s()
        if now_s - due_s > LATE_TICK_S:
            log.warning("tick %.0f ms late", (now_s - due_s) * 1e3)
            due_s = now_s
        _follow_clock(autonomy, clock, now_s)
        if logs.failure is not None:
            autonomy.report_log_end(logs.failure, now_s)
        autonomy.tick(now_s)
        if data := autonomy.mavlink_to_send():
            link.send(data)
            logs.write_mavlink("sent", clock.epoch_unix_s + now_s, data)
        records = journal.collect(now_s)
        event_log.write(records, now_s)
        logs.write(records)
        bus.publish(records, now_s)
        due_s += TICK_S
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, due_s - clock.now_s()))


def _follow_clock(autonomy: Autonomy, clock: Clock, now_s: float) -> None:
    step = clock.follow(autonomy.set_epoch)
    if step is not None:
        autonomy.emit(step.event(now_s))


class Bus:
    """Our keys on Zenoh: detections in; the flight out; the contract on request.

    ``events`` come once; ``status`` and ``monitors`` often; ``plan``, ``map`` and ``margins``,
    which last, when they change and again every second.

    Args:
        session: an open session.
        vehicle: name in the keys.
        contract: what the queryable answers with.
    """

    def __init__(self, session: zenoh.Session, vehicle: str, contract: Contract) -> None:
        self._session = session
        self._prefix = f"clearway/{vehicle}"
        self._publishers = {
            topic: session.declare_publisher(f"{self._prefix}/{key}")
            for topic, key in _KEYS.items()
        }
        self._status_due_s = self._repeat_due_s = 0.0
        self._lasting: dict[str, Record] = {}
        answer = {"contract": contract.model_dump(mode="json"), "sha256": contract.sha256}
        payload = json.dumps(answer).encode()
        key = f"{self._prefix}/contract"
        session.declare_queryable(key, lambda query: query.reply(key, payload))

    def subscribe(self, autonomy: Autonomy, clock: Clock, *, mission_changes: bool) -> None:
        """Pass detections and clearances on to the service, and other missions if that is meant."""
        self._pass_on("obstacles", autonomy.receive_detection, clock)
        self._pass_on("clearance", autonomy.receive_flight_authorization, clock)
        if mission_changes:
            self._pass_on("mission", autonomy.receive_mission, clock)

    def _pass_on(self, key: str, take: Callable[[bytes, float], None], clock: Clock) -> None:
        """Zenoh calls from its own thread, so what it brings has to cross into the loop."""
        loop = asyncio.get_running_loop()

        def deliver(payload: bytes) -> None:
            take(payload, clock.now_s())

        def receive(sample: zenoh.Sample) -> None:
            payload = sample.payload.to_bytes()
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(deliver, payload)

        self._session.declare_subscriber(f"{self._prefix}/{key}", receive)

    def publish(self, records: list[Record], now_s: float) -> None:
        """Publish what others may want to know; the state at a rate for people."""
        for record in records:
            if record.topic in _LASTING:
                self._lasting[record.topic] = record
            if record.topic != "state" or self._status_is_due(now_s):
                self._put(record)
        if now_s >= self._repeat_due_s:
            self._repeat_due_s = now_s + REPEAT_PERIOD_S
            for record in self._lasting.values():
                self._put(record)

    def _put(self, record: Record) -> None:
        publisher = self._publishers.get(record.topic)
        if publisher is not None:
            publisher.put(record.as_json())

    def _status_is_due(self, now_s: float) -> bool:
        if now_s < self._status_due_s:
            return False
        self._status_due_s = now_s + STATUS_PERIOD_S
        return True


def _metadata(contract: Contract, mission: Mission) -> dict[str, str]:
    return {
        "contract": contract.model_dump_json(),
        "contract_sha256": contract.sha256,
        "mission": mission.model_dump_json(),
    }
