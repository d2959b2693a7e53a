"""The flight log: MCAP with JSON channels, one for each topic of `onboard.journal`.

The same records give the same bytes: nothing here reads a clock.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from mcap.writer import CompressionType, Writer

from onboard.journal import Record

# A killed daemon loses at most one unfinished chunk.
_CHUNK_BYTES: Final = 64 * 1024
_SCHEMA: Final = json.dumps({"type": "object"}).encode()


class FlightLog:
    """Writes records to an MCAP file.

    Args:
        path: the file, overwritten.
        metadata: strings that say what flew: contract and its hash, versions, seed.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="clearway", library="clearway")
        self._writer.add_metadata("clearway", dict(metadata))
        self._channels: dict[str, tuple[int, int]] = {}

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
        """Append records, in the order of their ticks."""
        for record in records:
            self._write(record.topic, record.time_unix_s, record.payload)

    def close(self) -> None:
        """Finish the file; it can be read without this, only not searched."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap left it untyped
        self._file.close()

    def _write(self, topic: str, time_unix_s: float, payload: Mapping[str, Any]) -> None:
        if topic not in self._channels:
            schema = self._writer.register_schema(f"clearway.{topic}", "jsonschema", _SCHEMA)
            self._channels[topic] = (self._writer.register_channel(f"/{topic}", "json", schema), 0)
        channel, sequence = self._channels[topic]
        self._channels[topic] = (channel, sequence + 1)
        time_ns = round(time_unix_s * 1e6) * 1000
        data = json.dumps(payload, separators=(",", ":"), allow_nan=False).encode()
        self._writer.add_message(channel, time_ns, data, time_ns, sequence)
