"""`clearway watch --foxglove`: a viewer connects, subscribes, and reads records and scene."""

from __future__ import annotations

import asyncio
import base64
import json
import socket
import struct
from typing import Any

import pytest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from gcs_tools.console.errors import CommandError
from gcs_tools.export.scene import TOPICS
from gcs_tools.watch.feed import Feed
from gcs_tools.watch.foxglove_server import serving_foxglove
from onboard.recording.messages import (
    KnownObstacle,
    Obstacles,
    Record,
    StateRecord,
    as_json,
)
from tests.gcs_tools.export.protobuf import decoded

T = 1_790_000_000.0
CORNERS = [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0)]
OBSTACLES = Obstacles(
    time_s=T, height_m=4.0, obstacles=[KnownObstacle(id="front/1", measured_ned_m=CORNERS)]
)
STATE = StateRecord(time_s=T, phase="cruise", position_ned_m=(1.0, 2.0, -4.0), yaw_rad=0.5)
_MESSAGE = 0x01
_TIMEOUT_S = 30.0
_REPEATED_S = 0.05


class Viewer:
    """Speaks as much of the Foxglove WebSocket protocol as a viewer needs."""

    def __init__(self, socket: WebSocketClientConnection) -> None:
        self._socket = socket
        self.channels: dict[str, dict[str, Any]] = {}

    async def _read(self) -> bytes | str:
        message = await asyncio.wait_for(self._socket.read_message(), _TIMEOUT_S)
        assert message is not None, "the server has closed the connection"
        return message

    async def learn_channels(self, count: int) -> None:
        while len(self.channels) < count:
            message = await self._read()
            if isinstance(message, str) and (said := json.loads(message))["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in said["channels"]}

    async def subscribe(self, *topics: str) -> None:
        wanted = [
            {"id": number, "channelId": self.channels[topic]["id"]}
            for number, topic in enumerate(topics)
        ]
        await self._socket.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    async def next_message(self) -> tuple[int, int, bytes]:
        """Return subscription, time in nanoseconds, and payload."""
        while True:
            message = await self._read()
            if isinstance(message, bytes) and message[0] == _MESSAGE:
                number, time_ns = struct.unpack("<IQ", message[1:13])
                return number, time_ns, message[13:]


async def _published(feed: Feed, records: tuple[Record, ...]) -> None:
    """Publish records over and over, as the daemon repeats what lasts, until cancelled."""
    while True:
        for record in records:
            key = {StateRecord: "status", Obstacles: "map"}[type(record)]
            feed.receive(key, as_json(record))
        await asyncio.sleep(_REPEATED_S)


async def viewed(
    url: str, feed: Feed, topics: tuple[str, ...], *records: Record
) -> list[tuple[dict[str, Any], int, bytes]]:
    """Subscribe, publish records until each topic had a message, and return the first of each."""
    connection = await websocket_connect(url, subprotocols=["foxglove.sdk.v1"])
    # A subscription takes effect at some time after it was asked for; what was published before is
    # not sent again, so that a viewer that waits needs a publisher that goes on.
    publishing = asyncio.create_task(_published(feed, records))
    try:
        viewer = Viewer(connection)
        await viewer.learn_channels(len(TOPICS) + 8)
        await viewer.subscribe(*topics)
        found: dict[int, tuple[dict[str, Any], int, bytes]] = {}
        while len(found) < len(topics):
            number, time_ns, data = await viewer.next_message()
            found.setdefault(number, (viewer.channels[topics[number]], time_ns, data))
        return [found[number] for number in range(len(topics))]
    finally:
        publishing.cancel()
        connection.close()
        # The socket is closed once the server has answered; what is still under way comes before.
        while await asyncio.wait_for(connection.read_message(), _TIMEOUT_S) is not None:
            pass


def test_a_viewer_reads_the_scene() -> None:
    feed = Feed()
    with serving_foxglove(feed, "v1", "127.0.0.1", 0) as url:
        topics = ("/scene/obstacles", "/pose", "/state")
        scene, pose, state = asyncio.run(viewed(url, feed, topics, STATE, OBSTACLES))
    channel, time_ns, data = scene
    assert time_ns == round(T * 1e9)
    assert (channel["encoding"], channel["schemaName"]) == ("protobuf", "foxglove.SceneUpdate")
    message = decoded(channel["schemaName"], schema_bytes(channel), data)
    assert [entity["id"] for entity in message["entities"]] == ["front/1"]
    channel, _, data = pose
    drawn = decoded(channel["schemaName"], schema_bytes(channel), data)
    assert drawn["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": -4.0}
    channel, _, data = state
    assert (channel["encoding"], channel["schemaName"]) == ("json", "clearway.state")
    assert data == as_json(STATE)


def schema_bytes(channel: dict[str, Any]) -> bytes:
    return base64.b64decode(channel["schema"])


def test_without_a_viewer_the_feed_goes_on_and_after_it_too() -> None:
    feed = Feed()
    with serving_foxglove(feed, "v1", "127.0.0.1", 0):
        feed.receive("status", as_json(STATE))
    feed.receive("status", as_json(STATE))
    assert feed.latest(StateRecord) == STATE
    assert feed.dropped == 0


def test_a_port_in_use_is_one_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with (
            pytest.raises(CommandError, match=f"127.0.0.1:{port}: cannot be served on"),
            serving_foxglove(Feed(), "v1", "127.0.0.1", port),
        ):
            pass
