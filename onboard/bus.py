"""The daemon's keys on Zenoh: detections in, records out, the contract on request."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import Callable
from typing import Final

import zenoh

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import MarkerOutput
from onboard.fleet.link import KEY_PREFIX
from onboard.obstacle_outputs.markers import attachment, markers_key
from onboard.perception.ros2.graph import node_token, publisher_token
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.registry import transforms_key, zenoh_key
from onboard.recording.messages import LASTING, ZENOH_KEYS, Record, StateRecord, as_json
from onboard.timing import Clock
from onboard.zenoh_session import subscribe_with_history

# Our name in the graph of ROS 2.
_NODE: Final = "clearway"
STATUS_PERIOD_S: Final = 0.2
# Records that last are published again this often, for subscribers that have joined since.
REPEAT_PERIOD_S: Final = 1.0


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

        if autonomy.fleet is not None:
            self._listen_to_fleet(autonomy, clock)

    def _listen_to_fleet(self, autonomy: Autonomy, clock: Clock) -> None:
        """Subscribe to what all vehicles of the fleet say."""
        loop = asyncio.get_running_loop()

        def deliver(key: str, payload: bytes) -> None:
            autonomy.receive_fleet(key, payload, clock.now_s())

        def receive(sample: zenoh.Sample) -> None:
            key, payload = str(sample.key_expr), sample.payload.to_bytes()
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(deliver, key, payload)

        self._session.declare_subscriber(f"{KEY_PREFIX}/*/*", receive)

    def publish_fleet(self, messages: list[tuple[str, bytes]]) -> None:
        """Publish what the vehicle says to its fleet, under the keys given."""
        for key, payload in messages:
            self._session.put(key, payload)

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
