"""Feeds a recording through the daemon's own service in virtual time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final

from gcs_tools.replay.poses import PoseReader, Telemetry
from gcs_tools.replay.recording import MAVLINK, RecordedMessage
from gcs_tools.replay.sources import Setup
from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.sensor_sources import AnySource, Ros2Source
from onboard.monitoring.assumptions import check_frame
from onboard.perception.detection import DetectionFrame
from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.messages import read_header
from onboard.recording.journal import Journal
from onboard.recording.messages import Obstacles, Record

_HEARTBEAT_TICKS: Final = 50
_REST_TICKS: Final = 2
# A recording that pauses for longer is two of them: nothing happens in between.
_GAP_MAX_S: Final = 5.0
_NO_HASH: Final = "TypeHashNotSupported"


@dataclass
class Seen:
    """What one sensor showed.

    Attributes:
        messages: in the recording.
        first_s, last_s: arrival of the first and the last one.
        frames: that could be used.
        obstacles_min, obstacles_max: in one frame.
        range_min_m, view_min_deg: least range and view of a frame.
        latency_max_s: from a stamp to the arrival of its message, at most.
        violations: what frames violate of the contract, one sentence for each assumption.
        refused: messages that could not be used, by reason.
    """

    messages: int = 0
    first_s: float = math.inf
    last_s: float = -math.inf
    frames: int = 0
    obstacles_min: int = 0
    obstacles_max: int = 0
    range_min_m: float = math.inf
    view_min_deg: float = math.inf
    latency_max_s: float = -math.inf
    violations: dict[str, str] = field(default_factory=dict)
    refused: Counter[str] = field(default_factory=Counter)

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 of fewer than two."""
        lasting_s = self.last_s - self.first_s
        return (self.messages - 1) / lasting_s if self.messages > 1 and lasting_s > 0.0 else 0.0

    def take(self, frame: DetectionFrame) -> None:
        """Take one frame."""
        count = len(frame.obstacles)
        self.obstacles_min = min(self.obstacles_min, count) if self.frames else count
        self.obstacles_max = max(self.obstacles_max, count)
        self.range_min_m = min(self.range_min_m, frame.range_m)
        self.view_min_deg = min(self.view_min_deg, frame.field_of_view_deg)
        self.frames += 1


@dataclass
class Summary:
    """What the daemon saw of a recording.

    Attributes:
        sensors: by name.
        duration_s: of the recording.
        poses: messages that told one.
        poses_refused: messages that could not be used, by reason.
        obstacles: the map at the end; None if nothing was ever in it.
    """

    sensors: dict[str, Seen]
    duration_s: float = 0.0
    poses: int = 0
    poses_refused: Counter[str] = field(default_factory=Counter)
    obstacles: Obstacles | None = None


class Replay:
    """The daemon's service, and what is fed into it.

    Args:
        setup: what the recording is read with.
        begin_unix_s: time of its first message.
        ahead_s: of the stamps, to be taken off.
        take: takes the records of each tick.
    """

    def __init__(
        self,
        setup: Setup,
        begin_unix_s: float,
        ahead_s: float,
        take: Callable[[list[Record]], None],
    ) -> None:
        self._setup, self._begin_unix_s, self._take = setup, begin_unix_s, take
        self.summary = Summary({source.name: Seen() for source in setup.sources})
        system_id = setup.config.mavlink.system_id
        self._autonomy = Autonomy(
            setup.contract,
            setup.mission,
            epoch_unix_s=begin_unix_s + ahead_s,
            system_id=system_id,
            sensors=setup.sources,
        )
        self._journal = Journal(self._autonomy, timed=False)
        self._telemetry, self._poses = Telemetry(system_id), PoseReader()
        self._ticks = 0
        self._topics = _by_topic(setup.sources, lambda source: source.topic)
        self._mounting = _by_topic(setup.sources, lambda source: source.mounting.tf_topic)

    def run(self, messages: Iterable[RecordedMessage]) -> Summary:
        """Feed all messages, and return what was seen."""
        now_s = 0.0
        for message in messages:
            # Clocks of computers are set: what was recorded before is fed at once.
            at_s = max(message.time_unix_s - self._begin_unix_s, now_s)
            if at_s - now_s > _GAP_MAX_S:
                self._begin_unix_s += at_s - now_s - _GAP_MAX_S
                self._autonomy.set_epoch(self._autonomy.epoch_unix_s + at_s - now_s - _GAP_MAX_S)
                at_s = now_s + _GAP_MAX_S
            now_s = at_s
            while self._ticks * TICK_S < now_s:
                self._tick()
            self._feed(message, now_s)
        self._tick()
        self.summary.duration_s = now_s
        for name, sensor in self._autonomy.sensors.sensors.items():
            self.summary.sensors[name].refused = sensor.input.refused.copy()
        return self.summary

    def _feed(self, message: RecordedMessage, now_s: float) -> None:
        if message.type_name == MAVLINK:
            self._autonomy.receive_mavlink(message.payload, now_s)
            return
        if message.topic == self._setup.pose_topic:
            self._feed_pose(message, now_s)
        package, _, kind = message.type_name.partition("/")
        for source in self._mounting.get(message.topic, ()):
            key = f"0{message.topic}/{package}::msg::dds_::{kind}_/{_NO_HASH}"
            self._autonomy.sensors.receive_transforms(source.name, message.payload, key=key)
        for source in self._topics.get(message.topic, ()):
            key = f"{source.domain_id}{message.topic}/{package}::msg::dds_::{kind}_/{_NO_HASH}"
            self._autonomy.sensors.receive(source.name, message.payload, now_s, key=key)
            seen = self.summary.sensors[source.name]
            seen.messages += 1
            seen.first_s, seen.last_s = min(seen.first_s, now_s), now_s

    def _feed_pose(self, message: RecordedMessage, now_s: float) -> None:
        try:
            pose = self._poses.read(message.type_name, message.payload)
        except DecodeError as error:
            self.summary.poses_refused[error.reason] += 1
            return
        if pose is not None:
            self.summary.poses += 1
            self._autonomy.receive_mavlink(self._telemetry.of(pose, now_s), now_s)

    def _tick(self) -> None:
        now_s, autonomy = self._ticks * TICK_S, self._autonomy
        if not self._setup.raw_mavlink and self._ticks % _HEARTBEAT_TICKS == 0:
            autonomy.receive_mavlink(self._telemetry.heartbeat(), now_s)
        at_rest = self._setup.pose_topic is None and not self._setup.raw_mavlink
        if at_rest and self._ticks % _REST_TICKS == 0:
            autonomy.receive_mavlink(self._telemetry.at_rest(now_s), now_s)
        read = autonomy.sensors.frames_read.copy()
        autonomy.tick(now_s)
        autonomy.mavlink_to_send()
        for name in autonomy.sensors.frames_read - read:
            self._note(name, autonomy.sensors.newest[name], now_s)
        records = self._journal.collect(now_s)
        for record in records:
            if isinstance(record, Obstacles):
                self.summary.obstacles = record
        self._take(records)
        self._ticks += 1

    def _note(self, name: str, frame: DetectionFrame, now_s: float) -> None:
        seen = self.summary.sensors[name]
        seen.take(frame)
        late_s = self._autonomy.epoch_unix_s + now_s - frame.stamp_unix_s
        seen.latency_max_s = max(seen.latency_max_s, late_s)
        for violation in check_frame(frame, self._autonomy.assessment.terms):
            seen.violations[violation.assumption.value] = str(violation)


def first_stamp_ahead_s(messages: Iterable[RecordedMessage], topics: Iterable[str]) -> float:
    """Return by how much the first stamp of some topics is ahead of when it was recorded."""
    wanted = set(topics)
    for message in messages:
        if message.topic in wanted:
            try:
                header = read_header(CdrReader(message.payload))
            except DecodeError:
                continue
            return header.stamp_unix_s - message.time_unix_s
    return 0.0


def _by_topic(
    sources: Iterable[AnySource], topic_of: Callable[[Ros2Source], str | None]
) -> dict[str, list[Ros2Source]]:
    found: dict[str, list[Ros2Source]] = {}
    for source in sources:
        if isinstance(source, Ros2Source) and (topic := topic_of(source)) is not None:
            found.setdefault(f"/{topic.strip('/')}", []).append(source)
    return found
