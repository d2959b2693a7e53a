"""The daemon: the only part of the service with sockets, threads, a clock and a Zenoh session.

It passes input to `onboard.autonomy`, ticks it at 50 Hz, and sends, logs and publishes its output.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from typing import Final

import zenoh

from onboard.authentication.keys import SAVE_PERIOD_S, DaemonKeys
from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig, MarkerOutput
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError
from onboard.mavlink.connections import Link, open_link
from onboard.obstacle_outputs.markers import attachment, markers_key
from onboard.obstacle_outputs.outputs import ObstaclePublisher
from onboard.operator_channel import OperatorChannel
from onboard.perception.ros2.graph import node_token, publisher_token
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.registry import transforms_key, zenoh_key
from onboard.recording.event_log import EventLog
from onboard.recording.journal import Journal
from onboard.recording.messages import LASTING, ZENOH_KEYS, Record, StateRecord, as_json
from onboard.recording.recorder import FlightRecorder, LogPlace
from onboard.service_manager import ServiceManager
from onboard.timing import Clock, freeze_gc_heap, request_realtime_priority
from onboard.zenoh_session import open_session, subscribe_with_history

log = logging.getLogger(__name__)

# Our name in the graph of ROS 2.
_NODE: Final = "clearway"
STATUS_PERIOD_S: Final = 0.2
# Records that last are published again this often, for subscribers that have joined since.
REPEAT_PERIOD_S: Final = 1.0
# A tick this late means that the computer cannot keep up, or was suspended.
LATE_TICK_S: Final = 2.0 * TICK_S


async def run(
    config: DaemonConfig,
    contract: Contract,
    mission: Mission,
    place: LogPlace,
    keys: DaemonKeys,
    geofence: Geofence | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; the flights are logged where ``place`` says.

    Raises:
        LinkError: the MAVLink link cannot be opened.
        LogFileError: the flight log cannot be written.
        zenoh.ZError: no Zenoh session with this configuration.
    """
    request_realtime_priority()
    clock = Clock()
    autonomy = _service(config, contract, mission, clock, keys, geofence)
    recorder: FlightRecorder | None = None

    def receive(data: bytes) -> None:
        now_s = clock.now_s()
        autonomy.receive_mavlink(data, now_s)
        if recorder is not None:
            recorder.write_mavlink("received", clock.epoch_unix_s + now_s, data)

    with contextlib.ExitStack() as stack:
        link = await open_link(
            config.mavlink.url, receive, config.mavlink.system_id, keys.is_genuine
        )
        stack.callback(link.close)
        session = stack.enter_context(open_session(config.zenoh))
        # Last: a daemon that cannot start leaves no log behind.
        recorder = stack.enter_context(place.recorder(_metadata(contract, mission)))
        OperatorChannel(session, config.vehicle, autonomy, clock, keys.commands).open(config)
        bus = _bus(session, config, contract, autonomy, clock)
        shown = await _shown(config, autonomy, bus, stack)
        manager = stack.enter_context(ServiceManager.of_environment(os.environ))
        stop = _stop_on_signals()
        freeze_gc_heap()
        _report_ready(config, contract, recorder)
        manager.ready()
        with _saved(keys):
            await _serve(autonomy, link, recorder, bus, clock, stop, manager, shown)
    log.info("stopped")


def _report_ready(config: DaemonConfig, contract: Contract, recorder: FlightRecorder) -> None:
    url, contract_id = config.mavlink.url, contract.sha256[:12]
    log.info("ready: %s, contract %s, log %s", url, contract_id, recorder.path)


async def _keep(keys: DaemonKeys) -> None:
    """Save how far the time stamps of signatures have come, in a thread: a disk may be slow."""
    while True:
        await asyncio.sleep(SAVE_PERIOD_S)
        try:
            await asyncio.to_thread(keys.save)
        except FileError as error:
            log.warning("%s", error)


@contextlib.contextmanager
def _saved(keys: DaemonKeys) -> Iterator[None]:
    """Save the state of the keys now and then, and at the end."""
    saving = asyncio.create_task(_keep(keys))
    try:
        yield
    finally:
        saving.cancel()
    keys.save()


def _bus(
    session: zenoh.Session,
    config: DaemonConfig,
    contract: Contract,
    autonomy: Autonomy,
    clock: Clock,
) -> Bus:
    bus = Bus(session, config.vehicle, contract)
    bus.subscribe(autonomy, clock)
    return bus


def _service(
    config: DaemonConfig,
    contract: Contract,
    mission: Mission,
    clock: Clock,
    keys: DaemonKeys,
    geofence: Geofence | None,
) -> Autonomy:
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
        sensors=config.sources,
        signing=keys.signing,
    )
    if geofence is not None:
        autonomy.keep_in(geofence)
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
) -> None:
    journal, event_log = Journal(autonomy, timed=True), EventLog()
    due_s = clock.now_s()
    while not stop.is_set():
        now_s = clock.now_s()
        if now_s - due_s > LATE_TICK_S:
            log.warning("tick %.0f ms late", (now_s - due_s) * 1e3)
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
        show(records, now_s)
        manager.tick(now_s, autonomy.navigator.phase.value)
        due_s += TICK_S
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, due_s - clock.now_s()))


def _follow_clock(autonomy: Autonomy, clock: Clock, now_s: float) -> None:
    step = clock.follow(autonomy.set_epoch)
    if step is not None:
        autonomy.emit(step.event(now_s))


class Bus:
    """The daemon's keys on Zenoh: detections in, records out, contract and resuming on request.

    ``events`` come once, ``status`` and ``monitors`` five times a second, and ``plan``, ``map`` and
    ``margins`` when they change and again every second.

    Args:
        session: an open session.
        vehicle: name in the keys.
        contract: the answer of the queryable.
    """

    def __init__(self, session: zenoh.Session, vehicle: str, contract: Contract) -> None:
        self._session = session
        self._prefix = f"clearway/{vehicle}"
        self._publishers = {
            record_type: session.declare_publisher(f"{self._prefix}/{key}")
            for record_type, key in ZENOH_KEYS.items()
        }
        self._status_due_s = self._repeat_due_s = 0.0
        self._lasting: dict[type[Record], Record] = {}
        self._markers: zenoh.Publisher | None = None
        self._markers_sent, self._markers_bridged = 0, False
        self._publisher_id = os.urandom(16)
        self._tokens: list[zenoh.LivelinessToken] = []
        answer = {"contract": contract.model_dump(mode="json"), "sha256": contract.sha256}
        payload = json.dumps(answer).encode()
        key = f"{self._prefix}/contract"
        session.declare_queryable(key, lambda query: query.reply(key, payload))

    def subscribe(self, autonomy: Autonomy, clock: Clock) -> None:
        """Pass detections and the messages of sensors on to the service."""
        self._pass_on("obstacles", autonomy.receive_detection, clock)
        for name, sensor in autonomy.sensors.sensors.items():
            if key := zenoh_key(sensor.config):
                self._listen_to(name, key, autonomy.sensors, clock)
            if key := transforms_key(sensor.config):
                self._listen_to_transforms(name, key, autonomy.sensors)

    def _listen_to(self, name: str, key: str, sensors: SensorChannels, clock: Clock) -> None:
        """Subscribe to a sensor's own key."""
        loop = asyncio.get_running_loop()

        def deliver(payload: bytes, key: str, attachment: bytes) -> None:
            sensors.receive(name, payload, clock.now_s(), key=key, attachment=attachment)

        def receive(sample: zenoh.Sample) -> None:
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            payload, from_key = sample.payload.to_bytes(), str(sample.key_expr)
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(deliver, payload, from_key, attachment)

        self._session.declare_subscriber(key, receive)

    def _listen_to_transforms(self, name: str, key: str, sensors: SensorChannels) -> None:
        """Subscribe to the transforms that mount a sensor, which may have been sent long ago."""
        loop = asyncio.get_running_loop()

        def deliver(payload: bytes, key: str) -> None:
            sensors.receive_transforms(name, payload, key=key)

        def receive(sample: zenoh.Sample) -> None:
            payload, from_key = sample.payload.to_bytes(), str(sample.key_expr)
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(deliver, payload, from_key)

        subscribe_with_history(self._session, key, receive)

    def _pass_on(self, key: str, take: Callable[[bytes, float], None], clock: Clock) -> None:
        """Subscribe; Zenoh calls from its own thread, so its samples cross into the loop."""
        loop = asyncio.get_running_loop()

        def deliver(payload: bytes) -> None:
            take(payload, clock.now_s())

        def receive(sample: zenoh.Sample) -> None:
            payload = sample.payload.to_bytes()
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(deliver, payload)

        self._session.declare_subscriber(f"{self._prefix}/{key}", receive)

    def announce_markers(self, config: MarkerOutput) -> None:
        """Declare a publisher of markers, as ROS 2 sees one."""
        bridged = config.middleware != "rmw_zenoh"
        key = markers_key(config.topic, bridged=bridged, domain=config.domain_id)
        self._markers, self._markers_bridged = self._session.declare_publisher(key), bridged
        if not bridged:
            session = str(self._session.info.zid())
            liveliness = self._session.liveliness()
            self._tokens = [
                liveliness.declare_token(node_token(session, _NODE, config.domain_id)),
                liveliness.declare_token(publisher_token(session, _NODE, key)),
            ]

    def publish_markers(self, payload: bytes, now_unix_s: float) -> None:
        """Publish markers; what they are announced as says whom the sample names."""
        if self._markers is None:
            return
        self._markers_sent += 1
        own = None
        if not self._markers_bridged:
            own = attachment(self._markers_sent, now_unix_s, self._publisher_id)
        self._markers.put(payload, attachment=own)

    def publish(self, records: list[Record], now_s: float) -> None:
        """Publish the records of a tick; the state at a rate for people."""
        for record in records:
            if isinstance(record, LASTING):
                self._lasting[type(record)] = record
            if not isinstance(record, StateRecord) or self._status_is_due(now_s):
                self._put(record)
        if now_s >= self._repeat_due_s:
            self._repeat_due_s = now_s + REPEAT_PERIOD_S
            for record in self._lasting.values():
                self._put(record)

    def _put(self, record: Record) -> None:
        self._publishers[type(record)].put(as_json(record))

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
