"""Faults of the MAVLink connection between vehicle and service, and of what is reported on it."""

from __future__ import annotations

import random
from typing import Final, Literal

from pymavlink.dialects.v20 import common as mavlink

from sitl.environment.imperfect_link import ImperfectLink, LinkConfig
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import FaultKind

Way = Literal["up", "down"]  # to the vehicle, and from it

# How fast a misreported position drifts; the service takes a faster change for a reset.
MISREPORTED_DRIFT_MPS: Final = 0.5
# Only the position is given.
_RIVAL_TYPE_MASK: Final = 0x0DF8

# On which ways a kind lets nothing pass.
SILENCED: Final[dict[FaultKind, frozenset[Way]]] = {
    "telemetry_lost": frozenset({"down"}),
    "setpoints_lost": frozenset({"up"}),
    "link_partitioned": frozenset({"up", "down"}),
}
# Which key of `LinkConfig` a kind sets, on both ways.
LINK_KEYS: Final[dict[FaultKind, str]] = {
    "link_lossy": "loss",
    "link_duplicating": "duplication",
    "link_reordering": "reordering",
    "link_corrupting": "corruption",
}
# What changes the content of telemetry; a reset moves setpoints as well.
REPORTS: Final[tuple[FaultKind, ...]] = (
    "position_reset",
    "position_misreported",
    "attitude_stuck",
    "heartbeats_lost",
    "telemetry_corrupted",
)
KINDS: Final[frozenset[FaultKind]] = frozenset(
    (*SILENCED, *LINK_KEYS, *REPORTS, "second_commander")
)


class MavlinkFaults:
    """Apply the faults of MAVLink.

    Args:
        schedule: what is present.
    """

    def __init__(self, schedule: FaultSchedule) -> None:
        self._schedule = schedule
        self._codec = _Codec()
        self._misreported_m = 0.0
        self._advanced_s = 0.0
        self._links: dict[Way, dict[FaultKind, ImperfectLink]] = {
            way: _imperfect_links(schedule, way) for way in ("up", "down")
        }

    def telemetry(self, data: bytes) -> bytes:
        """Return what the service receives of what the vehicle sent; called once a tick."""
        if self._is_idle("down"):
            self._advanced_s = self._schedule.now_s
            return data
        data = self._carried("down", data)
        self._drift()
        if self._is_silent("down"):
            return b""
        data = self._corrupted(data)
        jump_east_m = self._schedule.amount("position_reset") or 0.0
        east_m = jump_east_m or self._misreported_m
        level = self._schedule.present("attitude_stuck")
        mute = self._schedule.present("heartbeats_lost")
        if east_m == 0.0 and not (level or mute):
            return data
        return self._codec.with_reports(data, east_m, jump_east_m, level=level, mute=mute)

    def setpoints(self, data: bytes) -> bytes:
        """Return what the vehicle receives of what the service sent."""
        if self._is_idle("up"):
            return data
        data = self._carried("up", data)
        if self._is_silent("up"):
            return b""
        jump_east_m = self._schedule.amount("position_reset")
        return data if jump_east_m is None else self._codec.with_targets(data, -jump_east_m)

    def second_commander(self) -> bytes:
        """Return what a second commander sends to the vehicle now."""
        present = self._schedule.present("second_commander")
        return self._codec.rival_setpoint() if present else b""

    def _is_idle(self, way: Way) -> bool:
        """Tell whether nothing is present, and nothing is left of what was: as in most ticks."""
        left = self._links[way] or self._misreported_m != 0.0
        return not (left or self._schedule.any_present)

    def _is_silent(self, way: Way) -> bool:
        return any(way in ways and self._schedule.present(kind) for kind, ways in SILENCED.items())

    def _carried(self, way: Way, data: bytes) -> bytes:
        """Send a datagram over the imperfect links that are present; return what arrives now."""
        now_s = self._schedule.now_s
        for kind, link in self._links[way].items():
            if self._schedule.present(kind):
                link.send(data, now_s)
                data = b""
            data = b"".join(link.receive(now_s)) + data
        return data

    def _corrupted(self, data: bytes) -> bytes:
        share, chance = self._schedule.amount("telemetry_corrupted"), self._schedule.chance
        if share is None or not data or chance.random() >= share:
            return data
        corrupted = bytearray(data)
        corrupted[chance.randrange(len(corrupted))] ^= 1 << chance.randrange(8)
        return bytes(corrupted)

    def _drift(self) -> None:
        """Move the misreported position towards its amount, or back to the truth."""
        passed_s = self._schedule.now_s - self._advanced_s
        self._advanced_s = self._schedule.now_s
        step_m = MISREPORTED_DRIFT_MPS * passed_s
        missing_m = (self._schedule.amount("position_misreported") or 0.0) - self._misreported_m
        self._misreported_m += min(max(missing_m, -step_m), step_m)


def _imperfect_links(schedule: FaultSchedule, way: Way) -> dict[FaultKind, ImperfectLink]:
    """Return one link for each fault that needs one, with a seed of its own."""
    return {
        fault.kind: ImperfectLink(
            LinkConfig.model_validate({LINK_KEYS[fault.kind]: fault.value}),
            random.Random(f"link {way} {fault.kind} {schedule.seed}"),
        )
        for fault in schedule.faults
        if fault.kind in LINK_KEYS
    }


class _Codec:
    """Read and rewrite MAVLink between two peers."""

    def __init__(self) -> None:
        self._vehicle = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._vehicle.robust_parsing = True
        self._service = mavlink.MAVLink(None)
        self._service.robust_parsing = True
        self._rival = mavlink.MAVLink(None, 1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)

    def with_reports(
        self, data: bytes, east_m: float, target_east_m: float, *, level: bool, mute: bool
    ) -> bytes:
        """Return telemetry with positions and targets moved to the east.

        Args:
            data: whole frames.
            east_m: by which the vehicle's position moves.
            target_east_m: by which the setpoint that the autopilot echoes moves.
            level: whether to report a level attitude.
            mute: whether to drop heartbeats.
        """
        changed = bytearray()
        for message in self._vehicle.parse_buffer(data) or []:
            kind = message.get_type()
            if kind == "HEARTBEAT" and mute:
                continue
            if kind == "LOCAL_POSITION_NED":
                message.y += east_m
            elif kind == "POSITION_TARGET_LOCAL_NED":
                message.y += target_east_m
            elif kind == "ATTITUDE" and level:
                message.roll = message.pitch = 0.0
            else:
                changed += message.get_msgbuf()
                continue
            changed += message.pack(self._vehicle)
        return bytes(changed)

    def with_targets(self, data: bytes, east_m: float) -> bytes:
        """Return the service's messages with target positions moved to the east.

        A vehicle whose estimate has jumped flies to where its estimate says, not to where it is.
        """
        changed = bytearray()
        for message in self._service.parse_buffer(data) or []:
            if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
                changed += message.get_msgbuf()
                continue
            message.y += east_m
            sender = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
            sender.seq = message.get_seq()
            changed += message.pack(sender)
        return bytes(changed)

    def rival_setpoint(self) -> bytes:
        """Return a setpoint of another companion computer: stay at the origin, on the ground."""
        message = self._rival.set_position_target_local_ned_encode(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, _RIVAL_TYPE_MASK, *(0.0,) * 11
        )
        packed: bytes = message.pack(self._rival)
        return packed
