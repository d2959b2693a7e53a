"""What of its leg a vehicle asks leave for, and whom it waits for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.events import Event
from onboard.fleet.area import Place
from onboard.fleet.course import Course, FlightTerms
from onboard.fleet.member import FleetMember
from onboard.fleet.membership import FleetMembership
from onboard.geometry.local_frame import GeographicPoint, LocalFrame

FRAME = LocalFrame(GeographicPoint(47.397742, 8.545594), "px4")
TERMS = FlightTerms(
    body_m=0.65, cruise_mps=2.8, brake_mps2=2.0, lag_s=0.5, settle_s=0.3, run_on_s=1.0
)
WAYS: dict[str, tuple[Place, Place]] = {
    "north": ((-40.0, 0.0), (40.0, 0.0)),
    "east": ((0.0, -40.0), (0.0, 40.0)),
    "aside": ((-40.0, 50.0), (40.0, 50.0)),
}
TICK_S = 0.1


class Fleet:
    """Vehicles at the start of their legs, over a network without faults."""

    def __init__(self, names: tuple[str, ...], terms: FlightTerms = TERMS) -> None:
        self._terms, self._now_s = terms, 0.0
        contracts = dict.fromkeys(names, "c" * 64)
        self.members = {
            name: FleetMember(
                FleetMembership(name, contracts, FRAME, 0.5, 6.0, 1.0), f"{number:016x}", self._take
            )
            for number, name in enumerate(names)
        }
        self.events: list[Event] = []
        for member in self.members.values():
            member.place_by(FRAME)

    def _take(self, event: Event) -> None:
        self.events.append(event)

    def rest(self, for_s: float, legs: dict[str, tuple[Place, Place]]) -> None:
        """Let all rest where they are, and ask for the legs that are given."""
        for _ in range(round(for_s / TICK_S)):
            self._now_s += TICK_S
            sent = []
            for name, member in self.members.items():
                course = Course(
                    WAYS[name][0],
                    self._now_s,
                    self._now_s,
                    True,
                    np.zeros((0, 4)),
                    legs.get(name),
                    self._terms,
                )
                member.advance(course, self._now_s)
                sent += member.take_to_send()
            for member in self.members.values():
                for key, payload in sent:
                    member.receive(key, payload)


def reach_m(member: FleetMember) -> tuple[float, float, float, float]:
    """Return the box around the tube."""
    low, high = member.tube_m[:, ::2].min(axis=0), member.tube_m[:, 1::2].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def test_all_of_a_leg_is_asked_for_with_what_the_vehicle_runs_on() -> None:
    fleet = Fleet(("north", "east"))
    fleet.rest(2.0, {})
    fleet.rest(2.0, {"north": WAYS["north"]})
    low_n, low_e, high_n, high_e = reach_m(fleet.members["north"])
    # Body, tracking error and what a vehicle at rest wanders: 0.95 m; the lane: 1 m.
    assert low_n <= -40.95
    assert high_n == pytest.approx(40.0 + 1.95 + TERMS.beyond_m, abs=0.01)
    assert (low_e, high_e) == pytest.approx((-1.95, 1.95), abs=0.01)


def test_none_of_a_leg_is_asked_for_while_another_crosses_it() -> None:
    """Who came nearer would stand in the way of a third."""
    fleet = Fleet(("north", "east", "aside"))
    fleet.rest(2.0, {})
    fleet.rest(3.0, {"north": WAYS["north"]})
    fleet.rest(8.0, WAYS)
    east, aside = fleet.members["east"], fleet.members["aside"]
    assert reach_m(east)[3] < -37.0
    assert east.waits_for() == "waiting for leave of north"
    assert reach_m(aside)[2] > 40.0  # which neither of both crosses


@given(st.floats(0.5, 15.0), st.floats(0.5, 8.0), st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_no_run_on_of_a_stop_leads_farther(
    cruise_mps: float, brake_mps2: float, run_on_s: float, share: float
) -> None:
    terms = replace(TERMS, cruise_mps=cruise_mps, brake_mps2=brake_mps2, run_on_s=run_on_s)
    speed_mps = share * cruise_mps
    beyond_m = speed_mps * run_on_s - speed_mps**2 / (2.0 * brake_mps2)
    assert beyond_m <= terms.beyond_m + 1e-9


def test_what_is_not_known_is_not_asked_for() -> None:
    assert replace(TERMS, run_on_s=math.nan).beyond_m == 0.0


# ------------------------------------------------------------------------ when it does not fly


def course(rests: bool = True, *, place_m: Place = (-40.0, 0.0), rests_s: float = 0.0) -> Course:
    """Return what a vehicle does that asks for nothing."""
    return Course(place_m, 0.0, rests_s, rests, np.zeros((0, 4)), None, TERMS)


def test_a_run_begins_once_the_vehicle_has_settled_at_rest() -> None:
    """The run before has leave for where its vehicle comes to rest, and for no more."""
    member = Fleet(("north", "east")).members["north"]
    member.advance(course(rests=False), 1.0)
    member.advance(course(), 1.1)
    member.advance(course(rests=False), 1.2)
    member.advance(course(), 1.3)
    assert member.objection() == "it has not been at rest since the daemon was started"
    assert not len(member.tube_m)
    member.advance(course(), 1.3 + TERMS.settle_s)
    assert member.reservation is not None
    assert member.objection() is None
    assert len(member.tube_m) == 1


def test_without_its_place_on_the_earth_it_is_silent_and_has_no_tube() -> None:
    fleet = Fleet(("north", "east"))
    fleet.rest(2.0, {})
    member = fleet.members["north"]
    assert len(member.tube_m)
    member.place_by(None, "no GPS")
    assert not len(member.tube_m)
    assert (member.objection(), member.waits_for()) == (
        "no GPS",
        "waiting for its place on the Earth: no GPS",
    )
    member.advance(course(), 50.0)
    assert member.take_to_send() == []
    moved = LocalFrame(GeographicPoint(47.4, 8.545594), "px4")
    member.place_by(moved)
    assert str(member.objection()).startswith("GPS_GLOBAL_ORIGIN has changed since the start")


def test_a_second_daemon_of_one_name_keeps_both_on_the_ground() -> None:
    one, other = (Fleet(("north", "east")) for _ in range(2))
    one.rest(2.0, {})
    other.rest(1.0, {})
    member, twin = one.members["north"], other.members["north"]
    twin._boot = "d" * 16
    twin.reservation = None
    twin.advance(course(), 3.0)
    for key, payload in twin.take_to_send():
        member.receive(key, payload)
    member.advance(course(), 3.0)
    assert member.objection() == "another daemon flies as north, or did until now"
    assert not len(member.tube_m)
    member.advance(course(), 9.0)
    assert member.objection() is None


def test_who_deviates_may_come_and_a_box_in_a_tube_is_its_owner() -> None:
    fleet = Fleet(("north", "east"))
    fleet.rest(2.0, {"east": WAYS["east"]})
    north = fleet.members["north"]
    assert north.reservation is not None
    peer = north.reservation.peers["east"]
    crossing = np.array([[-1.0, 1.0, -1.0, 1.0]])
    assert north.who_may_come(crossing, 60.0) is None
    peer.deviates = True
    assert north.who_may_come(crossing, 60.0) == "east"
    assert north.who_may_come(crossing, 2.0) is None, "it cannot be there yet"
    inside = [(-0.3, -0.3), (-0.3, 0.3), (0.3, 0.3), (0.3, -0.3)]
    assert north.is_peer(inside, 0.1)
    beside = [(n + 6.0, e) for n, e in inside]
    assert not north.is_peer(beside, 0.1)
    reaching_out = [(n if n < 0.0 else 6.0, e) for n, e in inside]
    assert not north.is_peer(reaching_out, 0.1)
    # The tube reaches 2.45 m to the side of the leg, and what is measured 0.6 m beyond it.
    edge = [(2.6 + n, e) for n, e in inside]
    assert north.is_peer(edge, 0.1)
    assert not north.is_peer([(n + 0.4, e) for n, e in edge], 0.1)
