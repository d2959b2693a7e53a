"""Reservation by acknowledgement (C1): no vehicle flies where another might, without its leave.

A vehicle flies only in its *tube*, an area at whose end it can rest.  To fly on it proposes a
larger one, and commits to it once every peer in `need` has acknowledged it: each that might get
there while it lasts, by its last position and the greatest speed of the fleet, and each that was
never heard.  Safe for any delay, loss, order and partition (onboard/contract/THEORY.md, N); what
they cost is time.

No clock is shared.  `now_s` is this vehicle's own, and the age of a peer's position counts from
when this vehicle sent the heartbeat that the peer echoes.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from onboard.fleet.area import (
    Place,
    around,
    holds,
    is_proper,
    meet,
    meeting,
    nearer_m,
    within,
)
from onboard.fleet.messages import Ack, Commit, Head, Heartbeat, Message, Propose, Tube
from onboard.fleet.peer import Echo, Peer
from onboard.geometry.frames import FloatArray

# Heartbeats that are remembered, to date what echoes them.
_SENT_MAX: Final = 256
# Runs under this vehicle's own name that are told apart.
_NAMESAKES_MAX: Final = 64


@dataclass(frozen=True)
class OwnVehicle:
    """What a vehicle says of itself.

    Attributes:
        name: in the roster.
        boot: of this run: random, never used before.
        reach_m: radius of its body, tracking error E and error A of its position together.
        speed_max_mps: no vehicle of the fleet is faster, with or without a link.
        heartbeat_s: period of heartbeats.
        repeat_s: period of what is proposed, until all have acknowledged it.
        patience_s: a proposal that is not acknowledged for so long is withdrawn.
    """

    name: str
    boot: str
    reach_m: float
    speed_max_mps: float
    heartbeat_s: float = 0.5
    repeat_s: float = 0.5
    patience_s: float = 4.0


@dataclass
class Proposal:
    """What this vehicle has proposed.

    Attributes:
        tube: with all that it may still occupy now.
        stamp_s: when.
        expires_s: when it has to be at rest in it: until then no peer that was not asked can be
            there.  Infinite if all were asked.
        need: who has to acknowledge it.
        acked: who has.
        sent_s: when it was sent last.
    """

    tube: Tube
    stamp_s: float
    expires_s: float
    need: frozenset[str]
    acked: set[str] = field(default_factory=set)
    sent_s: float = -math.inf


class Reservation:
    """The protocol of one vehicle, without I/O.

    Args:
        own: this vehicle.
        roster: names of all others.
        standing_m: where it is at rest, north and east.
        now_s: the time.

    Attributes:
        active: the tube in which it may fly, or rests.
        expires_s: when it has to be at rest in it.
        outstanding: what it has proposed; None if nothing.
        rests_s: when the vehicle rests at the latest, if nothing else is decided.
        namesake_s: when another run under this vehicle's name said something new.
        counts: of messages that were dropped, by reason, and of commits and withdrawals.
    """

    def __init__(
        self, own: OwnVehicle, roster: Iterable[str], standing_m: Place, now_s: float
    ) -> None:
        self.own = own
        self.peers = {name: self._peer() for name in roster if name != own.name}
        self.counts: Counter[str] = Counter()
        self.active = Tube(0, around(standing_m, own.reach_m))
        self.expires_s = math.inf
        self.outstanding: Proposal | None = None
        self.rests_s = self.namesake_s = -math.inf
        self._namesakes: dict[str, int] = {}
        self._position_m, self._position_s = standing_m, now_s
        self._number = 0
        self._heartbeat_due_s = now_s
        self._sent_s: dict[int, float] = {}
        self._to_send: deque[Message] = deque()

    def _peer(self) -> Peer:
        return Peer()

    # ------------------------------------------------------------------ what the flight says

    def report(self, position_m: Place, now_s: float, held_m: FloatArray | None = None) -> bool:
        """Say where the vehicle is; give up what it has passed.

        It never flies back into that.

        Args:
            position_m: north, east, of the reference that it follows.
            now_s: when it is there.
            held_m: (N, 4), what it may still occupy besides without another decision; None: none.

        Returns:
            Whether one box of its tube holds all that it may reach from there.
        """
        if not all(map(math.isfinite, position_m)):
            self.counts["outside"] += 1
            return False
        rests = position_m == self._position_m
        self._position_m, self._position_s = position_m, now_s
        if rests:
            return True
        boxes_m = self.active.boxes_m
        reach_m = around(position_m, self.own.reach_m)
        if not holds(boxes_m, reach_m):
            self.counts["outside"] += 1
            return False
        kept_m = reach_m if held_m is None else np.concatenate((reach_m, held_m))
        passed = int(np.argmax(meeting(boxes_m, kept_m)))
        if passed:
            self.active = replace(self.active, boxes_m=boxes_m[passed:])
        return True

    def settle(self, more_m: float = 0.0) -> None:
        """Give up all but where the vehicle rests, and will rest until the next leave to fly.

        Nothing is taken in place of it: a vehicle outside its tube keeps that tube.

        Args:
            more_m: how much more is kept around it, as far as the tube holds that.
        """
        if self.outstanding is None:
            boxes_m = within(
                self.active.boxes_m, around(self._position_m, self.own.reach_m + more_m)
            )
            if len(boxes_m):
                self.active = replace(self.active, boxes_m=boxes_m)
            self.expires_s = math.inf

    def free_of_records(self, onward_m: FloatArray) -> int:
        """Return how many boxes of a way come before the first that a peer holds, (N, 4)."""
        taken = [meeting(onward_m, held_m) for held_m in self._held_by_peers()]
        held = np.any(taken, axis=0) if taken else np.zeros(len(onward_m), bool)
        return int(np.argmax(held)) if held.any() else len(onward_m)

    def propose(self, onward_m: FloatArray, duration_s: float, now_s: float) -> bool:
        """Ask for leave to fly on.

        Args:
            onward_m: (N, 4), where else it wants to fly, from the end of its tube on.
            duration_s: in which it will be at rest at the end, waiting for leave included.
            now_s: the time.

        Returns:
            Whether it was proposed; not where a peer holds a part of it, nor while another proposal
            is outstanding.

        Raises:
            ValueError: the duration is not above 0, or a box is none.
        """
        if not is_proper(onward_m):
            raise ValueError("onward_m: a box is not finite, or ends before it begins")
        if not duration_s > 0.0:
            raise ValueError(f"duration_s = {duration_s:g}: expected more than 0 s")
        if self.outstanding is not None:
            return False
        boxes_m = np.concatenate((self._still_occupied(), onward_m))
        if any(meet(boxes_m, held_m) for held_m in self._held_by_peers()):
            self.counts["held"] += 1
            return False
        need = self._need(boxes_m, now_s + duration_s)
        expires_s = math.inf if need == self.peers.keys() else now_s + duration_s
        tube = Tube(self._next_number(), boxes_m)
        self.outstanding = Proposal(tube, now_s, expires_s, need)
        self._commit_if_all_agree(now_s)
        return True

    def withdraw(self) -> None:
        """Take back what is proposed; the vehicle flies out its tube."""
        if self.outstanding is not None:
            self._send(Commit(self._head(), self.outstanding.tube.number, committed=False))
            self.outstanding = None
            self.counts["withdrawn"] += 1

    def tick(self, now_s: float) -> None:
        """Repeat what has to be repeated; more often than the periods."""
        proposal = self.outstanding
        if proposal is not None:
            late = now_s >= proposal.stamp_s + self.own.patience_s or now_s >= proposal.expires_s
            if late:
                self.withdraw()
            elif now_s >= proposal.sent_s + self.own.repeat_s:
                proposal.sent_s = now_s
                self._send(Propose(self._head(), proposal.tube, proposal.stamp_s))
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + self.own.heartbeat_s
            self._send_heartbeat(now_s)

    def messages_to_send(self) -> Iterator[Message]:
        """Yield what is to be sent to all, once."""
        while self._to_send:
            yield self._to_send.popleft()

    # ------------------------------------------------------------------ what others say

    def receive(self, message: Message, now_s: float) -> None:
        """Take a message: compare, record and acknowledge are one step."""
        peer = self.peers.get(message.head.sender)
        if message.head.sender == self.own.name:
            self._note_own(message.head, now_s)
        elif peer is None:
            self.counts["not_in_roster"] += 1
        elif isinstance(message, Heartbeat):
            if not peer.hear(message, self._echo(message), self._number + 1):
                self.counts["late_or_unconfirmed"] += 1
        elif not peer.counts(message.head.boot, self._number + 1):
            self.counts["late_or_unconfirmed"] += 1
        elif isinstance(message, Propose):
            self._answer(message, peer)
        elif isinstance(message, Ack):
            self._take_ack(message, now_s)
        elif not message.committed:
            peer.records.pop(message.tube_number, None)

    def _note_own(self, head: Head, now_s: float) -> None:
        """Note who else flies under this name: a run before this one, or another vehicle."""
        self.counts["own"] += 1
        known = self._namesakes.get(head.boot, -1)
        if head.boot == self.own.boot or head.number <= known:
            return
        if known >= 0 or len(self._namesakes) < _NAMESAKES_MAX:
            self._namesakes[head.boot] = head.number
        self.namesake_s = now_s

    def _answer(self, message: Propose, peer: Peer) -> None:
        """Acknowledge a proposal, or say nothing."""
        tube, head = message.tube, message.head
        if peer.is_over(tube.number) or self._occupies(tube.boxes_m):
            return
        mine = self.outstanding
        if mine is not None and meet(tube.boxes_m, mine.tube.boxes_m):
            if (mine.stamp_s, self.own.name) <= (message.stamp_s, head.sender):
                return
            self.withdraw()
        if peer.record(tube):
            self._send(Ack(self._head(), head.sender, head.boot, tube.number))

    def _take_ack(self, message: Ack, now_s: float) -> None:
        proposal = self.outstanding
        if proposal is None or (message.proposer, message.proposer_boot, message.tube_number) != (
            self.own.name,
            self.own.boot,
            proposal.tube.number,
        ):
            return
        proposal.acked.add(message.head.sender)
        self._commit_if_all_agree(now_s)

    def _echo(self, heartbeat: Heartbeat) -> Echo | None:
        boot, number = heartbeat.echoes.get(self.own.name, ("", -1))
        sent_s = self._sent_s.get(number)
        return None if boot != self.own.boot or sent_s is None else Echo(number, sent_s)

    # ------------------------------------------------------------------ what is decided

    def _occupies(self, boxes_m: FloatArray) -> bool:
        """Tell whether the vehicle may be in an area by leave that it has."""
        return meet(boxes_m, self.active.boxes_m)

    def _still_occupied(self) -> FloatArray:
        """Return what the vehicle may occupy from now on without any further leave."""
        return self.active.boxes_m

    def _held_by_peers(self) -> Iterator[FloatArray]:
        for peer in self.peers.values():
            yield from peer.records.values()

    def _need(self, boxes_m: FloatArray, until_s: float) -> frozenset[str]:
        """Return who might get to an area until then, and who was never heard."""
        needed, reach_m = set(), self.own.reach_m
        for name, peer in self.peers.items():
            disc = peer.disc(until_s, self.own.speed_max_mps)
            # From the middle of this vehicle: its boxes are in metres of the sphere, too.
            if disc is None or nearer_m(boxes_m, disc[0], reach_m) <= disc[1] + reach_m:
                needed.add(name)
        return frozenset(needed)

    def _commit_if_all_agree(self, now_s: float) -> None:
        proposal = self.outstanding
        if proposal is None or not self._may_commit(proposal, now_s):
            return
        self.active, self.expires_s = proposal.tube, proposal.expires_s
        self.outstanding = None
        self.counts["committed"] += 1
        self._send(Commit(self._head(), proposal.tube.number, committed=True))

    def _may_commit(self, proposal: Proposal, now_s: float) -> bool:
        # The way that is held may end later than what was asked for.
        in_time = max(now_s, self.rests_s) < proposal.expires_s
        return in_time and proposal.need <= proposal.acked

    # ------------------------------------------------------------------ what is sent

    def _next_number(self) -> int:
        self._number += 1
        return self._number

    def _head(self) -> Head:
        return Head(self.own.name, self.own.boot, self._next_number())

    def _send(self, message: Message) -> None:
        self._to_send.append(message)

    def _send_heartbeat(self, now_s: float) -> None:
        head, proposal = self._head(), self.outstanding
        self._sent_s[head.number] = now_s
        while len(self._sent_s) > _SENT_MAX:
            del self._sent_s[next(iter(self._sent_s))]
        echoes = {n: peer.echoed for n, peer in self.peers.items() if peer.echoed is not None}
        self._send(
            Heartbeat(
                head,
                self.active,
                None if proposal is None else proposal.tube,
                self._position_m,
                max(now_s - self._position_s, 0.0),
                self.own.reach_m,
                echoes,
            )
        )
