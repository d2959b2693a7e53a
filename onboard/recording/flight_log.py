"""The flight log: an MCAP file with one JSON channel per type of record, and the raw MAVLink bytes.

The writer reads no clock, so equal records give equal bytes.  A chunk is compressed and written
after about one second of flight, so the log of a daemon that was killed is readable up to there.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata as packages
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Literal, Self

from mcap.writer import CompressionType, Writer

from onboard.recording.messages import LASTING, TOPICS, Record, as_json, schema_of
from onboard.recording.rotation import LogRotation

# Readers name the format of a log that is newer than they are.  Raise it when a topic changes its
# meaning.
FORMAT_VERSION: Final = 1
# The message encoding of the raw MAVLink channels: bytes as they crossed the link, in log order.
# It needs no schema: the MAVLink 2 serialization guide describes it.
MAVLINK_ENCODING: Final = "mavlink"

_CHUNK_BYTES: Final = 64 * 1024
_DEPENDENCIES: Final = ("clearway", "numpy", "osqp", "pymavlink", "mcap")

Direction = Literal["received", "sent"]


class FlightLog:
    """Writes records to an MCAP file, and to the next one when that is full.

    Args:
        path: the file, overwritten; or the names and sizes of its parts.
        metadata: what flew: contract and its hash, mission, seed.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path | LogRotation, metadata: Mapping[str, str]) -> None:
        self._parts = path if isinstance(path, LogRotation) else LogRotation(path, overwrite=True)
        self._metadata = {"format_version": str(FORMAT_VERSION), **versions(), **metadata}
        # Repeated at the start of each part, which is then complete by itself.
        self._lasting: dict[type[Record], Record] = {}
        self._schemas = _schemas()
        self._file: BinaryIO
        self._writer: Writer
        self._channels: dict[str, int]
        self._sequences: dict[str, int] = {}
        self._open_part()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, records: Iterable[Record]) -> None:
        """Append records in the order of their ticks.

        Raises:
            OSError: the disk is full or gone.
        """
        if self._file.tell() >= self._parts.part_bytes:
            self._open_next_part()
        for record in records:
            self._write(record)
            if isinstance(record, LASTING):
                self._lasting[type(record)] = record
        self._file.flush()

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Append bytes as they crossed the MAVLink link.

        Raises:
            OSError: the disk is full or gone.
        """
        topic = f"mavlink/{direction}"
        if topic not in self._channels:
            no_schema = 0
            self._channels[topic] = self._writer.register_channel(
                f"/{topic}", MAVLINK_ENCODING, no_schema
            )
        self._add(topic, time_unix_s, data)

    def go_on_in(self, successor: FlightLog) -> None:
        """Finish this log, and begin another with the records that still hold.

        Raises:
            OSError: the disk is full or gone.
        """
        self.close()
        successor.write(self._lasting.values())

    def close(self) -> None:
        """Finish the file; without this it can be read from the start, but has no index."""
        if self._file.closed:  # the next part could not be opened
            return
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap left it untyped
        self._file.close()

    def _open_part(self) -> None:
        self._file = self._parts.open_next()
        self._writer = Writer(
            self._file,
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            # This writer also writes offsets of groups that are empty, which is not in the format.
            use_summary_offsets=False,
        )
        self._writer.start(profile="clearway", library="clearway")
        self._writer.add_metadata("clearway", self._metadata)
        self._channels = {}

    def _open_next_part(self) -> None:
        self.close()
        self._open_part()
        for record in self._lasting.values():
            self._write(record)

    def _write(self, record: Record) -> None:
        topic = TOPICS[type(record)]
        if topic not in self._channels:
            self._channels[topic] = self._register(type(record))
        self._add(topic, record.time_s, as_json(record))

    def _register(self, record_type: type[Record]) -> int:
        schema_id = self._writer.register_schema(
            f"clearway.{TOPICS[record_type]}", "jsonschema", self._schemas[record_type]
        )
        return self._writer.register_channel(f"/{TOPICS[record_type]}", "json", schema_id)

    def _add(self, topic: str, time_unix_s: float, data: bytes) -> None:
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        time_ns = round(time_unix_s * 1e6) * 1000
        self._writer.add_message(self._channels[topic], time_ns, data, time_ns, sequence)


@cache
def _schemas() -> dict[type[Record], bytes]:
    """Return the JSON Schema of every record; deriving them takes several ticks, once."""
    return {each: json.dumps(schema_of(each)).encode() for each in TOPICS}


def versions() -> dict[str, str]:
    """Return the versions of Python and of what decides, by the key ``version_<package>``."""
    found = {"version_python": platform.python_version()}
    for package in _DEPENDENCIES:
        try:
            found[f"version_{package}"] = packages.version(package)
        except packages.PackageNotFoundError:
            # Running from a checkout that was never installed.
            found[f"version_{package}"] = "unknown"
    return found
