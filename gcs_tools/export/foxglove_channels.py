"""The channels of a flight in Foxglove: our own records as JSON, and the scene drawn from them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from foxglove import Channel, Context

from gcs_tools.export.scene import TOPICS as SCENE_TOPICS
from gcs_tools.export.scene import Scene
from onboard.recording.messages import TOPICS, Record, as_json, schema_of


class FoxgloveChannels:
    """Sends records to whatever is attached to a context: an MCAP file, or a WebSocket server.

    Args:
        context: of the SDK.
        scene: draws the flight.
    """

    def __init__(self, context: Context, scene: Scene) -> None:
        self._scene = scene
        self._records = {
            record_type: Channel(f"/{topic}", schema=schema_of(record_type), context=context)
            for record_type, topic in TOPICS.items()
        }
        self._drawn = {
            topic: Channel(
                topic, schema=kind.get_schema(), message_encoding="protobuf", context=context
            )
            for topic, kind in SCENE_TOPICS.items()
        }

    def send(self, record: Record) -> None:
        """Send a record, and what the scene makes of it."""
        time_ns = round(record.time_s * 1e6) * 1000
        self._records[type(record)].log(as_json(record), log_time=time_ns)
        for topic, message in self._scene.draw(record):
            self._drawn[topic].log(message.encode(), log_time=time_ns)

    def close(self) -> None:
        """Close every channel."""
        for channel in (*self._records.values(), *self._drawn.values()):
            channel.close()


@contextmanager
def foxglove_channels(context: Context, scene: Scene) -> Iterator[FoxgloveChannels]:
    """Open the channels while the context lasts."""
    channels = FoxgloveChannels(context, scene)
    try:
        yield channels
    finally:
        channels.close()
