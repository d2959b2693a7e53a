"""Reads recordings of messages: ROS 2 bags (SQLite, MCAP), MCAP files, and our own flight logs.

A bag is a folder with ``metadata.yaml`` that names its files (rosbag2).  MCAP is read by the `mcap`
library, the tables of a SQLite file by `sqlite3` (rosbag2_storage_sqlite3: ``topics``,
``messages``).
"""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import yaml
from mcap.reader import NonSeekingReader, make_reader
from mcap.summary import Summary
from zstandard import ZstdDecompressor, ZstdError

from gcs_tools.console.errors import CommandError
from gcs_tools.logs.flight_log import DAMAGED
from onboard.files.yaml_file import read_text
from onboard.recording.flight_log import MAVLINK_ENCODING

# The type of the raw MAVLink of our own flight logs.
MAVLINK: Final = "mavlink"
_METADATA: Final = "metadata.yaml"
_MCAP: Final = ".mcap"
_SQLITE: Final = ".db3"
_LOOKED_AT: Final = 10_000
_MESSAGE_BYTES_MAX: Final = 100_000_000


class RecordedMessage(NamedTuple):
    """One message.

    Attributes:
        time_unix_s: when it was recorded.
        topic: with its slash.
        type_name: such as ``sensor_msgs/LaserScan``, or `MAVLINK`.
        payload: CDR with its header, or MAVLink.
    """

    time_unix_s: float
    topic: str
    type_name: str
    payload: bytes


@dataclass
class Recording:
    """A recording on disk.

    Attributes:
        path: as it was given.
        parts: its files, in order.
        topics: type of each topic.
        per_message: whether each message is compressed by itself (Zstandard).
        problems: what could not be read, one sentence each.
    """

    path: Path
    parts: tuple[Path, ...]
    topics: dict[str, str] = field(default_factory=dict)
    per_message: bool = False
    problems: list[str] = field(default_factory=list)

    def messages(self) -> Iterator[RecordedMessage]:
        """Yield the messages in the order in which they were recorded.

        Where a file is damaged, what comes before the damage counts, and a problem is noted.
        """
        for part in self.parts:
            read = _read_mcap if part.suffix == _MCAP else _read_sqlite
            try:
                for message in read(part):
                    payload = self._whole(message.payload)
                    if payload is not None:
                        yield message._replace(payload=payload)
            except (*DAMAGED, sqlite3.Error) as error:
                self.problems.append(
                    f"{part}: damaged from here on: {error or type(error).__name__}"
                )

    def _whole(self, payload: bytes) -> bytes | None:
        if not self.per_message:
            return payload
        try:
            return ZstdDecompressor().decompress(payload, max_output_size=_MESSAGE_BYTES_MAX)
        except ZstdError:
            self.problems.append("a message cannot be decompressed")
            return None


def open_recording(path: Path) -> Recording:
    """Find the files of a recording and the types of its topics.

    Raises:
        CommandError: it is missing, or neither a bag nor MCAP.
        FileError: its ``metadata.yaml`` cannot be used.
    """
    parts, per_message = _parts(path)
    recording = Recording(path, parts, per_message=per_message)
    for part in parts:
        find = _mcap_topics if part.suffix == _MCAP else _sqlite_topics
        try:
            recording.topics |= find(part)
        except OSError as error:
            raise CommandError(f"{part}: cannot be read: {error.strerror or error}") from error
        except (*DAMAGED, sqlite3.Error) as error:
            kind = "an MCAP file" if part.suffix == _MCAP else "a bag of SQLite"
            reason = str(error) or type(error).__name__
            raise CommandError(f"{part}: is not {kind}: {reason}") from error
    return recording


def _parts(path: Path) -> tuple[tuple[Path, ...], bool]:
    """Return the files of a recording, and whether each message is compressed."""
    if path.is_dir():
        metadata = path / _METADATA
        if metadata.exists():
            return _named_parts(metadata)
        parts = tuple(sorted(each for each in path.iterdir() if each.suffix in {_MCAP, _SQLITE}))
        if not parts:
            raise CommandError(f"{path}: has neither {_METADATA} nor a file {_SQLITE} or {_MCAP}")
        return parts, False
    beside = path.parent / _METADATA
    _check_name(path)
    return (path,), _is_per_message(beside) if beside.exists() else False


def _named_parts(metadata: Path) -> tuple[tuple[Path, ...], bool]:
    names = _information(metadata).get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise CommandError(f"{metadata}: relative_file_paths names no file")
    # Some recorders write the folder's own name before each.
    parts = tuple(metadata.parent / Path(str(name)).name for name in names)
    for part in parts:
        _check_name(part)
    return parts, _is_per_message(metadata)


def _check_name(path: Path) -> None:
    if path.suffix == ".zstd":
        raise CommandError(f"{path}: is compressed as a whole: zstd -d {path.name}")
    if path.suffix not in {_MCAP, _SQLITE}:
        raise CommandError(f"{path}: expected a bag's folder, a file {_SQLITE} or {_MCAP}")
    if not path.is_file():
        raise CommandError(f"{path}: cannot be read: No such file or directory")


def _is_per_message(metadata: Path) -> bool:
    return str(_information(metadata).get("compression_mode", "")).lower() == "message"


def _information(metadata: Path) -> dict[str, Any]:
    """Return what rosbag2 says of a bag, whose numbers have more digits than those of our files."""
    try:
        document = yaml.safe_load(read_text(metadata))
    except yaml.YAMLError as error:
        raise CommandError(f"{metadata}: is not YAML: {' '.join(str(error).split())}") from error
    found = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    return found if isinstance(found, dict) else {}


def _plain(type_name: str) -> str:
    """Return the name of a type without ROS 2's ``/msg/``."""
    return type_name.replace("/msg/", "/")


def _mcap_topics(path: Path) -> dict[str, str]:
    found: dict[str, str] = {}
    with path.open("rb") as file:
        summary = _summary(file)
        channels, schemas = ({}, {}) if summary is None else (summary.channels, summary.schemas)
        for channel in channels.values():
            schema = schemas.get(channel.schema_id)
            name = _type_of(channel.message_encoding, "" if schema is None else schema.name)
            if name is not None:
                found[channel.topic] = name
    if summary is not None:
        return found
    try:
        # Without an index; the first messages tell.
        for message in itertools.islice(_read_mcap(path), _LOOKED_AT):
            found[message.topic] = message.type_name
    except DAMAGED:
        if not found:
            raise
    return found


def _summary(file: IO[bytes]) -> Summary | None:
    """Return the index of a file; None where it has none, or the file is cut."""
    try:
        found = make_reader(file).get_summary()
    except DAMAGED:
        return None
    return found if found is not None and found.channels else None


def _type_of(encoding: str, schema: str) -> str | None:
    """Return the type of a channel; None where its messages are of no use here."""
    if encoding == MAVLINK_ENCODING:
        return MAVLINK
    return _plain(schema) if encoding == "cdr" else None


def _read_mcap(path: Path) -> Iterator[RecordedMessage]:
    with path.open("rb") as file:
        whole = _summary(file) is not None
        file.seek(0)
        # Without an index, in the order of the file, up to the damage.
        reader = make_reader(file) if whole else NonSeekingReader(file)
        for schema, channel, message in reader.iter_messages(log_time_order=whole):
            name = _type_of(channel.message_encoding, "" if schema is None else schema.name)
            if name is not None:
                yield RecordedMessage(message.log_time * 1e-9, channel.topic, name, message.data)


def _connect(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)


def _sqlite_topics(path: Path) -> dict[str, str]:
    connection = _connect(path)
    try:
        rows = connection.execute("SELECT name, type FROM topics WHERE serialization_format='cdr'")
        return {str(name): _plain(str(type_name)) for name, type_name in rows}
    finally:
        connection.close()


def _read_sqlite(path: Path) -> Iterator[RecordedMessage]:
    connection = _connect(path)
    try:
        rows = connection.execute(
            "SELECT m.timestamp, t.name, t.type, m.data FROM messages m JOIN topics t"
            " ON m.topic_id = t.id WHERE t.serialization_format='cdr' ORDER BY m.timestamp, m.id"
        )
        for time_ns, topic, type_name, data in rows:
            yield RecordedMessage(int(time_ns) * 1e-9, str(topic), _plain(str(type_name)), data)
    finally:
        connection.close()
