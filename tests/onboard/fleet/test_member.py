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
