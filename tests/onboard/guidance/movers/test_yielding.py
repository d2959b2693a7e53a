"""Flights that movers stop: they rest before any can be there, wait, and go on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from onboard.contract.run_on import NO_RUN_ON
from onboard.files.contract_file import Contract
from onboard.files.contract_terms.mover_terms import MoversLevel
from onboard.geometry.frames import FloatArray
from onboard.guidance.movers.early_stop import early_stops
from onboard.guidance.movers.mover_guard import NoMovers
from onboard.guidance.phases import FlightState, Phase
from onboard.planning.corridor.horizon import Horizon
from onboard.planning.mover_certifier import Movers
from onboard.planning.rest_certifier import RestLimits
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace, Stem
from tests.onboard.guidance.perfect_flight import mission_to

OVER = (FlightState.ARRIVED, FlightState.HOLDING)


@dataclass
class Gate:
    """Beyond a line across the way a mover may be at any time, while it is closed.

    Attributes:
        north_m: of the line.
        closed: whether it is.
    """

    north_m: float
    closed: bool = True
    asked: int = field(default=0, init=False)

    @property
    def movers(self) -> Movers:
        return Movers(self, (), 0.0)

    def first_reached(self, low: FloatArray, high: FloatArray, until_s: FloatArray) -> int | None:
        assert (low <= high).all()
        assert np.isfinite(until_s).all()
        self.asked += 1
        beyond = np.flatnonzero(high[:, 0] > self.north_m)
        return int(beyond[0]) if self.closed and beyond.size else None

    def free_until_s(self, places_ned_m: FloatArray) -> FloatArray:
        beyond = self.closed & (places_ned_m[:, 0] > self.north_m)
        return np.where(beyond, -math.inf, math.inf)


GatedFlight = Callable[..., FieldFlight]
# Where both requirements on progress need the same, one is flown.
CRUISING = pytest.mark.parametrize("gated", ["guaranteed"], indirect=True)


def requiring(contract: Contract, progress: str, yield_max_s: float | None = None) -> Contract:
    """Return the contract with another requirement, as the navigator reads it."""
    changes = {"progress": progress, "stop": True, "yield_max_s": yield_max_s}
    requirements = contract.requirements.model_copy(update=changes)
    return contract.model_copy(update={"requirements": requirements})


@pytest.fixture(params=["guaranteed", "best_effort"])
def gated(contract: Contract, request: pytest.FixtureRequest) -> GatedFlight:
    """Make a flight to a gate, on foreknown ground."""

    def make(gate: Gate, *stems: Stem, yield_max_s: float | None = None) -> FieldFlight:
        required = requiring(contract, request.param, yield_max_s)
        mission = mission_to((45.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
        seen = IdealSeenSpace(start_known=request.param == "best_effort")
        flight = FieldFlight(required, mission, stems, seen)
        flight.navigator.see_by(seen, gate)
        return flight

    return make


def furthest_m(flight: FieldFlight) -> float:
    """Return how far north a part of the vehicle may be, its tracking error included."""
    north_m = flight.navigator.leg.position_ned(flight.reference.position_leg_m)[0]
    return north_m + flight.navigator.assessment.terms.body_m


def test_it_rests_before_the_gate_and_goes_on_once_it_opens(gated: GatedFlight) -> None:
    gate = Gate(12.0)
    flight = gated(gate)
    flight.depart()
    flight.run(60.0, until=lambda: flight.state.phase is Phase.YIELD)
    assert flight.state.phase is Phase.YIELD
    flight.run(6.0)
    assert flight.state.phase is Phase.YIELD
    cruised = FlightState.CRUISING in flight.states
    assert furthest_m(flight) <= gate.north_m
    assert math.hypot(*flight.reference.velocity_leg_mps) < 0.01
    # It has come near, with every way to rest that it held on this side.
    assert furthest_m(flight) > gate.north_m - 6.0
    gate.closed = False
    before = len(flight.states)
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.states[-1] is FlightState.ARRIVED, flight.states
    # What was cruised is cruised on, without threading.
    assert (FlightState.THREADING in flight.states[before:]) != cruised


def test_what_is_held_goes_on_when_a_mover_appears_beside_it(gated: GatedFlight) -> None:
    """The way that was accepted is not checked again: it ends at rest as it was certified."""
    gate = Gate(-100.0, closed=False)
    flight = gated(gate)
    flight.depart()
    flight.run(60.0, until=lambda: furthest_m(flight) > 6.0)
    gate.closed = True
    reference = flight.situation.reference
    way = reference.guard or reference.upcoming or reference.current
    assert way is not None
    end_leg_m = way.final.position_leg_m
    flight.run(9.0)
    assert flight.state is FlightState.YIELDING
    assert flight.reference.position_leg_m == pytest.approx(end_leg_m, abs=1e-6)


@CRUISING
def test_a_wait_may_have_an_end(gated: GatedFlight) -> None:
    gate = Gate(12.0)
    flight = gated(gate, yield_max_s=4.0)
    flight.depart()
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.HOLDING
    assert any("yield_time" in event.text for event in flight.events)


@CRUISING
@pytest.mark.parametrize("level", ["passive", "passive_in_view"])
def test_without_a_ring_a_wait_ends_where_movers_may_have_come_unseen(
    gated: GatedFlight, level: MoversLevel
) -> None:
    """What was vouched for, or seen, has worn off at the very place where the vehicle rests."""
    gate = Gate(12.0)
    flight = gated(gate)
    flight.depart()
    assessment = flight.situation.assessment
    terms = replace(assessment.terms, movers_level=level)
    flight.situation.assessment = replace(assessment, terms=terms)
    flight.run(60.0, until=lambda: flight.state.phase is Phase.YIELD)
    flight.run(2.0)
    assert flight.states[-1:] == [FlightState.YIELDING]
    gate.north_m = -100.0
    flight.run(1.0)
    lost = [event.text for event in flight.events if "mover_view" in event.text]
    assert bool(lost) == (level == "passive_in_view")
    assert (flight.states[-1] is FlightState.HOLDING) == bool(lost)


@CRUISING
def test_a_flight_without_movers_asks_nothing(gated: GatedFlight) -> None:
    gate = Gate(12.0)
    flight = gated(gate)
    assert flight.navigator.thread is not None
    flight.navigator.thread.guard.known = NoMovers()
    flight.depart()
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.ARRIVED
    assert gate.asked == 0


@CRUISING
def test_the_wait_ends_for_the_pilot(gated: GatedFlight) -> None:
    flight = gated(Gate(12.0))
    flight.depart()
    flight.run(60.0, until=lambda: flight.state is FlightState.YIELDING)
    flight.navigator.release_control(flight.now_s)
    assert flight.state is FlightState.STANDBY


# ---------------------------------------------------------------------- earlier stops


def test_stops_along_a_plan_keep_to_its_limits_and_end_at_rest() -> None:
    limits = RestLimits(0.5, 3.0, (2.6,) * 4, 2.6, 6.0, NO_RUN_ON)
    jerk_mps3 = np.zeros((30, 2))
    jerk_mps3[:3] = (3.0, 1.0)
    jerk_mps3[3:6] = (-3.0, -1.0)
    plan = Horizon.integrated(5.0, np.zeros((3, 2)), jerk_mps3)
    stops = list(early_stops(plan, limits))
    assert len(stops) >= 3
    ends_m = [stop.nodes[-1, 0, 0] for stop in stops]
    assert ends_m == sorted(ends_m, reverse=True)
    for stop in stops:
        assert np.abs(stop.nodes[-1, 1:]).max() == 0.0
        assert np.hypot(*stop.nodes[:, 2].T).max() <= 2.6
        assert np.abs(stop.jerk_mps3).max() <= 6.0
        way = stop.trajectory(0.0)
        for one, other in zip(way.ends, way.motion, strict=False):
            assert np.abs(one[:-1] - other[1:]).max() < 1e-9


def test_a_plan_that_cannot_be_left_in_time_has_no_stop() -> None:
    limits = RestLimits(0.5, 9.0, (0.1,) * 4, 0.1, 0.1, NO_RUN_ON)
    fast = np.array(((0.0, 0.0), (8.0, 0.0), (0.0, 0.0)))
    plan = Horizon.integrated(0.0, fast, np.zeros((30, 2)))
    assert list(early_stops(plan, limits)) == []
