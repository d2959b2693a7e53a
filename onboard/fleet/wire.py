"""Messages of the fleet as bytes: JSON, version 1, places in WGS84.

Keys are ``clearway/fleet/<name>/<kind>``, with the sender's name.  A box is [latitude from, to,
longitude from, to] in degrees.  Every message names the sender's run (``boot``), its number in it,
and the hash of the contract that the sender flies by.

With a key of the fleet, a message travels as a text in an envelope with its HMAC-SHA256 (RFC 2104)
over ``clearway-fleet-1``, sender and kind, each followed by a zero byte, then the text in UTF-8.  A
message that is replayed does no harm: what matters is answered to a number of this run.
"""

from __future__ import annotations

import hmac
import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.fleet.area import Place
from onboard.fleet.messages import (
    Ack,
    Commit,
    Head,
    Heartbeat,
    Message,
    MessageKind,
    Propose,
    Tube,
)
from onboard.geometry.frames import FloatArray
from onboard.geometry.local_frame import LocalFrame

# A longer message is dropped unread.
PAYLOAD_BYTES_MAX: Final = 200_000
# Boxes are written so much larger, for what a reach in metres of one sphere lacks on another; and
# by what an edge in the writer's frame, and again in the reader's, bends on the Earth.
_ROUNDING_M: Final = 0.05
_CURVATURE_M: Final = 6_335_000.0
# Farther from the origin the frame is no plane.
_AWAY_MAX_M: Final = 50_000.0
_DOMAIN: Final = b"clearway-fleet-1"

Latitude = Annotated[float, Field(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]
Number = Annotated[int, Field(ge=0, le=1 << 53)]
Boot = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
GeographicBox = tuple[Latitude, Latitude, Longitude, Longitude]
Duration = Annotated[float, Field(ge=0.0, le=1e6)]


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class TubeDocument(_Model):
    """A tube: its number and its boxes, in the order in which they are flown."""

    number: Number
    boxes_deg: Annotated[tuple[GeographicBox, ...], Field(min_length=1, max_length=1000)]


class MessageDocument(_Model):
    """What every message says."""

    version: Literal[1] = 1
    boot: Boot
    number: Number
    contract_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class ProposeDocument(MessageDocument):
    """A tube for which leave is asked."""

    tube: TubeDocument
    stamp_s: float


class AckDocument(MessageDocument):
    """Leave for another's tube."""

    proposer: Name
    proposer_boot: Boot
    tube: Number


class CommitDocument(MessageDocument):
    """A proposed tube is used from now on, or is not needed any more."""

    tube: Number
    committed: bool


class HeartbeatDocument(MessageDocument):
    """What is held, and where the vehicle is."""

    active: TubeDocument
    outstanding: TubeDocument | None
    position_deg: tuple[Latitude, Longitude]
    position_age_s: Duration
    reach_m: Annotated[float, Field(gt=0.0, le=1000.0)]
    echoes: Annotated[dict[Name, tuple[Boot, Number]], Field(max_length=64)]


class SealedDocument(_Model):
    """A message with a code that only a holder of the fleet's key can make."""

    version: Literal[1] = 1
    payload: str
    hmac_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


_DOCUMENTS: Final[Mapping[MessageKind, type[MessageDocument]]] = {
    MessageKind.PROPOSE: ProposeDocument,
    MessageKind.ACK: AckDocument,
    MessageKind.COMMIT: CommitDocument,
    MessageKind.HEARTBEAT: HeartbeatDocument,
}


def _check_numbers(document: MessageDocument) -> None:
    """One counter numbers tubes and messages, so that a message is of tubes before it.

    Raises:
        MalformedPayloadError: it is not.
    """
    numbers: tuple[int, ...] = ()
    if isinstance(document, ProposeDocument):
        numbers = (document.tube.number,)
    elif isinstance(document, CommitDocument):
        numbers = (document.tube,)
    elif isinstance(document, HeartbeatDocument):
        proposed = document.outstanding
        numbers = (document.active.number, *(() if proposed is None else (proposed.number,)))
    for earlier, later in pairwise((*numbers, document.number)):
        if earlier >= later:
            raise MalformedPayloadError(f"number = {later}: expected above that of tube {earlier}")


class FleetWire:
    """Writes and reads messages for one vehicle.

    Args:
        frame: of this vehicle; its messages are in metres of that.
        contracts: hash of the contract of each vehicle of the roster, by name.
        key: of the fleet; None to send and take messages as they are.
    """

    def __init__(
        self, frame: LocalFrame, contracts: Mapping[str, str], key: bytes | None = None
    ) -> None:
        self._frame, self._contracts, self._key = frame, contracts, key

    # ------------------------------------------------------------------ out

    def encoded(self, message: Message) -> tuple[MessageKind, bytes]:
        """Return a message of this vehicle as bytes, and its kind."""
        head = message.head
        stated = {
            "boot": head.boot,
            "number": head.number,
            "contract_sha256": self._contracts[head.sender],
        }
        document: MessageDocument
        if isinstance(message, Propose):
            kind, tube = MessageKind.PROPOSE, self._tube_document(message.tube)
            document = ProposeDocument(**stated, tube=tube, stamp_s=message.stamp_s)
        elif isinstance(message, Ack):
            kind = MessageKind.ACK
            document = AckDocument(
                **stated,
                proposer=message.proposer,
                proposer_boot=message.proposer_boot,
                tube=message.tube_number,
            )
        elif isinstance(message, Commit):
            kind = MessageKind.COMMIT
            document = CommitDocument(
                **stated, tube=message.tube_number, committed=message.committed
            )
        else:
            kind, document = MessageKind.HEARTBEAT, self._heartbeat_document(message, stated)
        return kind, self._sealed(head.sender, kind, document.model_dump_json())

    def _heartbeat_document(
        self, message: Heartbeat, stated: Mapping[str, object]
    ) -> HeartbeatDocument:
        proposed = message.outstanding
        return HeartbeatDocument.model_validate(
            {
                **stated,
                "active": self._tube_document(message.active),
                "outstanding": None if proposed is None else self._tube_document(proposed),
                "position_deg": self._frame.latitude_longitude_deg(*message.position_m),
                "position_age_s": message.position_age_s,
                "reach_m": message.reach_m,
                "echoes": dict(message.echoes),
            }
        )

    def _tube_document(self, tube: Tube) -> TubeDocument:
        boxes = tuple(map(self._geographic_box, tube.boxes_m.tolist()))
        return TubeDocument(number=tube.number, boxes_deg=boxes)

    def _geographic_box(self, box_m: list[float]) -> GeographicBox:
        low_n, high_n, low_e, high_e = box_m
        steepness = math.tan(math.radians(min(abs(self._frame.origin.latitude_deg) + 1.0, 85.0)))
        length_m = math.hypot(high_n - low_n, high_e - low_e)
        more_m = _ROUNDING_M + steepness * length_m**2 / (4.0 * _CURVATURE_M)
        corners = [
            self._frame.latitude_longitude_deg(north_m, east_m)
            for north_m in (low_n - more_m, high_n + more_m)
            for east_m in (low_e - more_m, high_e + more_m)
        ]
        latitudes, longitudes = zip(*corners, strict=True)
        if max(longitudes) - min(longitudes) > 180.0:
            raise ValueError("a tube across the antimeridian cannot be written")
        return min(latitudes), max(latitudes), min(longitudes), max(longitudes)

    def _sealed(self, sender: str, kind: MessageKind, text: str) -> bytes:
        if self._key is None:
            return text.encode()
        code = self._code(self._key, sender, kind, text)
        return SealedDocument(payload=text, hmac_sha256=code).model_dump_json().encode()

    # ------------------------------------------------------------------ in

    def decoded(self, sender: str, kind: MessageKind, payload: bytes) -> Message:
        """Return a message of another vehicle.

        Args:
            sender: by the key that it came under; of the roster.
            kind: likewise.
            payload: as received.

        Raises:
            MalformedPayloadError: not of that kind, of another contract, not sealed by the fleet's
                key, or of a place that is not near; says what is wrong.
        """
        if len(payload) > PAYLOAD_BYTES_MAX:
            raise MalformedPayloadError(f"{len(payload)} bytes, at most {PAYLOAD_BYTES_MAX}")
        if self._key is not None:
            payload = self._opened(self._key, sender, kind, payload)
        document = parse(payload, _DOCUMENTS[kind])
        expected = self._contracts[sender]
        if document.contract_sha256 != expected:
            found = document.contract_sha256
            raise MalformedPayloadError(
                f"contract_sha256: flies by {found[:12]}, the roster has {expected[:12]}"
            )
        head = Head(sender, document.boot, document.number)
        _check_numbers(document)
        match document:
            case ProposeDocument():
                return Propose(head, self._tube(document.tube), document.stamp_s)
            case AckDocument():
                return Ack(head, document.proposer, document.proposer_boot, document.tube)
            case CommitDocument():
                return Commit(head, document.tube, document.committed)
            case HeartbeatDocument():
                return self._heartbeat(head, document)
        raise MalformedPayloadError(f"of no kind: {type(document).__name__}")

    def _heartbeat(self, head: Head, document: HeartbeatDocument) -> Heartbeat:
        proposed = document.outstanding
        return Heartbeat(
            head,
            self._tube(document.active),
            None if proposed is None else self._tube(proposed),
            self._place(*document.position_deg),
            document.position_age_s,
            document.reach_m,
            document.echoes,
        )

    def _tube(self, document: TubeDocument) -> Tube:
        boxes: FloatArray = np.array([self._box(*box) for box in document.boxes_deg])
        return Tube(document.number, boxes)

    def _box(
        self, from_latitude: float, to_latitude: float, from_longitude: float, to_longitude: float
    ) -> tuple[float, float, float, float]:
        if from_latitude > to_latitude or from_longitude > to_longitude:
            raise MalformedPayloadError("boxes_deg: from exceeds to")
        corners = [
            self._place(latitude, longitude)
            for latitude in (from_latitude, to_latitude)
            for longitude in (from_longitude, to_longitude)
        ]
        norths_m, easts_m = zip(*corners, strict=True)
        return min(norths_m), max(norths_m), min(easts_m), max(easts_m)

    def _place(self, latitude_deg: float, longitude_deg: float) -> Place:
        place_m = self._frame.north_east_m(latitude_deg, longitude_deg)
        if not math.hypot(*place_m) <= _AWAY_MAX_M:
            raise MalformedPayloadError(
                f"{latitude_deg:.5f}, {longitude_deg:.5f} is {math.hypot(*place_m) / 1e3:,.0f} km "
                "from the origin"
            )
        return place_m

    def _opened(self, key: bytes, sender: str, kind: MessageKind, payload: bytes) -> bytes:
        sealed = parse(payload, SealedDocument)
        try:
            expected = self._code(key, sender, kind, sealed.payload)
        except UnicodeEncodeError as error:
            raise MalformedPayloadError("payload: no text") from error
        if not hmac.compare_digest(expected, sealed.hmac_sha256):
            raise MalformedPayloadError("hmac_sha256: sealed with another key, or altered")
        return sealed.payload.encode()

    @staticmethod
    def _code(key: bytes, sender: str, kind: MessageKind, text: str) -> str:
        head = (_DOMAIN, sender.encode(), kind.value.encode())
        return hmac.new(key, b"\0".join((*head, text.encode())), "sha256").hexdigest()
