"""Writes logs that our own writer would not: records of other versions, and malformed ones."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.writer import Writer
from pydantic import TypeAdapter

from onboard.files.truth_record import TruthRecord
from onboard.recording.flight_log import FORMAT_VERSION
from onboard.recording.messages import ADAPTERS, TOPICS, Record

Write = Callable[[str, float, Mapping[str, Any] | bytes], None]


def record(topic: str, payload: Mapping[str, Any]) -> Record:
    """Return a record from its JSON values, as a reader would."""
    record_type = next(each for each, name in TOPICS.items() if name == topic)
    made: Record = ADAPTERS[record_type].validate_json(json.dumps(payload), strict=True)
    return made


def truth_record(payload: Mapping[str, Any]) -> TruthRecord:
    """Return a record of ground truth from its JSON values."""
    return TypeAdapter(TruthRecord).validate_json(json.dumps(payload), strict=True)


@contextmanager
def raw_log(path: Path, **metadata: str) -> Iterator[Write]:
    """Write a log message by message: topic without its slash, Unix time, JSON values or bytes."""
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=64 * 1024, use_summary_offsets=False)
        writer.start(profile="clearway", library="test")
        writer.add_metadata("clearway", {"format_version": str(FORMAT_VERSION), **metadata})

        def write(topic: str, time_unix_s: float, payload: Mapping[str, Any] | bytes) -> None:
            if topic not in channels:
                schema = writer.register_schema(f"clearway.{topic}", "jsonschema", b"{}")
                channels[topic] = writer.register_channel(f"/{topic}", "json", schema)
            data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
            time_ns = round(time_unix_s * 1e9)
            writer.add_message(channels[topic], time_ns, data, time_ns)

        yield write
        writer.finish()  # type: ignore[no-untyped-call]  # untyped in its own source
