"""The daemon: the only part of the service with sockets, threads, a clock and a Zenoh session.

It passes input to `onboard.autonomy`, ticks it at 50 Hz, and sends, logs and publishes its output.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
import signal
import time
from collections.abc import Callable
from pathlib import Path

import zenoh

from onboard.authentication.keys import DaemonKeys
from onboard.autonomy import Autonomy
from onboard.bus import Bus
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig, VehicleMission
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.fleet.membership import FleetMembership
from onboard.heap import freeze_gc_heap
from onboard.mavlink.connections import Link, open_link
from onboard.metrics.figures import Figures
from onboard.metrics.server import serve as serve_metrics
from onboard.metrics.tick_times import LateCause, TickTimes
from onboard.missions.from_vehicle import PLACEHOLDER
from onboard.monitoring.energy import SILENCE_S
from onboard.obstacle_outputs.outputs import ObstaclePublisher
from onboard.operator_channel import OperatorChannel
from onboard.recording.event_log import EventLog
from onboard.recording.journal import Journal
from onboard.recording.messages import Record
from onboard.recording.recorder import FlightRecorder, LogPlace
from onboard.saved_state import kept, restore
from onboard.service_manager import ServiceManager
from onboard.timing import Clock, ProcessorTimes, request_realtime_priority
from onboard.zenoh_session import open_session

log = logging.getLogger(__name__)


async def run(
    config: DaemonConfig,
    contract: Contract,
    mission: Mission | None,
    place: LogPlace,
    keys: DaemonKeys,
    geofence: Geofence | None = None,
    state: Path | None = None,
    fleet: FleetMembership | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; the flights are logged where ``place`` says.

    Without a mission the vehicle's own is flown; ``state`` keeps how far, over a restart.

    Raises:
        LinkError, MetricsError, LogFileError: the link, metrics or flight log cannot be opened.
        zenoh.ZError: no Zenoh session with this configuration.
    """
    request_realtime_priority()
    clock = Clock()
    autonomy = _service(config, contract, mission, clock, keys, geofence, state, fleet)
    recorder: FlightRecorder | None = None

    def receive(data: bytes) -> None:
        now_s = clock.now_s()
        autonomy.receive_mavlink(data, now_s)
        if recorder is not None:
            recorder.write_mavlink("received", clock.epoch_unix_s + now_s, data)

    with contextlib.ExitStack() as stack:
        url, system_id = config.mavlink.url, config.mavlink.system_id
        link = await open_link(url, receive, system_id, keys.is_genuine)
        stack.callback(link.close)
        session = stack.enter_context(open_session(config.zenoh))
        figures = _figures(config, contract, stack)
        # Last: a daemon that cannot start leaves no log behind.
        recorder = stack.enter_context(place.recorder(_metadata(contract, mission)))
        bus = _bus(session, config, contract, autonomy, clock, keys)
        shown = await _shown(config, autonomy, bus, stack)
        manager = stack.enter_context(ServiceManager.of_environment(os.environ))
        _report_ready(config, contract, recorder, manager)
        with kept(keys, autonomy.progress, state):
            stop = _stop_on_signals()
            await _serve(autonomy, link, recorder, bus, clock, stop, manager, shown, figures)
    log.info("stopped")


def _report_ready(
    config: DaemonConfig, contract: Contract, recorder: FlightRecorder, manager: ServiceManager
) -> None:
    freeze_gc_heap()
    url, contract_id = config.mavlink.url, contract.sha256[:12]
    log.info("ready: %s, contract %s, log %s", url, contract_id, recorder.path)
    manager.ready()


def _bus(
    session: zenoh.Session,
    config: DaemonConfig,
    contract: Contract,
    autonomy: Autonomy,
    clock: Clock,
    keys: DaemonKeys,
) -> Bus:
    OperatorChannel(session, config.vehicle, autonomy, clock, keys.commands).open(config)
    bus = Bus(session, config.vehicle, contract)
    bus.subscribe(autonomy, clock)
    return bus


def _service(
    config: DaemonConfig,
    contract: Contract,
    mission: Mission | None,
    clock: Clock,
    keys: DaemonKeys,
    geofence: Geofence | None,
    state: Path | None,
    fleet: FleetMembership | None,
) -> Autonomy:
    autonomy = Autonomy(
        contract,
        mission or PLACEHOLDER,
        epoch_unix_s=clock.epoch_unix_s,
        system_id=config.mavlink.system_id,
        telemetry_timeout_s=config.mavlink.telemetry_timeout_s,
        input_set=config.input_set,
        fly_outside_contract=config.fly_outside_contract,
        preflight_age_max_s=config.preflight_age_max_s if config.require_preflight else None,
        stopwatch=time.perf_counter,
        sensors=config.sources,
        signing=keys.signing,
        instance=secrets.randbits(32),
    )
    if geofence is not None:
        autonomy.keep_in(geofence)
    if mission is None:
        autonomy.fly_mission_on_board(config.vehicle_mission or VehicleMission())
    if fleet is not None:
        autonomy.join_fleet(fleet, secrets.token_hex(8))
    restore(autonomy.progress, state)
    return autonomy


async def _shown(
    config: DaemonConfig, autonomy: Autonomy, bus: Bus, stack: contextlib.ExitStack
) -> Callable[[list[Record], float], None]:
    """Open what the obstacles are shown to; return what takes the records of each tick.

    Raises:
        LinkError: the link to the ground station cannot be opened.
    """
    outputs, system_id = config.outputs, config.mavlink.system_id
    publisher = ObstaclePublisher(outputs, system_id, autonomy.link.transmitter)
    ground: Link | None = None
    if outputs.obstacle_distance is not None and outputs.obstacle_distance.url is not None:
        ground = await open_link(outputs.obstacle_distance.url, lambda _: None, system_id)
        stack.callback(ground.close)
    if outputs.markers is not None:
        bus.announce_markers(outputs.markers)

    def show(records: list[Record], now_s: float) -> None:
        shown = publisher.collect(records, now_s)
        if ground is not None and shown.to_ground:
            ground.send(shown.to_ground)
        if shown.markers is not None:
            bus.publish_markers(shown.markers, autonomy.epoch_unix_s + now_s)

    return show


def _figures(config: DaemonConfig, contract: Contract, stack: contextlib.ExitStack) -> Figures:
    """Return what counts; serve it where the configuration asks for that.

    Raises:
        MetricsError: it cannot be served.
    """
    figures = Figures(TickTimes())
    if config.metrics is not None:
        stack.callback(serve_metrics(config.metrics, figures, contract.sha256))
        log.info("metrics: http://%s/metrics", config.metrics.listen)
    return figures


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
    recorder: FlightRecorder,
    bus: Bus,
    clock: Clock,
    stop: asyncio.Event,
    manager: ServiceManager,
    show: Callable[[list[Record], float], None],
    figures: Figures,
) -> None:
    journal, event_log, times = Journal(autonomy, timed=True), EventLog(), ProcessorTimes()
    due_s = clock.now_s()
    while not stop.is_set():
        now_s = clock.now_s()
        if (cause := figures.ticks.begin(now_s - due_s, *times.since_last())) is not None:
            _report_late(figures.ticks, now_s - due_s, cause)
            due_s = now_s
        _follow_clock(autonomy, clock, now_s)
        if recorder.failure is not None:
            autonomy.report_log_end(recorder.failure, now_s)
        autonomy.tick(now_s)
        if data := autonomy.mavlink_to_send():
            link.send(data)
            recorder.write_mavlink("sent", clock.epoch_unix_s + now_s, data)
        records = journal.collect(now_s)
        event_log.write(records, now_s)
        recorder.write(records)
        bus.publish(records, now_s)
        bus.publish_fleet(autonomy.fleet_to_send())
        show(records, now_s)
        manager.tick(now_s, autonomy.navigator.phase.value)
        figures.take(records, autonomy.link.battery.charge(now_s, SILENCE_S))
        figures.ticks.end(clock.now_s() - now_s)
        due_s += TICK_S
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, due_s - clock.now_s()))


def _report_late(ticks: TickTimes, late_s: float, cause: LateCause) -> None:
    log.warning(
        "tick %.0f ms late (%s): the last took %.0f ms, waits for a processor %.0f ms",
        late_s * 1e3,
        cause.sentence,
        ticks.duration_last_s * 1e3,
        ticks.waited_s * 1e3,
    )


def _follow_clock(autonomy: Autonomy, clock: Clock, now_s: float) -> None:
    step = clock.follow(autonomy.set_epoch)
    if step is not None:
        autonomy.emit(step.event(now_s))


def _metadata(contract: Contract, mission: Mission | None) -> dict[str, str]:
    written = {"contract": contract.model_dump_json(), "contract_sha256": contract.sha256}
    # Of a mission on board, the event that it was read has what was read.
    return written if mission is None else written | {"mission": mission.model_dump_json()}
