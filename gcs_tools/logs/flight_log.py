"""Reads the MCAP logs of a flight, also those of a process that was killed while writing."""

from __future__ import annotations

import heapq
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Final

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from pydantic import TypeAdapter, ValidationError
from zstandard import ZstdError

from gcs_tools.console.errors import CommandError
from onboard.files.truth_record import TrueMoversRecord, TruthRecord
from onboard.recording.flight_log import FORMAT_VERSION
from onboard.recording.messages import (
    ADAPTERS,
    TOPICS,
    EventRecord,
    Margins,
    Monitors,
    Obstacles,
    PlanRecord,
    Record,
    SeenSpace,
    StateRecord,
)
from onboard.recording.mover_record import MoversRecord

_OURS: Final = "clearway"

# What a reader of MCAP raises on a file that is damaged or cut.
DAMAGED: Final = (McapError, ZstdError, struct.error, ValueError, KeyError)
# What `clearway export --foxglove` writes beside a log.
FOXGLOVE_SUFFIX: Final = ".foxglove.mcap"

# Attribute of `Log` by the type of its records.
_ATTRIBUTES: Final[dict[type[Any], str]] = {
    StateRecord: "states",
    Margins: "margins",
    Monitors: "monitors",
    Obstacles: "obstacles",
    PlanRecord: "plans",
    SeenSpace: "seen_spaces",
    MoversRecord: "movers",
    EventRecord: "events",
    TruthRecord: "truths",
    TrueMoversRecord: "true_movers",
}
_ADAPTERS: Final[dict[str, TypeAdapter[Any]]] = {
    **{f"/{topic}": ADAPTERS[record_type] for record_type, topic in TOPICS.items()},
    "/truth": TypeAdapter(TruthRecord),
    "/truth/movers": TypeAdapter(TrueMoversRecord),
}


@dataclass(frozen=True)
class Log:
    """A log in memory; the records of each type are in the order of the file.

    Attributes:
        states, margins, monitors, obstacles, plans, seen_spaces, movers, events: of the daemon.
        truths, true_movers: of the simulation.
        metadata: strings by name of the metadata record and key.
        complete: whether the file ends as it should.
        problems: what could not be read, one sentence each.
        malformed: how many records were left out, by topic.
    """

    states: Sequence[StateRecord] = ()
    margins: Sequence[Margins] = ()
    monitors: Sequence[Monitors] = ()
    obstacles: Sequence[Obstacles] = ()
    plans: Sequence[PlanRecord] = ()
    seen_spaces: Sequence[SeenSpace] = ()
    movers: Sequence[MoversRecord] = ()
    events: Sequence[EventRecord] = ()
    truths: Sequence[TruthRecord] = ()
    true_movers: Sequence[TrueMoversRecord] = ()
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    complete: bool = True
    problems: tuple[str, ...] = ()
    malformed: Mapping[str, int] = field(default_factory=dict)

    def in_order(self) -> Iterator[Record]:
        """Yield the daemon's records in the order of time, of one tick the state first."""
        topics: tuple[Sequence[Record], ...] = (
            *(self.states, self.margins, self.monitors),
            *(self.obstacles, self.plans, self.seen_spaces, self.movers, self.events),
        )
        yield from heapq.merge(*topics, key=lambda record: record.time_s)


def log_of(
    records: Iterable[Record | TruthRecord | TrueMoversRecord],
    *,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
) -> Log:
    """Return records of any types as a log."""
    by_attribute: defaultdict[str, list[Any]] = defaultdict(list)
    for record in records:
        by_attribute[_ATTRIBUTES[type(record)]].append(record)
    # Each list holds the records of its attribute's type.
    typed: dict[str, Any] = dict(by_attribute)
    return Log(metadata=metadata or {}, **typed)


def read_log(path: Path, watch: Callable[[int], None] = lambda _: None) -> Log:
    """Read the records of a log; of a file that is cut or damaged, those before the damage.

    Malformed records are left out and counted.  Raw MAVLink and the channels of other programs are
    ignored.

    Args:
        path: the file.
        watch: called now and then with the number of bytes read.

    Raises:
        CommandError: the file is missing or not MCAP.
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
    except DAMAGED as error:
        if not reading.records and not reading.metadata:
            reason = str(error) or "it breaks off in its first record"
            raise CommandError(f"{path}: is not a flight log: {reason}") from error
        problem = f"{path.name} breaks off before its end: shown is what was written until then"
    problems = (problem, *_version_problems(path, reading.metadata), *reading.malformed_counts())
    return replace(
        log_of(reading.records),
        metadata=reading.metadata,
        complete=not problem,
        problems=tuple(filter(None, problems)),
        malformed=reading.malformed,
    )


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    yield from StreamReader(file, validate_crcs=True).records


class _Reading:
    """What has been read so far."""

    def __init__(self) -> None:
        self.records: list[Any] = []
        self.metadata: dict[str, Mapping[str, str]] = {}
        self._our_schemas: set[int] = set()
        # Of every channel its topic, and None if its messages are not ours.
        self._topics: dict[int, str | None] = {}
        self._read: Counter[str] = Counter()
        self.malformed: Counter[str] = Counter()

    def take(self, record: McapRecord) -> None:
        match record:
            case Message():
                topic = self._topics[record.channel_id]
                if topic is not None:
                    self._take_message(topic, record.data)
            case Schema():
                if record.name.startswith(f"{_OURS}."):
                    self._our_schemas.add(record.id)
            case Channel():
                ours = record.schema_id in self._our_schemas and record.topic in _ADAPTERS
                self._topics[record.id] = record.topic if ours else None
            case Metadata():
                self.metadata[record.name] = record.metadata
            case _:
                pass

    def _take_message(self, topic: str, data: bytes) -> None:
        self._read[topic] += 1
        try:
            self.records.append(_ADAPTERS[topic].validate_json(data, strict=True))
        except ValidationError:
            self.malformed[topic] += 1

    def malformed_counts(self) -> Iterator[str]:
        for topic, count in self.malformed.items():
            yield f"{count} of {self._read[topic]} records of {topic} are malformed and left out"


def _version_problems(path: Path, metadata: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    written = metadata.get(_OURS, {}).get("format_version", str(FORMAT_VERSION))
    if not written.isdecimal() or int(written) > FORMAT_VERSION:
        yield (
            f"{path.name} has format {written}, and this program reads {FORMAT_VERSION}: "
            "a newer program may show more"
        )
