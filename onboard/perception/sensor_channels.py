"""Messages of the sensors of a daemon's file wait here until the next tick reads them.

What cannot be used is counted by sensor and reason, and said once: the first time.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from onboard.files.sensor_sources import AnySource, FieldFileSource, TrafficSource
from onboard.perception.detection import DetectionFrame
from onboard.perception.intake import DetectionCounters, Refusal
from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.keys import check_key
from onboard.perception.sources.field_file import Home, request_of
from onboard.perception.sources.mounted_by_transforms import MountedByTransforms
from onboard.perception.sources.registry import (
    MAVLINK_IDS,
    TRANSFORMS,
    Sensor,
    mavlink_ids_of,
    sensor,
)
from onboard.perception.sources.sensor_input import NO_POSE_YET, PastPoses

_TOO_FAST: Final = "comes faster than it is read"


class _Waiting(NamedTuple):
    payload: bytes
    arrived_s: float


class SensorChannels:
    """Latches messages of several sensors, and has them read.

    Args:
        configs: of the sensors, each with a name of its own.
        poses: of the body.
        counters: count what is dropped.

    Attributes:
        frames_read: number of frames of each sensor, by name.
        newest: the newest of them.
    """

    def __init__(
        self, configs: Sequence[AnySource], poses: PastPoses, counters: DetectionCounters
    ) -> None:
        self._sensors = {config.name: sensor(config, poses) for config in configs}
        self._pending: dict[str, deque[_Waiting]] = {name: deque() for name in self._sensors}
        self._counters = counters
        self.frames_read: Counter[str] = Counter()
        self.newest: dict[str, DetectionFrame] = {}
        self._measured: dict[str, int] = {}
        self._said: set[Refusal] = set()
        self._news: list[Refusal] = []

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """The sensors by name."""
        return self._sensors

    @property
    def mavlink_ids(self) -> frozenset[int]:
        """Messages of ranges on the MAVLink link that are read."""
        kinds = {each.config.kind for each in self._sensors.values()}
        return frozenset(number for kind, number in MAVLINK_IDS.items() if kind in kinds)

    @property
    def traffic_ids(self) -> frozenset[int]:
        """Messages of other vehicles on the MAVLink link that are read."""
        configs = [each.config for each in self._sensors.values()]
        traffic = (each for each in configs if isinstance(each, TrafficSource))
        return frozenset().union(*map(mavlink_ids_of, traffic))

    def receive(
        self, name: str, payload: bytes, now_s: float, *, key: str = "", attachment: bytes = b""
    ) -> None:
        """Latch one message.

        Args:
            name: of the sensor.
            payload: as it arrived.
            now_s: when.
            key: of its Zenoh sample.
            attachment: of its Zenoh sample.
        """
        sensor, pending = self._sensors[name], self._pending[name]
        try:
            sensor.check_sample(key, attachment, now_s)
        except DecodeError as error:
            self._refuse(name, error.reason)
            return
        if len(pending) == sensor.pending_max:
            pending.popleft()
            self._counters.dropped_frames += 1
            self._say(name, _TOO_FAST)
        pending.append(_Waiting(payload, now_s))

    def receive_transforms(self, name: str, payload: bytes, *, key: str = "") -> None:
        """Have one message of the transforms that mount a sensor read.

        At once: all that was latched comes together, and none of it comes again.

        Args:
            name: of the sensor.
            payload: as it arrived.
            key: of its Zenoh sample.
        """
        sensor = self._sensors[name]
        try:
            if getattr(sensor.config, "middleware", "") == "rmw_zenoh":
                check_key(key, TRANSFORMS)
        except DecodeError as error:
            self._refuse(name, f"transforms: {error.reason}")
            return
        if isinstance(sensor.input, MountedByTransforms):
            before = sensor.input.refused.copy()
            sensor.input.take_transforms(payload)
            self._count(name, before)

    def receive_mavlink(self, message_id: int, payload: bytes, now_s: float) -> None:
        """Latch one MAVLink frame for every sensor that reads its kind."""
        for name, each in self._sensors.items():
            if message_id in mavlink_ids_of(each.config):
                self.receive(name, payload, now_s)

    def measure_virtual(self, now_s: float, home_ned_m: Home | None) -> None:
        """Have virtual obstacles be seen, where it is time to.

        Args:
            now_s: the time.
            home_ned_m: where the vehicle was armed, north and east; None if that is unknown.
        """
        for name, each in self._sensors.items():
            config = each.config
            if not isinstance(config, FieldFileSource):
                continue
            due = math.floor(now_s * config.rate_hz + 1e-6)
            if due != self._measured.get(name):
                self._measured[name] = due
                self.receive(name, request_of(home_ned_m), now_s)

    def take(self, epoch_unix_s: float) -> Iterator[DetectionFrame]:
        """Decode what has arrived, in order for each sensor; of large messages one at a time.

        Args:
            epoch_unix_s: Unix time at zero of the service's clock.
        """
        for name, pending in self._pending.items():
            sensor = self._sensors[name]
            for _ in range(min(len(pending), 1) if sensor.is_large else len(pending)):
                waiting, before = pending.popleft(), sensor.input.refused.copy()
                frames = sensor.input.read(waiting.payload, epoch_unix_s + waiting.arrived_s)
                self._count(name, before)
                self.frames_read[name] += len(frames)
                if frames:
                    self.newest[name] = frames[-1]
                yield from frames

    def take_news(self) -> list[Refusal]:
        """Return and forget the refusals that have come for the first time."""
        news, self._news = self._news, []
        return news

    def _count(self, name: str, before: Counter[str]) -> None:
        """Count and say what a sensor has refused since."""
        for reason, count in (self._sensors[name].input.refused - before).items():
            self._counters.malformed_frames += count
            self._say(name, reason)

    def _refuse(self, name: str, reason: str) -> None:
        """Count and say a message that is dropped before it is read."""
        self._sensors[name].input.refuse(reason)
        self._counters.malformed_frames += 1
        self._say(name, reason)

    def _say(self, name: str, reason: str) -> None:
        refusal = Refusal(name, reason)
        if refusal not in self._said and reason != NO_POSE_YET:
            self._said.add(refusal)
            self._news.append(refusal)
