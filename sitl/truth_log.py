"""Ground truth as an MCAP file: channel ``/truth``, JSON, opened by Foxglove and Lichtblick."""

from __future__ import annotations

import json
from typing import IO, Any

from mcap.writer import Writer

TRUTH_LOG_RATE_HZ = 50
_SCHEMA = {
    "title": "clearway.truth",
    "type": "object",
    "properties": {
        "time_unix_s": {"type": "number"},
        "position_ned_m": {"type": "array", "items": {"type": "number"}},
        "velocity_ned_mps": {"type": "array", "items": {"type": "number"}},
        "acceleration_ned_mps2": {"type": "array", "items": {"type": "number"}},
        "attitude_quaternion": {"type": "array", "items": {"type": "number"}},
        "rpm": {"type": "array", "items": {"type": "number"}},
        "clearance_m": {"type": ["number", "null"]},
        "clearance_min_m": {"type": ["number", "null"]},
        "collisions": {"type": "integer"},
    },
}


class TruthLog:
    """Writes records of :meth:`sitl.scene.Scene.truth_record`; equal records, equal bytes."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = Writer(stream)
        self._writer.start(profile="", library="clearway")
        schema_id = self._writer.register_schema(
            "clearway.truth", "jsonschema", json.dumps(_SCHEMA).encode()
        )
        self._channel_id = self._writer.register_channel("/truth", "json", schema_id)

    def write(self, record: dict[str, Any]) -> None:
        """Append one record at its own time."""
        time_ns = round(record["time_unix_s"] * 1e9)
        self._writer.add_message(
            self._channel_id,
            log_time=time_ns,
            publish_time=time_ns,
            data=json.dumps(record, separators=(",", ":"), allow_nan=False).encode(),
        )

    def close(self) -> None:
        """Write the index; the stream stays open."""
        self._writer.finish()
