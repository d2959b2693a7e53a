"""One vehicle of a fleet in flight: what of its leg it asks leave for, and what it may fly in.

`Reservation` is the protocol; here is the policy.  Ahead of need the vehicle asks for more of its
leg, in boxes as wide as its lane.  What it flies has to lie in the tube that it has leave for; that
is certified where ways are (`onboard.guidance.fleet`).  At rest it gives up what it does not need.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from onboard.events import Event
from onboard.fleet.area import REST_SLACK_M, Place, along, around, grown, holds, meet, nearer_m
from onboard.fleet.course import Course, FlightTerms
from onboard.fleet.link import FleetLink
from onboard.fleet.membership import FleetMembership
from onboard.fleet.peer_watch import PeerWatch
from onboard.fleet.reservation import OwnVehicle, Reservation
from onboard.fleet.wire import FleetWire
from onboard.geometry.frames import FloatArray
from onboard.geometry.local_frame import LocalFrame

# A tube's boxes are no longer than this.
_PIECE_M: Final = 3.0
# So much of a leg is asked for at a time, all of it or nothing: who stops on the way to let another
# pass stands in the way of a third, so that a circle of them waits for ever.
_ASKED_M: Final = 150.0
# A way is asked for in time to be granted this long before the vehicle would have to brake.
_SOON_S: Final = 2.5
# In the duration that is asked for: for waiting for leave, and how much slower than the cruise.
_WAITING_S: Final = 4.0
_SLOWLY: Final = 0.4
_RETRY_S: Final = (0.5, 2.0)
# At rest for so long without leave to fly on, it gives up all but its place.
_GIVE_UP_S: Final = 3.0
# Where nothing is flown, a vehicle that hovers in its pilot's hold wanders by so much more.
_WANDER_M: Final = 0.7
# Messages that wait to be read, or to be sent; beyond that the oldest are dropped.
_PENDING_MAX: Final = 1000
_END_M: Final = 0.01
# Who was heard under this vehicle's name within this may fly somewhere else: ten heartbeats.
_NAMESAKE_S: Final = 5.0
_NOWHERE: Final[FloatArray] = np.zeros((0, 4))


@dataclass
class _Asked:
    """What the outstanding proposal leads to: the leg, how far along it, and the tube before."""

    leg: tuple[Place, Place] | None
    to_m: float
    from_number: int


class FleetMember:
    """A vehicle among the others.

    Args:
        membership: of the fleet.
        boot: of this run: 16 hexadecimal digits, random, never used before.
        emit: takes the events.

    Attributes:
        membership: as given.
        reservation: the protocol; None before the vehicle rests at a place that is known.
        doubt: why places on the Earth are not known; None while they are.
    """

    def __init__(
        self, membership: FleetMembership, boot: str, emit: Callable[[Event], None]
    ) -> None:
        self.membership, self._boot, self._emit = membership, boot, emit
        self.reservation: Reservation | None = None
        self.doubt: str | None = "its place on the Earth is not known yet"
        self._frame: LocalFrame | None = None
        self._link: FleetLink | None = None
        self._watch: PeerWatch | None = None
        self._received: deque[tuple[str, bytes]] = deque(maxlen=_PENDING_MAX)
        self._to_send: deque[tuple[str, bytes]] = deque(maxlen=_PENDING_MAX)
        self._draw = random.Random(boot)
        self._leg: tuple[Place, Place] | None = None
        self._granted_m, self._retry_s = 0.0, -math.inf
        self._asked: _Asked | None = None
        self._rest_since_s, self._settled_number = math.inf, -1
        self._stands = self._has_namesake = False
        self._tube: tuple[FloatArray, FloatArray] | None = None
        self._wanted_m = _NOWHERE

    # ------------------------------------------------------------------ edges

    def receive(self, key: str, payload: bytes) -> None:
        """Take a message, whatever it is; the next tick reads it."""
        self._received.append((key, payload))

    def take_to_send(self) -> list[tuple[str, bytes]]:
        """Return and forget keys and payloads to be sent."""
        taken = list(self._to_send)
        self._to_send.clear()
        return taken

    def place_by(self, frame: LocalFrame | None, reason: str = "") -> None:
        """State where the vehicle's local frame is on the Earth.

        Args:
            frame: by what the vehicle says; None where it is not known, or not to be believed.
            reason: why not.
        """
        if frame is None:
            self.doubt = reason
        elif self._frame is not None and frame != self._frame:
            self.doubt = (
                "GPS_GLOBAL_ORIGIN has changed since the start: restart the daemon, at rest"
            )
        else:
            self._frame, self.doubt = frame, None

    # ------------------------------------------------------------------ one tick

    def advance(self, course: Course, now_s: float) -> None:
        """Read what has come, give up what is not needed, and ask for what is."""
        if not course.rests:
            self._rest_since_s = math.inf
        self._rest_since_s = min(self._rest_since_s, now_s)
        if self.doubt is not None:
            # What is said in a wrong frame is worse than silence, which peers wait for.
            self._received.clear()
            return
        core = self.reservation or self._begin(course, now_s)
        if core is None or self._link is None or self._watch is None:
            self._received.clear()
            return
        self._grow_reach(core, course.terms)
        settled_s = self._rest_since_s + course.terms.settle_s
        core.rests_s = settled_s if course.rests else course.rests_s
        while self._received:
            self._link.receive(*self._received.popleft(), now_s)
        self._note_commit(core)
        self._note_namesake(core, self._watch, now_s)
        error_m = self.membership.error_m
        core.report(course.position_m, course.position_s, grown(course.held_m, error_m))
        standing_m = around(course.position_m, course.terms.body_m + error_m)
        self._stands = holds(core.active.boxes_m, standing_m)
        self._give_up(core, course, now_s)
        self._ask(core, course, now_s)
        self._note_commit(core)
        core.tick(now_s)
        self._watch.look(now_s)
        self._to_send.extend(self._link.payloads_to_send())

    def _begin(self, course: Course, now_s: float) -> Reservation | None:
        """Begin a run where the vehicle has come to rest."""
        settled = course.rests and now_s - self._rest_since_s >= course.terms.settle_s
        if not settled or self._frame is None:
            return None
        membership = self.membership
        reach_m = course.terms.body_m + membership.error_m + REST_SLACK_M
        own = OwnVehicle(membership.name, self._boot, reach_m, membership.speed_max_mps)
        core = Reservation(own, membership.contracts, course.position_m, now_s)
        wire = FleetWire(self._frame, membership.contracts, membership.key)
        self._watch = PeerWatch(core.peers, self._emit, now_s)
        self._link = FleetLink(core, wire, self._watch.note_dropped)
        self.reservation = core
        return core

    def _grow_reach(self, core: Reservation, terms: FlightTerms) -> None:
        """Say of the body what holds now: errors may be larger than the contract stated."""
        reach_m = terms.body_m + self.membership.error_m + REST_SLACK_M
        if reach_m > core.own.reach_m:
            core.own = replace(core.own, reach_m=reach_m)

    def _note_namesake(self, core: Reservation, watch: PeerWatch, now_s: float) -> None:
        """Note whether another daemon may use this vehicle's name: peers take both for one."""
        self._has_namesake = now_s - core.namesake_s < _NAMESAKE_S
        if self._has_namesake:
            watch.note_dropped(f"{core.own.name} has another daemon, or had one until now")

    def _note_commit(self, core: Reservation) -> None:
        asked = self._asked
        if asked is None:
            return
        if core.active.number != asked.from_number:
            if asked.leg is not None and asked.leg == self._leg:
                self._granted_m = asked.to_m
            self._asked = None
        elif core.outstanding is None:
            self._asked = None

    def _give_up(self, core: Reservation, course: Course, now_s: float) -> None:
        """At rest keep the place alone, where no more is needed or the leave for more ends."""
        rested_s = now_s - self._rest_since_s
        if not course.rests or core.outstanding is not None or rested_s < course.terms.settle_s:
            return
        idle = course.leg is None
        ends = now_s >= core.expires_s or (idle and self._stands)
        waits = rested_s > _GIVE_UP_S and self._leads_nowhere(course)
        if (ends or waits) and self._settled_number != core.active.number:
            core.settle(_WANDER_M if idle else 0.0)
            self._settled_number = core.active.number
            self._leg = None

    def _leads_nowhere(self, course: Course) -> bool:
        """Tell whether the tube leads on by no more than a stop takes."""
        if course.leg is None or course.leg != self._leg:
            return False
        ends = self._granted_m >= math.dist(*course.leg) - _END_M
        return not ends and self._granted_m - _station_m(course) < course.terms.stop_m

    # ------------------------------------------------------------------ what is asked for

    def _ask(self, core: Reservation, course: Course, now_s: float) -> None:
        if core.outstanding is not None or now_s < self._retry_s:
            return
        if course.leg is None:
            if not self._stands and course.rests:
                place_m = around(course.position_m, core.own.reach_m + _WANDER_M)
                self._propose(core, place_m, 2.0 * _WAITING_S, _Asked(None, 0.0, 0), now_s)
            return
        terms, at_m = course.terms, _station_m(course)
        if course.leg != self._leg:
            self._leg, self._granted_m = course.leg, at_m
        end_m = math.dist(*course.leg)
        ahead_m, soon_m = self._granted_m - at_m, terms.stop_m + _SOON_S * terms.cruise_mps
        more = self._granted_m < end_m - _END_M and ahead_m < soon_m
        slowly_mps = _SLOWLY * terms.cruise_mps
        over_s = 2.0 * terms.stop_s + terms.settle_s + _WAITING_S
        late = core.expires_s - now_s < max(ahead_m, 0.0) / slowly_mps + over_s
        if not (more or late):
            return
        to_m, onward_m = self._onward(core, course.leg, max(_ASKED_M, 2.0 * soon_m), terms)
        if len(onward_m) or (late and not course.rests):
            duration_s = max(to_m - at_m, 0.0) / slowly_mps + over_s
            self._propose(core, onward_m, duration_s, _Asked(course.leg, to_m, 0), now_s)
        else:
            self._retry_s = now_s + _RETRY_S[0]

    def _onward(
        self, core: Reservation, leg: tuple[Place, Place], length_m: float, terms: FlightTerms
    ) -> tuple[float, FloatArray]:
        """Return up to where along the leg more is asked for, and the boxes; none if a peer's."""
        from_m, end_m = self._granted_m, math.dist(*leg)
        to_m = min(from_m + length_m, end_m)
        if to_m - from_m < _END_M:
            return from_m, _NOWHERE
        beyond_m = terms.beyond_m if to_m == end_m else 0.0
        count = math.ceil((to_m + beyond_m - from_m) / _PIECE_M)
        half_m = core.own.reach_m + self.membership.lane_half_width_m
        boxes_m = along(_on(leg, from_m), _on(leg, to_m + beyond_m), half_m, count)
        self._wanted_m = boxes_m
        if core.free_of_records(boxes_m) < count:
            return from_m, _NOWHERE
        return to_m, boxes_m

    def _propose(
        self,
        core: Reservation,
        onward_m: FloatArray,
        duration_s: float,
        asked: _Asked,
        now_s: float,
    ) -> None:
        self._retry_s = now_s + self._draw.uniform(*_RETRY_S)
        asked.from_number = core.active.number
        if core.propose(onward_m, duration_s, now_s):
            self._asked = asked

    # ------------------------------------------------------------------ what holds

    @property
    def tube_m(self) -> FloatArray:
        """Where body and tracking error may be, (N, 4): the tube without A."""
        core = self.reservation
        if core is None or self.doubt is not None or self._has_namesake:
            return _NOWHERE
        boxes_m = core.active.boxes_m
        if self._tube is None or self._tube[0] is not boxes_m:
            self._tube = boxes_m, grown(boxes_m, -self.membership.error_m)
        return self._tube[1]

    @property
    def expires_s(self) -> float:
        """When the vehicle has to be at rest."""
        return math.inf if self.reservation is None else self.reservation.expires_s

    def who_may_come(self, area_m: FloatArray, until_s: float) -> str | None:
        """Return which peer that has left its tube may be in an area until then; None if none."""
        core, error_m = self.reservation, self.membership.error_m
        for name, peer in {} if core is None else core.peers.items():
            disc = peer.disc(until_s, self.membership.speed_max_mps) if peer.deviates else None
            if disc is not None and nearer_m(area_m, disc[0]) - error_m <= disc[1]:
                return name
        return None

    def objection(self) -> str | None:
        """Return why the vehicle may not be flown from where it stands; None if it may."""
        core = self.reservation
        if self.doubt is not None:
            return self.doubt
        if core is None:
            return "it has not been at rest since the daemon was started"
        if self._has_namesake:
            return f"another daemon flies as {core.own.name}, or did until now"
        if not self._stands:
            return f"{self.waits_for()} to be where it is"
        holders = self._holders(core, core.active.boxes_m)
        return f"{' and '.join(holders)} may be where it is" if holders else None

    def waits_for(self) -> str:
        """Return what the vehicle waits for, for people."""
        core = self.reservation
        if self.doubt is not None or core is None:
            return f"waiting for its place on the Earth: {self.doubt}"
        if self._has_namesake:
            return f"waiting for {core.own.name} to be this vehicle alone"
        if core.outstanding is not None:
            missing = sorted(core.outstanding.need - core.outstanding.acked)
            return f"waiting for leave of {', '.join(missing)}"
        holders = self._holders(core, self._wanted_m)
        return f"waiting for leave{' of ' if holders else ''}{', '.join(holders)}"

    def is_peer(self, corners_ned_m: Sequence[Place], error_m: float) -> bool:
        """Tell whether what a sensor sees may be a peer: it is within the tube of one.

        Args:
            corners_ned_m: of its box, as measured.
            error_m: by how much that may be off.
        """
        core = self.reservation
        if core is None or self.doubt is not None:
            return False
        north_m, east_m = zip(*corners_ned_m, strict=True)
        box_m = np.array([[min(north_m), max(north_m), min(east_m), max(east_m)]])
        more_m = error_m + self.membership.error_m
        return any(
            holds(grown(held_m, more_m), box_m)
            for peer in core.peers.values()
            for held_m in peer.records.values()
        )

    @staticmethod
    def _holders(core: Reservation, area_m: FloatArray) -> list[str]:
        """Return which peers hold a part of an area."""
        return [
            name
            for name, peer in core.peers.items()
            if any(meet(area_m, held_m) for held_m in peer.records.values())
        ]


def _on(leg: tuple[Place, Place], at_m: float) -> Place:
    """Return the place on a leg that far from its start."""
    (n0, e0), (n1, e1) = leg
    share = at_m / max(math.dist(*leg), 1e-9)
    return n0 + share * (n1 - n0), e0 + share * (e1 - e0)


def _station_m(course: Course) -> float:
    """Return how far along its leg the vehicle is."""
    assert course.leg is not None  # noqa: S101  the callers checked
    (n0, e0), (n1, e1) = course.leg
    length_m = max(math.dist(*course.leg), 1e-9)
    north_m, east_m = course.position_m
    along_m = ((north_m - n0) * (n1 - n0) + (east_m - e0) * (e1 - e0)) / length_m
    return min(max(along_m, 0.0), length_m)
