"""A sensor that publishes what its rays meet, and not boxes: a lidar, a depth camera, a sonar."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.files.obstacle_field import FloatArray, ObstacleField
from sitl.environment.formats.ros2_topics import Ros2Publisher
from sitl.environment.mounted_beams import NOTHING, MountedBeams, PastTruths
from sitl.environment.movers.movers import Mover
from sitl.environment.ranging_formats import FORMATS, Measured
from sitl.environment.sensor import SensorConfig
from sitl.environment.sensor_message import LinkMessage, SensorMessage, ZenohMessage
from sitl.plant.truth import VehicleTruth

# How far from the sensor the parts of the vehicle are that hide a blind sector.
_OWN_PART_M: Final = 0.15


class RangingSensor:
    """Scan at its rate and hand out each message after its latency; no clock, no I/O.

    A scan ends when it is due and has begun ``scan_time_s`` before; its stamp is its begin.

    Args:
        config: of the sensor, which publishes anything but JSON.
        field: the obstacles.
        seed: of its noise.
        start_unix_s: Unix time at time zero.
        movers: what moves, which rays meet as they do obstacles.
    """

    def __init__(
        self,
        config: SensorConfig,
        field: ObstacleField,
        seed: int,
        start_unix_s: float = 0.0,
        movers: Sequence[Mover] = (),
    ) -> None:
        self.config, self._movers = config, movers
        self._format = FORMATS[config.publishes](config)
        azimuth_rad, elevation_rad = self._format.azimuth_rad, self._format.elevation_rad
        flat = np.cos(elevation_rad)
        directions = np.stack(
            (flat * np.cos(azimuth_rad), flat * np.sin(azimuth_rad), -np.sin(elevation_rad))
        )
        self._beams = MountedBeams(directions, config.mounting, field)
        self._hidden = _in_sectors(azimuth_rad, config.beams.blind_sectors_deg)
        self._truths = PastTruths(config.beams.scan_time_s)
        self._noise = np.random.default_rng([seed, *config.source.encode()])
        self.publisher: Ros2Publisher | None = None
        if config.publishes in ("laserscan", "pointcloud2", "range"):
            self.publisher = Ros2Publisher(config.ros2, config.publishes, config.source)
        self._start_unix_s = start_unix_s
        self._scans_due = 0
        self._last: SensorMessage | None = None
        self._in_flight: deque[tuple[float, SensorMessage]] = deque()

    @property
    def due_s(self) -> float:
        """When it finishes the next scan."""
        return self._scans_due / self.config.rate_hz

    def sense(self, now_s: float, truth: VehicleTruth) -> tuple[SensorMessage, ...]:
        """Scan if it is time to, and return the messages that leave the sensor by ``now_s``."""
        self._truths.add(truth)
        # The epsilon keeps a scan from slipping by one call when now_s carries round-off.
        if now_s >= self.due_s - 1e-9:
            self._scans_due = math.floor(now_s * self.config.rate_hz + 1e-6) + 1
            message = self._message(now_s)
            if message is not None:
                self._in_flight.append((now_s + self.config.latency_s, message))
        leaving = []
        while self._in_flight and self._in_flight[0][0] <= now_s + 1e-9:
            leaving.append(self._in_flight.popleft()[1])
        return tuple(leaving)

    def _message(self, now_s: float) -> SensorMessage | None:
        faults = {fault.kind: fault for fault in self.config.faults if fault.active(now_s)}
        if "silent" in faults:
            return None
        if "stuck" in faults:
            return self._last
        range_m = min(self.config.range_m, *(f.range_m for f in faults.values()), math.inf)
        scan = self._scan(now_s, range_m)
        if self.publisher is None:
            message = self._format.message(scan, self._start_unix_s, "")
            self._last = LinkMessage(self.config.source, message)
            return self._last
        payload = self._format.message(scan, self._start_unix_s, self.publisher.frame_id)
        attachment = self.publisher.attachment(self._start_unix_s + now_s)
        self._last = ZenohMessage(self.config.source, payload, self.publisher.key, attachment)
        return self._last

    def _scan(self, now_s: float, range_m: float) -> Measured:
        beams = self.config.beams
        begin_s = now_s - beams.scan_time_s
        times_s = begin_s + beams.scan_time_s * self._format.shares
        true_m = self._beams.ranges_m(self._truths, times_s, range_m, _boxes(self._movers))
        count = len(true_m)
        ranges_m = true_m + self._noise.normal(0.0, beams.range_noise_m, count)
        lost = (self._noise.random(count) < beams.dropout) | (ranges_m > range_m)
        ranges_m = np.where(lost, math.inf, np.maximum(ranges_m, 0.0))
        ranges_m[self._hidden] = _OWN_PART_M
        limits_m = (beams.range_min_m, self.config.range_m)
        return Measured(begin_s, ranges_m, self._hidden, limits_m)


def _boxes(movers: Sequence[Mover]) -> ObstacleField:
    """Return movers as the boxes that they are now."""
    if not movers:
        return NOTHING
    half_m = [mover.half_m for mover in movers]
    return ObstacleField(
        ids=tuple(mover.config.id for mover in movers),
        center_ned_m=np.array([mover.position_ned_m for mover in movers]),
        half_size_m=np.stack((half_m, half_m), axis=1),
        yaw_rad=np.zeros(len(movers)),
    )


def _in_sectors(
    azimuth_rad: FloatArray, sectors_deg: tuple[tuple[float, float], ...]
) -> NDArray[np.bool_]:
    hidden = np.zeros(len(azimuth_rad), np.bool_)
    for first_deg, last_deg in sectors_deg:
        into_deg = np.mod(np.degrees(azimuth_rad) - first_deg, 360.0)
        hidden |= into_deg <= (last_deg - first_deg) % 360.0
    return hidden
