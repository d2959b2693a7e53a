"""Identifies the vehicle among the peers of a listening port: setpoints go to that one alone."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Hashable
from typing import Final, Generic, TypeVar

from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import frame_length

log = logging.getLogger(__name__)

# A vehicle that restarts on another port is recognized there after this much silence: three of its
# heartbeats, by when its telemetry has expired anyhow.
SILENCE_S: Final = 3.0

PeerT = TypeVar("PeerT", bound=Hashable)


class VehiclePeer(Generic[PeerT]):
    """Admits data only from the peer that first sent the vehicle's heartbeat.

    A heartbeat is the vehicle's if it comes from the autopilot component of its system id and its
    checksum is right.  Another peer that sends one is admitted instead only when the present peer
    has sent none for `SILENCE_S`, or has disconnected.

    Args:
        system_id: MAVLink id of the vehicle; None for whichever autopilot is heard.
        is_genuine: tells whether the signature of a whole frame permits to believe it.

    Attributes:
        peer: the vehicle; None before its first heartbeat.
        ignored: pieces of data of other peers that were dropped.
    """

    def __init__(
        self, system_id: int | None, is_genuine: Callable[[bytes], bool] = lambda _: True
    ) -> None:
        self.peer: PeerT | None = None
        self.ignored = 0
        self._system_id, self._is_genuine = system_id, is_genuine
        self._heard_s = -math.inf
        self._codec = mavlink.MAVLink(None)
        self._stranger_named = False

    def admit(self, data: bytes, peer: PeerT, now_s: float) -> bool:
        """Tell whether to read data; recognize the vehicle by its heartbeat.

        Before the vehicle is known, data of every peer are admitted.

        Args:
            data: as they arrived, beginning with a whole frame.
            peer: the sender.
            now_s: the time.
        """
        if self._has_heartbeat(data):
            self._hear_vehicle(peer, now_s)
        if self.peer is None or peer == self.peer:
            return True
        self.ignored += 1
        if not self._stranger_named:
            self._stranger_named = True
            log.warning(
                "%s also sends to this port and is ignored: vehicle %s is %s",
                _name(peer),
                self._system_id or "",
                _name(self.peer),
            )
        return False

    def forget(self, peer: PeerT) -> None:
        """Forget a peer that has disconnected; the next heartbeat identifies the vehicle."""
        if peer == self.peer:
            self.peer, self._heard_s = None, -math.inf

    def _hear_vehicle(self, peer: PeerT, now_s: float) -> None:
        if peer != self.peer:
            if self.peer is not None and now_s - self._heard_s <= SILENCE_S:
                return
            log.info("vehicle %s is %s", self._system_id or "", _name(peer))
            self.peer, self._stranger_named = peer, False
        self._heard_s = now_s

    def _has_heartbeat(self, data: bytes) -> bool:
        """Tell whether an intact, genuine heartbeat of the autopilot is among whole frames."""
        frames, start = bytearray(data), 0
        while start < len(frames):
            length = frame_length(frames, start, mavlink.mavlink_map)
            if length is None:
                return False
            frame = frames[start : start + length]
            if length and _is_heartbeat(frame, self._system_id) and _is_intact(frame, self._codec):
                return self._is_genuine(bytes(frame))
            start += length or 1
        return False


def _is_heartbeat(frame: bytearray, system_id: int | None) -> bool:
    if frame[0] == mavlink.PROTOCOL_MARKER_V1:
        sender, message_id = (frame[3], frame[4]), frame[5]
    else:
        sender, message_id = (frame[5], frame[6]), frame[7] | frame[8] << 8 | frame[9] << 16
    named = system_id in (None, sender[0]) and sender[1] == mavlink.MAV_COMP_ID_AUTOPILOT1
    return named and message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT


def _is_intact(frame: bytearray, codec: mavlink.MAVLink) -> bool:
    try:
        heartbeat = codec.decode(frame)
    except mavlink.MAVError:
        return False
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID)


def _name(peer: Hashable) -> str:
    if isinstance(peer, tuple) and len(peer) >= 2:
        host, port = peer[:2]
        return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"
    return str(peer)
