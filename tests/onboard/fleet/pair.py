"""Two vehicles whose messages a test carries by hand."""

from __future__ import annotations

from collections.abc import Iterable

from onboard.fleet.area import Place, along
from onboard.fleet.messages import Message
from onboard.fleet.reservation import OwnVehicle, Reservation
from onboard.geometry.frames import FloatArray

REACH_M = 1.5
SPEED_MPS = 4.5
NAMES = ("a", "b")
BOOTS = {"a": "a" * 16, "b": "b" * 16}


def vehicle(
    name: str,
    place_m: Place,
    make: type[Reservation] = Reservation,
    boot: str | None = None,
    roster: tuple[str, ...] = NAMES,
) -> Reservation:
    """Return a vehicle at rest at a place, at time 0."""
    own = OwnVehicle(name, boot or BOOTS[name], REACH_M, SPEED_MPS)
    return make(own, roster, place_m, 0.0)


def way(*places_m: Place, pieces: int = 4) -> FloatArray:
    """Return the boxes around a straight way between two places."""
    start_m, end_m = places_m
    return along(start_m, end_m, REACH_M, pieces)


def said(sender: Reservation, now_s: float | None = None) -> list[Message]:
    """Return what a vehicle has to say, and forget it; tick first if a time is given."""
    if now_s is not None:
        sender.tick(now_s)
    return list(sender.messages_to_send())


def tell(receiver: Reservation, messages: Iterable[Message], now_s: float) -> None:
    """Deliver messages."""
    for message in messages:
        receiver.receive(message, now_s)


def talk(first: Reservation, second: Reservation, times_s: Iterable[float]) -> None:
    """Let both hear all that the other says, at some times."""
    for now_s in times_s:
        tell(second, said(first, now_s), now_s)
        tell(first, said(second, now_s), now_s)
        tell(second, said(first), now_s)
