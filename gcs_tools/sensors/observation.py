"""What arrives from each sensor of a daemon's file: read by the daemon's own sources, without I/O.

The place does not matter for what a sensor sees around the body, so that without telemetry the
vehicle counts as standing level.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from onboard.files.daemon_config import DaemonConfig
from onboard.files.json_payload import MalformedPayloadError
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.perception.detection import DetectionFrame
from onboard.perception.intake import DetectionCounters
from onboard.perception.pose_history import PoseHistory
from onboard.perception.ros2.cdr import CdrReader, DecodeError
from onboard.perception.ros2.graph import Publisher
from onboard.perception.ros2.keys import decode_attachment
from onboard.perception.ros2.messages import Header, read_header
from onboard.perception.sensor_channels import SensorChannels
from onboard.perception.sources.json_v1 import parse_frame
from onboard.perception.sources.registry import mavlink_ids_of, zenoh_key
from onboard.perception.sources.sensor_input import PosesByStamp
from onboard.perception.sources.traffic import ORIGIN
from onboard.recording.messages import SensorRecord
from onboard.vehicle_state import Pose

# The daemon remembers poses for so long.
_STAMP_AGE_MAX_S: Final = 2.0
_STAMP_AHEAD_MAX_S: Final = 0.1
_NAMES_MAX: Final = 20
# Of what is not configured; names of topics are bounded by Zenoh, their number by this.
STRAYS_MAX: Final = 100


@dataclass
class Heard:
    """What one sensor has sent.

    Attributes:
        arrivals_s: of its messages, on the check's clock.
        frames: what it saw, with the time of arrival, by this computer's clock.
        frame_ids: that its messages name.
        ahead_s: stamps less arrivals.
        publishers: ids of who sent it, in hexadecimal.
        refused: messages that cannot be used, by reason.
        taken_by_json: frames of JSON detections under its name, which the daemon drops.
        from_daemon: what a daemon that runs says of it; None if none does.
    """

    arrivals_s: list[float] = field(default_factory=list)
    frames: list[DetectionFrame] = field(default_factory=list)
    frame_ids: set[str] = field(default_factory=set)
    ahead_s: list[float] = field(default_factory=list)
    publishers: set[str] = field(default_factory=set)
    refused: Counter[str] = field(default_factory=Counter)
    taken_by_json: int = 0
    from_daemon: SensorRecord | None = None

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 of fewer than two."""
        lasting_s = self.arrivals_s[-1] - self.arrivals_s[0] if self.arrivals_s else 0.0
        return (len(self.arrivals_s) - 1) / lasting_s if lasting_s > 0.0 else 0.0

    def note_stamp(self, header: Header, now_unix_s: float) -> None:
        """Take note of what a message says of its frame and time."""
        if len(self.frame_ids) < _NAMES_MAX:
            self.frame_ids.add(header.frame_id)
        self.ahead_s.append(header.stamp_unix_s - now_unix_s)


@dataclass
class Surroundings:
    """What else was heard, to say why a sensor is not.

    Attributes:
        keys: Zenoh keys that fit a topic, but not the keys of the daemon's file.
        publishers: that ROS 2 announces.
        peers: number of Zenoh peers and routers that have joined.
        vehicles: names under which JSON detections were published.
        link_problem: why the vehicle's link could not be opened; None if it is open.
        daemon_runs: whether a daemon of this vehicle was heard.
    """

    keys: set[str] = field(default_factory=set)
    publishers: set[Publisher] = field(default_factory=set)
    peers: int = 0
    vehicles: set[str] = field(default_factory=set)
    link_problem: str | None = None
    daemon_runs: bool = False


class _LevelWithoutTelemetry:
    """Past poses; where no telemetry has arrived, a body at rest that stands level.

    Args:
        poses: of the telemetry.
        epoch_unix_s: Unix time at zero of the clock.

    Attributes:
        now_s: the time, on the clock.
    """

    def __init__(self, poses: PoseHistory, epoch_unix_s: float) -> None:
        self.now_s = 0.0
        self._known, self._epoch_unix_s = poses, epoch_unix_s
        self._by_stamp = PosesByStamp(poses, lambda: epoch_unix_s)

    @property
    def generation(self) -> int:
        """Changes whenever the local frame has moved."""
        return self._known.generation

    def at(self, stamp_unix_s: float) -> Pose:
        """Return the pose at a time.

        Raises:
            DecodeError: the daemon would not know it.
        """
        if not self._known.is_empty:
            return self._by_stamp.at(stamp_unix_s)
        time_s = stamp_unix_s - self._epoch_unix_s
        if not -_STAMP_AGE_MAX_S <= time_s - self.now_s <= _STAMP_AHEAD_MAX_S:
            raise DecodeError("no pose at its stamp")
        return Pose(time_s, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


class SensorObserver:
    """Reads what arrives as the daemon would, and keeps what it was.

    Args:
        config: the daemon's file.
        epoch_unix_s: Unix time at zero of the clock of ``now_s``.

    Attributes:
        heard: by the name of the sensor; JSON detections by their source.
        around: what else was heard.
        link: the vehicle's.
    """

    def __init__(self, config: DaemonConfig, epoch_unix_s: float) -> None:
        self.heard = {source.name: Heard() for source in config.sources}
        self.around = Surroundings()
        self.link = MavlinkEndpoint(config.mavlink.system_id)
        self.malformed_json: Counter[str] = Counter()
        self._epoch_unix_s, self._vehicle = epoch_unix_s, config.vehicle
        self._history = PoseHistory()
        self._poses = _LevelWithoutTelemetry(self._history, epoch_unix_s)
        self._channels = SensorChannels(config.sources, self._poses, DetectionCounters())
        self.link.range_messages = self._channels.mavlink_ids
        self.link.listen_to_traffic(self._channels.traffic_ids)
        self._keys = {source.name: zenoh_key(source) for source in config.sources}

    def receive_mavlink(self, data: bytes, now_s: float) -> None:
        """Take bytes from the vehicle's link."""
        before = self.link.pose
        self.link.receive(data, now_s)
        if self.link.pose is not None and self.link.pose is not before:
            self._history.add(self.link.pose)
        for message_id, frame in (*self.link.take_ranges(), *self.link.take_traffic()):
            self._channels.receive_mavlink(message_id, frame, now_s)
            for name, sensor in self._channels.sensors.items():
                if message_id in mavlink_ids_of(sensor.config) - {ORIGIN}:
                    self.heard[name].arrivals_s.append(now_s)

    def receive_sample(
        self, name: str, payload: bytes, now_s: float, *, key: str, attachment: bytes
    ) -> None:
        """Take a sample of a sensor's own key."""
        heard = self.heard[name]
        heard.arrivals_s.append(now_s)
        try:
            heard.note_stamp(read_header(CdrReader(payload)), self._epoch_unix_s + now_s)
            if attachment and len(heard.publishers) < _NAMES_MAX:
                heard.publishers.add(decode_attachment(attachment).publisher.hex())
        except DecodeError:
            pass  # the sensor's own reader says why
        self._channels.receive(name, payload, now_s, key=key, attachment=attachment)

    def receive_transforms(self, name: str, payload: bytes, *, key: str) -> None:
        """Take a sample of the transforms that mount a sensor."""
        self._channels.receive_transforms(name, payload, key=key)

    def receive_stray(self, key: str) -> None:
        """Take note of a key that fits a topic, but is not that of the daemon's file."""
        if len(self.around.keys) < STRAYS_MAX:
            self.around.keys.add(key)

    def receive_json(self, vehicle: str, payload: bytes, now_s: float) -> None:
        """Take a frame of JSON detections, published under the name of a vehicle."""
        if vehicle != self._vehicle:
            if len(self.around.vehicles) < STRAYS_MAX:
                self.around.vehicles.add(vehicle)
            return
        try:
            frame = parse_frame(payload)
        except MalformedPayloadError as error:
            self.malformed_json[str(error)[:200]] += 1
            return
        if frame.source in self._keys:
            self.heard[frame.source].taken_by_json += 1
        elif frame.source in self.heard or len(self.heard) < STRAYS_MAX:
            heard = self.heard.setdefault(frame.source, Heard())
            heard.arrivals_s.append(now_s)
            heard.ahead_s.append(frame.stamp_unix_s - self._epoch_unix_s - now_s)
            heard.frames.append(frame)

    def receive_status(self, sensors: dict[str, SensorRecord]) -> None:
        """Take what a daemon that runs says of its sensors."""
        self.around.daemon_runs = True
        for name, heard in self.heard.items():
            heard.from_daemon = sensors.get(name, heard.from_daemon)

    def tick(self, now_s: float) -> None:
        """Have what has arrived read."""
        self._poses.now_s = now_s
        for frame in self._channels.take(self._epoch_unix_s):
            self.heard[frame.source].frames.append(frame)
        for name, sensor in self._channels.sensors.items():
            self.heard[name].refused = sensor.input.refused.copy()

    @property
    def has_telemetry(self) -> bool:
        """Whether the vehicle's pose is known."""
        return not self._history.is_empty

    def hears_vehicle(self) -> bool:
        """Whether the vehicle's heartbeat has arrived."""
        return math.isfinite(self.link.status.heard_s)


def ages_s(ahead_s: Iterable[float]) -> tuple[float, float]:
    """Return the least and the greatest age of stamps on arrival."""
    values = [-each for each in ahead_s]
    return min(values, default=math.nan), max(values, default=math.nan)
