"""Reports what peers do that the operator should know: silence, leaving a tube, garbage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from onboard.event_limiter import EventLimiter
from onboard.events import Event, EventName, Severity
from onboard.fleet.peer import Peer

# Six heartbeats.
SILENT_S: Final = 3.0


class PeerWatch:
    """Watches the other vehicles of a fleet; decides nothing.

    Args:
        peers: by name.
        emit: takes the events.
        now_s: the time.
    """

    def __init__(
        self, peers: Mapping[str, Peer], emit: Callable[[Event], None], now_s: float
    ) -> None:
        self._peers, self._emit, self._limiter = peers, emit, EventLimiter()
        # Run and number of the newest heartbeat of each, and since when it is the newest.
        self._newest: dict[str, tuple[str, int] | None] = dict.fromkeys(peers)
        self._since_s = dict.fromkeys(peers, now_s)
        self._silent: set[str] = set()
        self._deviating: set[str] = set()
        self._dropped: list[str] = []

    def note_dropped(self, text: str) -> None:
        """Take why a message was dropped, or not sent."""
        self._dropped = [text]

    def look(self, now_s: float) -> None:
        """Report what has changed."""
        for text in self._dropped:
            if self._limiter.allows(text.partition(":")[0], now_s):
                said = f"fleet: {text}"
                self._emit(Event(now_s, EventName.FLEET_REFUSED, Severity.WARNING, said))
        self._dropped.clear()
        for name, peer in self._peers.items():
            if peer.echoed != self._newest[name]:
                self._newest[name], self._since_s[name] = peer.echoed, now_s
                self._silent.discard(name)
            elif now_s - self._since_s[name] > SILENT_S and name not in self._silent:
                self._silent.add(name)
                what = "is silent" if peer.echoed is not None else "has not been heard"
                text = f"{name} {what}: no leave comes from it"
                self._emit(Event(now_s, EventName.PEER_SILENT, Severity.WARNING, text))
            if peer.deviates and name not in self._deviating:
                text = f"{name} is outside its tube: resting where it may come"
                if self._limiter.allows(f"deviates {name}", now_s):
                    self._deviating.add(name)
                    self._emit(Event(now_s, EventName.PEER_DEVIATES, Severity.WARNING, text))
            elif not peer.deviates:
                self._deviating.discard(name)
