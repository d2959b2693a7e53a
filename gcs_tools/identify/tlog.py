"""MAVLink logs (``.tlog``) of the daemon or of a ground station, with one vehicle or several.

A sequence of entries: Unix time in microseconds, eight bytes, big-endian; then one MAVLink frame.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.streams import POSES_MIN, Streams, Timeline, in_order, reference_in_order
from onboard.files.mavlink_frames import frame_length
from onboard.geometry.frames import FloatArray
from onboard.mavlink.profiles.registry import OTHER, profile_of

_STAMP: Final = struct.Struct(">Q")
_MARKERS: Final = (mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2)
# Of a setpoint's mask, after nine bits for position, velocity and acceleration.
_YAW_BIT: Final = 10
# Target system of a broadcast.
_BROADCAST: Final = 0
# Columns of a reference, after time and position, that PX4's controller overwrites.
_CONTROLLERS: Final = slice(4, 10)
_UNKNOWN: Final = float("nan")
_PX4_ECHO: Final = (
    "this log lacks velocity error, attitude lag and commanded tilt: PX4's "
    "POSITION_TARGET_LOCAL_NED has the commanded position, but its controller's velocity"
)


def is_tlog(data: bytearray) -> bool:
    """Tell whether a file holds at least one intact entry."""
    return next(_messages(data), None) is not None


def is_raw_capture(data: bytearray) -> bool:
    """Tell whether MAVLink frames follow each other without times."""
    length = frame_length(data, 0, mavlink.mavlink_map) or 0
    return 0 < length < len(data) and data[length] in _MARKERS


def streams_of_tlog(data: bytearray, source: str, system_id: int | None) -> Streams:
    """Return the time series of the one vehicle of a log that flew on setpoints.

    Args:
        data: the file; damaged parts are skipped.
        source: its name.
        system_id: MAVLink id of the vehicle; None where only one flies on setpoints.

    Raises:
        CommandError: no vehicle flew on setpoints, or several did and ``system_id`` is None.
    """
    vehicles = _vehicles(data)
    if not vehicles:
        raise CommandError(f"{source}: no flight to measure: no HEARTBEAT of PX4 or ArduPilot")
    if system_id is not None and system_id not in vehicles:
        raise CommandError(f"{source}: no vehicle {system_id}, only {_listed(vehicles)}")
    if system_id is None:
        flying = [number for number, vehicle in vehicles.items() if vehicle.flies]
        if len(flying) > 1:
            raise CommandError(
                f"{source}: vehicles {_listed(flying)} fly on setpoints: choose one with "
                "--system-id"
            )
        system_id = (flying or list(vehicles))[0]
    if len(vehicles) > 1:
        source = f"{source}, vehicle {system_id}"
    return vehicles[system_id].streams(source)


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


_Rows = list[tuple[float, ...]]


@dataclass
class _Vehicle:
    """Telemetry of one system and the setpoints sent to it; rows begin with their time.

    Attributes:
        poses, attitudes: as `Streams` wants them.
        echoes: the targets that the autopilot reports.
        beats: autopilot and mode of each HEARTBEAT of a known autopilot.
        told: complete setpoints, by the commander's system and component.
    """

    poses: _Rows = field(default_factory=list)
    attitudes: _Rows = field(default_factory=list)
    echoes: _Rows = field(default_factory=list)
    beats: list[tuple[float, int, int]] = field(default_factory=list)
    told: defaultdict[tuple[int, int], _Rows] = field(default_factory=lambda: defaultdict(list))

    @property
    def flies(self) -> bool:
        """Whether it followed setpoints for some time."""
        try:
            self.streams("").recording()
        except CommandError:
            return False
        return True

    def hear(self, time_s: float, m: Any) -> None:
        """Take a message of the system's autopilot."""
        match m.get_type():
            case "LOCAL_POSITION_NED":
                self.poses.append((time_s, m.x, m.y, m.z, m.vx, m.vy, m.vz))
            case "ATTITUDE":
                self.attitudes.append((time_s, m.roll, m.pitch, m.yaw))
            case "POSITION_TARGET_LOCAL_NED":
                self.echoes.append((time_s, *_reference_row(m)))
            case "HEARTBEAT" if profile_of(m.autopilot) is not OTHER:
                self.beats.append((time_s, m.autopilot, m.custom_mode))
            case _:
                pass

    def tell(self, time_s: float, m: Any) -> None:
        """Take a setpoint with position, velocity and acceleration; others are tracked worse."""
        row = _reference_row(m)
        if m.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED and np.isfinite(row[:9]).all():
            self.told[m.get_srcSystem(), m.get_srcComponent()].append((time_s, *row))

    def streams(self, source: str) -> Streams:
        reference, name, notes = self._reference()
        followed: _Rows = [
            (time_s, float(profile_of(autopilot).modes.is_external_control(mode)))
            for time_s, autopilot, mode in self.beats
        ]
        return Streams(
            source=source,
            pose=in_order(self.poses, 6),
            reference=reference,
            attitude=in_order(self.attitudes, 3),
            control=in_order(followed, 1),
            names=("LOCAL_POSITION_NED", name, "ATTITUDE", "HEARTBEAT"),
            notes=notes,
        )

    def _reference(self) -> tuple[FloatArray, str, tuple[str, ...]]:
        """Return the reference, its name in the log, and notes on what it lacks.

        The reference is the setpoints of the commander that sent most, if the log has them; else
        the targets that the autopilot reports.
        """
        sender, most = max(self.told.items(), key=lambda told: len(told[1]), default=(None, []))
        if len(most) >= POSES_MIN:
            several = f"several commanders sent setpoints; measured against those of {sender}"
            notes = (several,) if len(self.told) > 1 else ()
            return reference_in_order(most), "SET_POSITION_TARGET_LOCAL_NED", notes
        name = (
            "SET_POSITION_TARGET_LOCAL_NED with position, velocity and acceleration, and no "
            "POSITION_TARGET_LOCAL_NED with a position"
        )
        echoes = reference_in_order(self.echoes)
        if all(profile_of(beat[1]).target_gain_max_per_s == 0.0 for beat in self.beats):
            return echoes, name, ()
        echoes[:, _CONTROLLERS] = _UNKNOWN
        return echoes, name, (_PX4_ECHO,)


def _vehicles(data: bytearray) -> dict[int, _Vehicle]:
    """Return the vehicles with a known autopilot by their system id."""
    timeline, systems = Timeline(), defaultdict[int, _Vehicle](_Vehicle)
    told: list[tuple[float, Any]] = []
    for stamp_s, message in _messages(data):
        time_s = timeline.at(stamp_s)
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            if message.target_system == _BROADCAST:
                told.append((time_s, message))
            else:
                systems[message.target_system].tell(time_s, message)
        elif message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
            systems[message.get_srcSystem()].hear(time_s, message)
    vehicles = {number: system for number, system in systems.items() if system.beats}
    for time_s, message in told:
        for vehicle in vehicles.values():
            vehicle.tell(time_s, message)
    return vehicles


def _reference_row(m: Any) -> tuple[float, ...]:
    """Return position, velocity, acceleration and yaw; NaN for what the mask ignores."""
    values = (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw)
    bits = (*range(9), _YAW_BIT)
    return tuple(
        _UNKNOWN if m.type_mask >> bit & 1 else value
        for bit, value in zip(bits, values, strict=True)
    )


_WANTED: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    )
)


def _messages(data: bytearray) -> Iterator[tuple[float, Any]]:
    """Yield the intact messages of interest with their times; resynchronizes after damage.

    Frames of no interest are accepted if another entry follows; checking them would take longer.
    """
    codec, at = mavlink.MAVLink(None), _STAMP.size
    # An environment variable could make pymavlink accept damaged frames.
    mavlink.MAVLINK_IGNORE_CRC = False
    while at < len(data):
        length = frame_length(data, at, mavlink.mavlink_map) or 0
        message_id = _message_id(data, at) if length else None
        message = None
        if message_id in _WANTED:
            try:
                message = codec.decode(data[at : at + length])
            except mavlink.MAVError:
                length = 0
        elif not _another_follows(data, at + length):
            length = 0
        if message is not None:
            (stamp_us,) = _STAMP.unpack_from(data, at - _STAMP.size)
            yield stamp_us * 1e-6, message
        at += length + _STAMP.size if length else 1


def _message_id(data: bytearray, at: int) -> int:
    if data[at] == mavlink.PROTOCOL_MARKER_V1:
        return data[at + 5]
    return int.from_bytes(data[at + 7 : at + 10], "little")


def _another_follows(data: bytearray, end: int) -> bool:
    begin = end + _STAMP.size
    return begin >= len(data) or data[begin] in _MARKERS
