"""Collects what is shown of the obstacles to others, at its rate, without I/O."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from onboard.files.daemon_config import ObstacleOutputs
from onboard.mavlink.transmitter import Transmitter
from onboard.obstacle_outputs.markers import markers
from onboard.obstacle_outputs.sectors import sectors_cm
from onboard.recording.messages import Obstacles, Outline, Record, StateRecord
from onboard.recording.mover_record import MoversRecord, box_at


class Shown(NamedTuple):
    """What is to be sent after a tick.

    Attributes:
        to_ground: MAVLink for the link to a ground station.
        markers: payload of a MarkerArray; None if none is due.
    """

    to_ground: bytes
    markers: bytes | None


class ObstaclePublisher:
    """Makes messages of the records of each tick.

    Args:
        config: what is wanted.
        system_id: MAVLink id of the vehicle.
        vehicle_link: sends to the autopilot, where that is asked for.
    """

    def __init__(self, config: ObstacleOutputs, system_id: int, vehicle_link: Transmitter) -> None:
        self._config, self._ground = config, Transmitter(system_id)
        self._vehicle_link = vehicle_link
        self._obstacles: Obstacles | None = None
        self._movers: MoversRecord | None = None
        self._sectors_due_s = self._markers_due_s = -math.inf

    def collect(self, records: Iterable[Record], now_s: float) -> Shown:
        """Return what the records of a tick leave to be sent.

        Args:
            records: of the tick.
            now_s: its time.
        """
        state = None
        for record in records:
            if isinstance(record, Obstacles):
                self._obstacles = record
            elif isinstance(record, MoversRecord):
                self._movers = record
            elif isinstance(record, StateRecord):
                state = record
        self._send_sectors(state, now_s)
        return Shown(self._ground.bytes_to_send(), self._markers(state, now_s))

    def _send_sectors(self, state: StateRecord | None, now_s: float) -> None:
        config = self._config.obstacle_distance
        if config is None:
            return
        through = self._vehicle_link if config.through_autopilot else self._ground
        if not config.through_autopilot:
            self._ground.keep_alive(now_s, active=True)
        if state is None or state.position_ned_m is None or state.yaw_rad is None:
            return
        if now_s >= self._sectors_due_s:
            self._sectors_due_s = now_s + 1.0 / config.rate_hz
            outlines = self._outlines(state.time_s)
            through.send_obstacle_distance(
                sectors_cm(outlines, state.position_ned_m, state.yaw_rad), state.time_s
            )

    def _outlines(self, time_s: float) -> Iterator[Outline]:
        """Yield what obstacles fill, and where movers may be by now: none of them is missing."""
        if self._obstacles is not None:
            yield from (each.measured_ned_m for each in self._obstacles.obstacles)
        if (known := self._movers) is not None:
            yield from (box_at(each, time_s, known.stamp_error_s) for each in known.movers)

    def _markers(self, state: StateRecord | None, now_s: float) -> bytes | None:
        config = self._config.markers
        if config is None or state is None or now_s < self._markers_due_s:
            return None
        self._markers_due_s = now_s + 1.0 / config.rate_hz
        known = [] if self._obstacles is None else self._obstacles.obstacles
        height_m = None if self._obstacles is None else self._obstacles.height_m
        now = Obstacles(time_s=state.time_s, height_m=height_m, obstacles=known)
        return markers(now, config.frame_id, self._movers)
