"""MAVLink 2 message signing: one key, one growing time, one memory of every sender.

A signature is the first 48 bits of SHA-256 over the key, the frame up to its checksum, the link id
and a time in units of 10 us since 2015.  A frame is genuine if its signature fits and its time lies
after the last genuine one of the same (link id, system, component); from an unknown sender, not
more than a minute before our own.  All links of a vehicle share this, so that a frame replayed on
another link is an old one there too.
"""

from __future__ import annotations

import hashlib
import hmac

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.config import VehicleConfig

SIGNATURE_LENGTH = 13  # link id, 6 bytes of time, 6 bytes of signature
TIMESTAMP_MAX = (1 << 47) - 1  # leaves room to count on in 48 bits
_EPOCH_UNIX_S = 1_420_070_400  # 2015-01-01
_TICKS_PER_S = 100_000
_LATE_MAX = 60 * _TICKS_PER_S


class Signing:
    """Key and memory with which the links of one vehicle sign and check.

    Args:
        key: 32 bytes.
        unix_s: time of day, from which this vehicle's own time counts on.

    Attributes:
        outgoing: the state that pymavlink signs with.
        refused: unsigned, forged and replayed frames so far.
    """

    def __init__(self, key: bytes, unix_s: float) -> None:
        self.outgoing = mavlink.MAVLinkSigning()
        self.outgoing.secret_key = key
        self.outgoing.sign_outgoing = True
        self.outgoing.timestamp = max(0, round((unix_s - _EPOCH_UNIX_S) * _TICKS_PER_S))
        self.refused = 0
        self._key = key
        self._latest: dict[tuple[int, int, int], int] = {}

    def accepts(self, frame: bytes) -> bool:
        """Whether a whole, undamaged frame is genuine and new; if so, it becomes the latest.

        Unlike pymavlink's own check, a forged frame leaves no trace in the memory of senders.
        """
        genuine = self._is_genuine(frame)
        if not genuine:
            self.refused += 1
        return genuine

    def _is_genuine(self, frame: bytes) -> bool:
        if frame[0] != mavlink.PROTOCOL_MARKER_V2 or not frame[2] & mavlink.MAVLINK_IFLAG_SIGNED:
            return False
        time = int.from_bytes(frame[-12:-6], "little")
        sender = (frame[-SIGNATURE_LENGTH], frame[5], frame[6])
        oldest = self._latest.get(sender, self.outgoing.timestamp - _LATE_MAX)
        if time <= oldest or not hmac.compare_digest(self._signature(frame[:-6]), frame[-6:]):
            return False
        self._latest[sender] = time
        self.outgoing.timestamp = max(self.outgoing.timestamp, time)
        return True

    def _signature(self, stamped: bytes) -> bytes:
        return hashlib.sha256(self._key + stamped).digest()[:6]


def signing_key(config: VehicleConfig) -> bytes | None:
    """Return the key that a simulated vehicle signs with; None if it does not."""
    if config.signing_key_hex is not None:
        return bytes.fromhex(config.signing_key_hex)
    passphrase = config.signing_passphrase
    return None if passphrase is None else key_of_passphrase(passphrase)


def key_of_passphrase(passphrase: str) -> bytes:
    """Return the key that ground stations derive from a passphrase: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()
