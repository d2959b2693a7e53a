"""Writes logs that our own writer would not: records of other versions, and malformed ones."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from mcap.writer import Writer
from pydantic import TypeAdapter

from gcs_tools.logs.flight_log import Log, log_of
from onboard.files.truth_record import TruthRecord
from onboard.recording.flight_log import FORMAT_VERSION
from onboard.recording.messages import TOPICS, Record

_T = TypeVar("_T")

Write = Callable[[str, float, Mapping[str, Any] | bytes], None]


def made(record_type: type[_T], payload: Mapping[str, Any]) -> _T:
    """Return a record from its JSON values, as a reader would."""
    if record_type not in _ADAPTERS:
        _ADAPTERS[record_type] = TypeAdapter(record_type)
    adapter: TypeAdapter[_T] = _ADAPTERS[record_type]
    return adapter.validate_json(json.dumps(payload), strict=True)


# Making one takes longer than a hundred readings.
_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def record(topic: str, payload: Mapping[str, Any]) -> Record:
    """Return a record of a topic from its JSON values."""
    return made(next(each for each, name in TOPICS.items() if name == topic), payload)


def truth_record(payload: Mapping[str, Any]) -> TruthRecord:
    """Return a record of ground truth from its JSON values."""
    return made(TruthRecord, payload)


def json_log(
    messages: Mapping[str, Iterable[Mapping[str, Any]]],
    metadata: Mapping[str, Mapping[str, str]] | None = None,
) -> Log:
    """Return a log in memory from JSON values by topic (``/state``)."""
    records = [record(topic[1:], each) for topic, every in messages.items() for each in every]
    return log_of(records, metadata=metadata)


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
