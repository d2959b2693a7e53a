"""One vehicle's protocol and its bytes: what comes in by Zenoh keys, and what goes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from onboard.fleet.messages import MessageKind
from onboard.fleet.reservation import Reservation
from onboard.fleet.wire import FleetWire

KEY_PREFIX: Final = "clearway/fleet"


class FleetLink:
    """Takes payloads and gives payloads; what cannot be used is counted, reported and dropped.

    Args:
        reservation: the protocol.
        wire: reads and writes its messages.
        report: called with a line for each payload that is dropped.
    """

    def __init__(
        self,
        reservation: Reservation,
        wire: FleetWire,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._reservation, self._wire, self._report = reservation, wire, report

    def receive(self, key: str, payload: bytes, now_s: float) -> None:
        """Take a payload, whatever it is."""
        counts = self._reservation.counts
        prefix, _, rest = key.rpartition("/")
        sender = prefix.removeprefix(f"{KEY_PREFIX}/")
        if sender not in (self._reservation.own.name, *self._reservation.peers):
            counts["not_in_roster"] += 1
            return
        try:
            message = self._wire.decoded(sender, MessageKind(rest), payload)
        except ValueError as error:
            counts["malformed"] += 1
            self._report(f"{key}: dropped: {error}")
            return
        self._reservation.receive(message, now_s)

    def payloads_to_send(self) -> Iterator[tuple[str, bytes]]:
        """Yield key and payload of what is to be sent, once; what cannot be written is lost."""
        for message in self._reservation.messages_to_send():
            try:
                kind, payload = self._wire.encoded(message)
            except ValueError as error:
                self._reservation.counts["unwritable"] += 1
                self._report(f"{type(message).__name__} {message.head.number}: not sent: {error}")
                continue
            yield f"{KEY_PREFIX}/{message.head.sender}/{kind.value}", payload
