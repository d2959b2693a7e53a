"""What vehicles of a fleet tell each other, in metres of one frame (`wire` has the bytes)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from onboard.fleet.area import Place
from onboard.geometry.frames import FloatArray


class MessageKind(StrEnum):
    """The value is the last part of the Zenoh key."""

    PROPOSE = "propose"
    ACK = "ack"
    COMMIT = "commit"
    HEARTBEAT = "heartbeat"


@dataclass(frozen=True)
class Head:
    """Who sent a message, and which of its messages it is.

    Attributes:
        sender: name in the roster.
        boot: identifies one run of its daemon: random, never used again.
        number: counts all messages and tubes of a run together, upwards.
    """

    sender: str
    boot: str
    number: int


@dataclass(frozen=True)
class Tube:
    """An area that a vehicle may occupy, body and errors included; it ends at rest.

    Attributes:
        number: of the proposal, by the sender's counter.
        boxes_m: (N, 4), as in `area`.
    """

    number: int
    boxes_m: FloatArray


@dataclass(frozen=True)
class Propose:
    """A vehicle asks for leave to fly in a tube.

    Attributes:
        stamp_s: when it first did, by its own clock; of two that conflict, the earlier goes first.
    """

    head: Head
    tube: Tube
    stamp_s: float


@dataclass(frozen=True)
class Ack:
    """A vehicle keeps out of another's tube until that one has released it."""

    head: Head
    proposer: str
    proposer_boot: str
    tube_number: int


@dataclass(frozen=True)
class Commit:
    """A vehicle has begun to use a tube that it proposed, or has withdrawn it."""

    head: Head
    tube_number: int
    committed: bool


@dataclass(frozen=True)
class Heartbeat:
    """All that a vehicle holds, and where it is.

    Attributes:
        active: the tube that it flies or rests in, without what it has passed.
        outstanding: what it has proposed; None if nothing.
        position_m: north, east, as it knows it.
        position_age_s: how old the position was, at most, when this was sent.
        reach_m: radius of body and errors about the position, A included.
        echoes: boot and number of the newest heartbeat that it has of each other vehicle.
    """

    head: Head
    active: Tube
    outstanding: Tube | None
    position_m: Place
    position_age_s: float
    reach_m: float
    echoes: Mapping[str, tuple[str, int]] = field(default_factory=dict)


Message = Propose | Ack | Commit | Heartbeat
