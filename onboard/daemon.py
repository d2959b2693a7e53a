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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Self

import zenoh

from onboard.autonomy import Autonomy
from onboard.config import Contract, DaemonConfig, Mission, ZenohEndpoints
from onboard.contract import TICK_S
from onboard.journal import Journal
from onboard.links import Link, open_link
from onboard.log_parts import LogParts
from onboard.log_thread import LogThread
from onboard.record import Record
from onboard.recorder import Direction, FlightLog
from onboard.telemetry_log import TelemetryLog

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


class Clock:
    """Time since the start that no clock adjustment can move, and the Unix time of that start."""

    def __init__(self) -> None:
        self.epoch_unix_s = time.time()
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Return the time since the start."""
        return time.monotonic() - self._start_s


async def run(config: DaemonConfig, contract: Contract, mission: Mission, log_path: Path) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        LinkError: the MAVLink link cannot be opened.
        OSError: the flight log cannot be written.
        zenoh.ZError: no Zenoh session with this configuration.
    """
    claim_priority()
    clock = Clock()
    autonomy = Autonomy(
        contract,
        mission,
        epoch_unix_s=clock.epoch_unix_s,
        system_id=config.mavlink.system_id,
        stale_after_s=config.mavlink.stale_after_s,
        input_set=config.input_set,
        fly_outside_contract=config.fly_outside_contract,
        preflight_age_max_s=config.preflight_age_max_s if config.require_preflight else None,
        stopwatch=time.perf_counter,
    )
    with contextlib.ExitStack() as stack:
        logs = stack.enter_context(Logs(log_path, _metadata(contract, mission)))

        def receive(data: bytes) -> None:
            now_s = clock.now_s()
            autonomy.receive_mavlink(data, now_s)
            logs.write_mavlink("received", clock.epoch_unix_s + now_s, data)

        link = await open_link(config.mavlink.url, receive, config.mavlink.system_id)
        stack.callback(link.close)
        session = stack.enter_context(open_session(config.zenoh))
        bus = Bus(session, config.vehicle, contract)
        bus.subscribe(autonomy, clock, mission_changes=config.mission_changes)
        stop = _stop_on_signals()
        spare_the_collector()
        log.info("ready: %s, contract %s", config.mavlink.url, contract.sha256[:12])
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
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    return stop


async def _serve(
    autonomy: Autonomy,
    link: Link,
    logs: Logs,
    bus: Bus,
    clock: Clock,
    stop: asyncio.Event,
) -> None:
    journal = Journal(autonomy, timed=True)
    due_s = clock.now_s()
    while not stop.is_set():
        now_s = clock.now_s()
        if now_s - due_s > LATE_TICK_S:
            log.warning("tick %.0f ms late", (now_s - due_s) * 1e3)
            due_s = now_s
        if logs.failure is not None:
            autonomy.report_log_end(logs.failure, now_s)
        autonomy.tick(now_s)
        if data := autonomy.mavlink_to_send():
            link.send(data)
            logs.write_mavlink("sent", clock.epoch_unix_s + now_s, data)
        records = journal.collect(now_s)
        logs.write(records)
        bus.publish(records)
        due_s += TICK_S
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, due_s - clock.now_s()))


class Logs:
    """The flight log and, beside it, the MAVLink traffic as ``.tlog``; neither delays a tick.

    Args:
        path: of the flight log.
        metadata: what flew.

    Raises:
        OSError: a file cannot be written.
    """

    def __init__(self, path: Path, metadata: dict[str, str]) -> None:
        with contextlib.ExitStack() as stack:
            self._flight = stack.enter_context(FlightLog(path, metadata))
            parts = LogParts(path.with_suffix(".tlog"))
            self._telemetry = stack.enter_context(TelemetryLog(parts))
            # Entered last, so that it has written everything before the files are closed.
            self._thread = stack.enter_context(LogThread())
            self._open = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._open.close()
        except OSError as error:  # said before where a full disk has ended the logs in flight
            if self.failure is None:
                log.error("the flight log ends here: %s", error)  # noqa: TRY400  a full disk is no defect of ours

    @property
    def failure(self) -> str | None:
        """Why the logs have ended; None as long as they go on."""
        return self._thread.failure

    def write(self, records: list[Record]) -> None:
        """Log what a tick left behind."""
        self._thread.submit(lambda: self._flight.write(records))

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Log bytes of the MAVLink link."""

        def write() -> None:
            self._flight.write_mavlink(direction, time_unix_s, data)
            self._telemetry.write(direction, time_unix_s, data)

        self._thread.submit(write)


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
        self._pass_on("clearance", autonomy.receive_clearance, clock)
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

    def publish(self, records: list[Record]) -> None:
        """Publish what others may want to know; the state at a rate for people."""
        for record in records:
            if record.topic in _LASTING:
                self._lasting[record.topic] = record
            if record.topic != "state" or self._status_is_due(record):
                self._put(record)
        now_unix_s = records[0].time_unix_s
        if now_unix_s >= self._repeat_due_s:
            self._repeat_due_s = now_unix_s + REPEAT_PERIOD_S
            for record in self._lasting.values():
                self._put(record)

    def _put(self, record: Record) -> None:
        publisher = self._publishers.get(record.topic)
        if publisher is not None:
            publisher.put(record.as_json())

    def _status_is_due(self, record: Record) -> bool:
        if record.time_unix_s < self._status_due_s:
            return False
        self._status_due_s = record.time_unix_s + STATUS_PERIOD_S
        return True


@contextlib.contextmanager
def open_session(endpoints: ZenohEndpoints) -> Iterator[zenoh.Session]:
    """Open a Zenoh session, and close it whatever happens: an open one keeps the process alive."""
    config = zenoh.Config()
    if endpoints.connect or endpoints.listen:
        config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps(endpoints.connect))
    config.insert_json5("listen/endpoints", json.dumps(endpoints.listen))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()  # type: ignore[no-untyped-call]


def _metadata(contract: Contract, mission: Mission) -> dict[str, str]:
    return {
        "contract": contract.model_dump_json(),
        "contract_sha256": contract.sha256,
        "mission": mission.model_dump_json(),
    }
