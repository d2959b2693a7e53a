"""MAVLink 2 message signing, as https://mavlink.io/en/guide/message_signing.html defines it.

A signed frame ends in 13 bytes: link id, time stamp (6 bytes, 10 us since 2015) and the first 48
bits of SHA-256 over key, frame, link id and time stamp.  What is signed here is a whole frame, so
that service and ground tools share it.
"""

from __future__ import annotations

import hashlib
import hmac
from enum import StrEnum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

KEY_BYTES: Final = 32
TICKS_PER_S: Final = 100_000
_EPOCH_UNIX_S: Final = 1_420_070_400  # 2015-01-01
_TIMESTAMP_MAX: Final = (1 << 48) - 1
_MINUTE: Final = 60 * TICKS_PER_S
_HEADER_LENGTH: Final = 10
_CHECKSUM_LENGTH: Final = 2
_STAMPED_LENGTH: Final = 7  # link id and time stamp
_SIGNATURE_LENGTH: Final = 6
# Another sender than this many is not remembered, and refused: only holders of the key get here.
_SENDERS_MAX: Final = 256


class Objection(StrEnum):
    """Why a message is refused."""

    UNSIGNED = "not signed"
    FORGED = "signed with another key, or altered"
    REPLAYED = "signed, but older than what was received before"


def timestamp_at(unix_s: float) -> int:
    """Return the time stamp of a Unix time; 0 before 2015."""
    return max(0, round((unix_s - _EPOCH_UNIX_S) * TICKS_PER_S))


class LinkSigning:
    """Signs what is sent on a link, and checks what is received.

    Args:
        key: 32 bytes.
        link_id: of this link, 0 to 255: the vehicle keeps one time stamp for each.
        timestamp: that was sent last, or the time: no later one will be less.

    Attributes:
        timestamp: of the newest message sent or received.
    """

    def __init__(self, key: bytes, link_id: int, timestamp: int) -> None:
        self.timestamp = timestamp
        self._key, self._link_id = key, link_id
        self._latest: dict[tuple[int, int, int], int] = {}

    def follow_clock(self, unix_s: float) -> None:
        """Advance the time stamp to the time of day; it never goes back."""
        self.timestamp = min(max(self.timestamp, timestamp_at(unix_s)), _TIMESTAMP_MAX)

    def sign(self, frame: bytes) -> bytes:
        """Return an unsigned MAVLink 2 frame signed; its time stamp is later than any before.

        Raises:
            ValueError: not an unsigned MAVLink 2 frame of the dialect.
        """
        if frame[0] != mavlink.PROTOCOL_MARKER_V2 or frame[2]:
            raise ValueError(f"not an unsigned MAVLink 2 frame: {frame[:4].hex()}")
        self.timestamp = min(self.timestamp + 1, _TIMESTAMP_MAX)
        stamp = bytes((self._link_id,)) + self.timestamp.to_bytes(6, "little")
        stamped = _with_flags(frame, mavlink.MAVLINK_IFLAG_SIGNED) + stamp
        return stamped + self._signature(stamped)

    def objection(self, frame: bytes) -> Objection | None:
        """Return why a whole, undamaged frame is not genuine or not new; remember nothing.

        The first frame of a sender may be late: `accept` decides that.
        """
        if not is_signed(frame):
            return Objection.UNSIGNED
        stamped, signature = frame[:-_SIGNATURE_LENGTH], frame[-_SIGNATURE_LENGTH:]
        if not hmac.compare_digest(self._signature(stamped), signature):
            return Objection.FORGED
        if _timestamp_of(frame) <= self._latest.get(_sender_of(frame), -1):
            return Objection.REPLAYED
        return None

    def accept(self, frame: bytes) -> Objection | None:
        """Return why a whole, undamaged frame is refused; one that is not becomes the latest.

        A sender's first frame may be no more than a minute behind our own time.
        """
        found = self.objection(frame)
        if found is not None:
            return found
        sender, timestamp = _sender_of(frame), _timestamp_of(frame)
        if sender not in self._latest:
            late = timestamp + _MINUTE < self.timestamp
            if late or len(self._latest) >= _SENDERS_MAX:
                return Objection.REPLAYED
        self._latest[sender] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        return None

    def _signature(self, stamped: bytes) -> bytes:
        return hashlib.sha256(self._key + stamped).digest()[:_SIGNATURE_LENGTH]


def is_signed(frame: bytes) -> bool:
    """Tell whether a whole frame carries a signature."""
    version_2 = frame[0] == mavlink.PROTOCOL_MARKER_V2
    return version_2 and bool(frame[2] & mavlink.MAVLINK_IFLAG_SIGNED)


def without_signature(frame: bytes) -> bytes:
    """Return a whole MAVLink 2 frame of the dialect without its signature."""
    return _with_flags(frame, 0)


def may_be_unsigned(message: Any) -> bool:
    """Tell whether a message is accepted unsigned: telemetry radios send their own, and no key."""
    return bool(message.get_msgId() == mavlink.MAVLINK_MSG_ID_RADIO_STATUS)


def _with_flags(frame: bytes, flags: int) -> bytes:
    """Return a frame with other incompatibility flags, its checksum right, and no signature."""
    end = _HEADER_LENGTH + frame[1]
    body = frame[:2] + bytes((flags,)) + frame[3:end]
    kind = mavlink.mavlink_map.get(int.from_bytes(frame[7:10], "little"))
    if kind is None:
        raise ValueError(f"a message of another dialect: {frame[7:10].hex()}")
    checksum = mavlink.x25crc(body[1:] + bytes((kind.crc_extra,))).crc
    return body + int(checksum).to_bytes(_CHECKSUM_LENGTH, "little")


def _timestamp_of(frame: bytes) -> int:
    return int.from_bytes(frame[-_SIGNATURE_LENGTH - 6 : -_SIGNATURE_LENGTH], "little")


def _sender_of(frame: bytes) -> tuple[int, int, int]:
    """Return link id, system and component."""
    return frame[-_STAMPED_LENGTH - _SIGNATURE_LENGTH], frame[5], frame[6]
