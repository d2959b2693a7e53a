"""The flight log: MCAP with JSON channels, one for each topic of `onboard.recording.journal`.

The same records give the same bytes: nothing here reads a clock.  What has been written is on its
way to the disk within one chunk, about a second of flight: a killed daemon leaves a file that can
be read up to there.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata as packages
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Literal, Self

from mcap.writer import CompressionType, Writer

from onboard.recording.foxglove_messages import SCHEMAS
from onboard.recording.record import Record
from onboard.recording.rotation import LogParts

# Readers refuse logs of a format that they do not know; raised when a topic changes its meaning.
FORMAT_VERSION: Final = 1

_CHUNK_BYTES: Final = 64 * 1024
# What holds until it is said anew, and so is said again at the start of each part.
_LASTING: Final = frozenset({"margins", "obstacles", "plan", "scene/obstacles", "scene/plan"})
_DEPENDENCIES: Final = ("clearway", "numpy", "osqp", "pymavlink", "mcap")

Direction = Literal["received", "sent"]


class FlightLog:
    """Writes records to an MCAP file, and to the next one when that is full.

    Args:
        path: the file, overwritten; or the names and sizes of its parts.
        metadata: strings that say what flew: contract and its hash, mission, seed.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path | LogParts, metadata: Mapping[str, str]) -> None:
        self._parts = path if isinstance(path, LogParts) else LogParts(path, overwrite=True)
        self._metadata = {"format_version": str(FORMAT_VERSION), **versions(), **metadata}
        self._lasting: dict[str, Record] = {}
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
        """Append records, in the order of their ticks.

        Raises:
            OSError: the disk is full, or gone.
        """
        if self._file.tell() >= self._parts.part_bytes:
            self._open_next_part()
        for record in records:
            self._write(record)
            if record.topic in _LASTING:
                self._lasting[record.topic] = record
        self._file.flush()

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Append bytes as they crossed the MAVLink link.

        Raises:
            OSError: the disk is full, or gone.
        """
        topic = f"mavlink/{direction}"
        if topic not in self._channels:
            # Schema 0 is none: the encoding says it all.
            self._channels[topic] = self._writer.register_channel(f"/{topic}", "mavlink", 0)
        self._add(topic, time_unix_s, data)

    def close(self) -> None:
        """Finish the file; it can be read without this, only not searched."""
        if self._file.closed:  # finished, but the next part could not be opened
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
        if record.topic not in self._channels:
            self._channels[record.topic] = self._register(record)
        self._add(record.topic, record.time_unix_s, record.as_json())

    def _register(self, record: Record) -> int:
        name = record.schema or f"clearway.{record.topic}"
        schema = SCHEMAS.get(name, {"title": name, "type": "object"})
        schema_id = self._writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        return self._writer.register_channel(f"/{record.topic}", "json", schema_id)

    def _add(self, topic: str, time_unix_s: float, data: bytes) -> None:
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        time_ns = round(time_unix_s * 1e6) * 1000
        self._writer.add_message(self._channels[topic], time_ns, data, time_ns, sequence)


def versions() -> dict[str, str]:
    """Return what runs here, for the metadata: ``version_<package>``, in lower case."""
    found = {"version_python": platform.python_version()}
    for package in _DEPENDENCIES:
        try:
            found[f"version_{package}"] = packages.version(package)
        except packages.PackageNotFoundError:
            # Run from a checkout that was never installed.
            found[f"version_{package}"] = "unknown"
    return found
