"""Reads the MCAP logs of a flight, also those of a process that was killed while writing."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from pydantic_core import from_json
from zstandard import ZstdError

from gcs_tools.console.errors import CommandError
from onboard.recording.flight_log import FORMAT_VERSION

_OURS = "clearway"


@dataclass(frozen=True)
class Log:
    """A log in memory.

    Attributes:
        messages: JSON payloads by topic (``/state``, ``/truth``), in the order of the file.
        metadata: strings by name of the metadata record and key.
        complete: whether the file ends as it should.
        problems: what could not be read, one sentence each.
    """

    messages: Mapping[str, list[dict[str, Any]]]
    metadata: Mapping[str, Mapping[str, str]]
    complete: bool
    problems: tuple[str, ...] = ()

    def topic(self, name: str) -> list[dict[str, Any]]:
        """Return the messages of a topic, none if the log has no such topic."""
        return self.messages.get(name, [])


def read_log(path: Path, watch: Callable[[int], None] = lambda _: None) -> Log:
    """Read everything of ours in a log; of a file that breaks off, what is before the break.

    Messages in Foxglove's schemas and raw MAVLink repeat what our own topics say, and are left out.

    Args:
        path: the file.
        watch: told now and then how many bytes have been read.

    Raises:
        CommandError: the file is missing, or no MCAP file at all.
    """
    reading = _Reading()
    problem = ""
    try:
        with path.open("rb") as file:
            for record in _records(file):
                reading.take(record)
                watch(file.tell())
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (McapError, ZstdError, struct.error, ValueError, KeyError) as error:
        if not reading.messages and not reading.metadata:
            reason = str(error) or "it breaks off in its first record"
            raise CommandError(f"{path}: is not a flight log: {reason}") from error
        problem = f"{path.name} breaks off before its end: shown is what was written until then"
    problems = filter(None, (problem, *_version_problems(path, reading.metadata)))
    return Log(reading.messages, reading.metadata, not problem, tuple(problems))


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    yield from StreamReader(file, validate_crcs=True).records


class _Reading:
    """What has been read so far."""

    def __init__(self) -> None:
        self.messages: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
        self.metadata: dict[str, Mapping[str, str]] = {}
        self._our_schemas: set[int] = set()
        self._topics: dict[int, str | None] = {}

    def take(self, record: McapRecord) -> None:
        match record:
            case Message():
                topic = self._topics[record.channel_id]
                if topic is not None:
                    self.messages[topic].append(from_json(record.data, cache_strings="keys"))
            case Schema():
                if record.name.startswith(f"{_OURS}."):
                    self._our_schemas.add(record.id)
            case Channel():
                ours = record.schema_id in self._our_schemas
                self._topics[record.id] = record.topic if ours else None
            case Metadata():
                self.metadata[record.name] = record.metadata
            case _:
                pass


def _version_problems(path: Path, metadata: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    written = metadata.get(_OURS, {}).get("format_version", str(FORMAT_VERSION))
    if not written.isdecimal() or int(written) > FORMAT_VERSION:
        yield (
            f"{path.name} has format {written}, and this program reads {FORMAT_VERSION}: "
            "a newer program may show more"
        )
