"""Reads the MCAP logs of a flight, also those of a process that was killed while writing."""

from __future__ import annotations

import json
import struct
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from gcs_tools.errors import CommandError


@dataclass(frozen=True)
class Log:
    """A log in memory.

    Attributes:
        messages: JSON payloads by topic (``/state``, ``/truth``), in the order of the file.
        metadata: strings by name of the metadata record and key.
        complete: whether the file ends as it should.
    """

    messages: Mapping[str, list[dict[str, Any]]]
    metadata: Mapping[str, Mapping[str, str]]
    complete: bool

    def topic(self, name: str) -> list[dict[str, Any]]:
        """Return the messages of a topic, none if the log has no such topic."""
        return self.messages.get(name, [])


def read_log(path: Path) -> Log:
    """Read a whole log; of a file that breaks off, what is before the break.

    Raises:
        CommandError: the file is missing, or no MCAP file at all.
    """
    messages: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
    metadata: dict[str, Mapping[str, str]] = {}
    topics: dict[int, str] = {}
    complete = False
    try:
        with path.open("rb") as file:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    messages[topics[record.channel_id]].append(json.loads(record.data))
                elif isinstance(record, Metadata):
                    metadata[record.name] = record.metadata
        complete = True
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (McapError, struct.error, ValueError, KeyError) as error:
        if not messages and not metadata:
            raise CommandError(f"{path}: is not a flight log: {error}") from error
    return Log(messages, metadata, complete)
