"""Flights that meet slow movers: they are passed in flight where that is required."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract, load_contract
from onboard.files.contract_terms.mover_terms import MoversLevel
from onboard.geometry.box import Box
from onboard.guidance.dense.shield import Shield
from onboard.guidance.phases import FlightState, Phase
from onboard.motion.trajectory import Trajectory
from onboard.planning.mover_certifier import UNASKED, Movers
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace, Stem
from tests.onboard.guidance.perfect_flight import mission_to

CONTRACT = load_contract(Path(__file__).parents[4] / "config" / "avoid_contract.yaml")
HALF_M = 0.3
DECLARED_MPS = 0.4
OVER = (FlightState.ARRIVED, FlightState.HOLDING)


@dataclass
class Walker:
    """A person who walks along a line: the track of one mover, seen at all times.

    Attributes:
        north_m, east_m: where it begins.
        velocity_mps: north and east.
        now_s: the clock of the flight.
    """

    north_m: float
    east_m: float
    velocity_mps: tuple[float, float] = (0.0, 0.0)
    now_s: Callable[[], float] = field(default=lambda: 0.0)

    @property
    def id(self) -> str:
        return "front/walker"

    def at(self, time_s: float) -> tuple[float, float]:
        north_mps, east_mps = self.velocity_mps
        return self.north_m + north_mps * time_s, self.east_m + east_mps * time_s

    def predicted(self, time_s: float, stamp_error_s: float = 0.0) -> Box:
        now_s = self.now_s()
        north_m, east_m = self.at(now_s)
        reach_m = HALF_M + DECLARED_MPS * (max(time_s - now_s, 0.0) + stamp_error_s)
        return Box(north_m - reach_m, north_m + reach_m, east_m - reach_m, east_m + reach_m)


@dataclass
class Street:
    """All walkers: what the guard knows of them."""

    walkers: list[Walker]

    @property
    def movers(self) -> Movers:
        return Movers(UNASKED, self.walkers, 0.01)


class StreetFlight(FieldFlight):
    """A flight among walkers, on ground that is known.

    Attributes:
        room_m: least distance of the body, errors included, from a walker's true box, in motion.
        in_map: most obstacles that the map has had.
    """

    def __init__(self, contract: Contract, *walkers: Walker, stems: tuple[Stem, ...] = ()) -> None:
        mission = mission_to((50.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
        seen = IdealSeenSpace()
        super().__init__(contract, mission, stems, seen)
        self.walkers, self.room_m, self.in_map = walkers, math.inf, 0
        for walker in walkers:
            walker.now_s = lambda: self.now_s
        self.navigator.see_by(seen, Street(list(walkers)))

    def tick(self) -> None:
        super().tick()
        self.in_map = max(self.in_map, len(self.navigator.obstacles))
        if self.state is FlightState.STANDBY or math.hypot(*self.reference.velocity_leg_mps) < 0.01:
            return
        north_m, east_m, _ = self.navigator.leg.position_ned(self.reference.position_leg_m)
        for walker in self.walkers:
            at_north_m, at_east_m = walker.at(self.now_s)
            apart_m = math.hypot(
                max(abs(north_m - at_north_m) - HALF_M, 0.0),
                max(abs(east_m - at_east_m) - HALF_M, 0.0),
            )
            self.room_m = min(self.room_m, apart_m - self.navigator.assessment.terms.body_m)


def requiring(level: MoversLevel) -> Contract:
    changed = CONTRACT.requirements.model_copy(update={"movers": level})
    return CONTRACT.model_copy(update={"requirements": changed})


def flown(level: MoversLevel, *walkers: Walker, stems: tuple[Stem, ...] = ()) -> StreetFlight:
    flight = StreetFlight(requiring(level), *walkers, stems=stems)
    flight.depart()
    flight.run(60.0, until=lambda: flight.state in OVER or flight.state is FlightState.YIELDING)
    return flight


def test_a_slow_walker_ahead_is_passed_without_a_stop() -> None:
    flight = flown("avoid", Walker(32.0, 0.4, (-DECLARED_MPS, 0.0)))
    assert flight.state is FlightState.ARRIVED, flight.states
    assert not {FlightState.YIELDING, FlightState.THREADING} & set(flight.states)
    assert flight.room_m > 0.0
    assert any("passing mover front/walker on the" in event.text for event in flight.events)


def test_a_plan_is_offered_in_the_last_tick_before_it_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Earlier, what is held may brake before the plan begins, which then begins on nothing."""
    ahead_s, accepts = [], Shield.accepts

    def noted(shield: Shield, trajectory: Trajectory, now_s: float) -> bool:
        ahead_s.append(trajectory.start_s - now_s)
        return accepts(shield, trajectory, now_s)

    monkeypatch.setattr(Shield, "accepts", noted)
    flown("avoid", Walker(32.0, 0.4, (-DECLARED_MPS, 0.0)))
    assert any(each_s > 0.0 for each_s in ahead_s)
    assert max(ahead_s) <= TICK_S + 1e-6


def test_under_passive_the_same_walker_is_waited_for() -> None:
    flight = flown("passive", Walker(32.0, 0.4, (-DECLARED_MPS, 0.0)))
    assert flight.states[-1] is FlightState.YIELDING
    assert flight.room_m > 0.0


def test_one_who_stands_still_is_passed_and_never_enters_the_map() -> None:
    walker = Walker(24.0, -0.2)
    flight = StreetFlight(requiring("avoid"), walker)
    flight.depart()
    flight.run(40.0, until=lambda: flight.state.phase is Phase.AVOID)
    assert flight.state.phase is Phase.AVOID
    # What the monitors of size and separation look at is none of the movers.
    assert flight.navigator.obstacles_to_meet(flight.now_s) == []
    avoidance = flight.navigator.avoidance
    assert avoidance is not None
    room, path_m = avoidance.obstacle.region.manoeuvre, avoidance.plan.trajectory.control_points_m
    assert room.x_min_m <= path_m[..., 0].min()
    assert path_m[..., 0].max() <= room.x_max_m + 1e-6
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.state is FlightState.ARRIVED
    assert flight.in_map == 0
    assert flight.room_m > 0.0


def test_a_second_walker_beside_the_way_round_is_waited_for() -> None:
    """The separation is broken: whatever is flown is at rest before either can be there."""
    row = [Walker(26.0, east_m) for east_m in (-12.0, -8.0, -4.0, 0.0, 4.0, 8.0, 12.0)]
    flight = flown("avoid", *row)
    assert flight.states[-1] is FlightState.YIELDING, flight.states
    assert flight.room_m > 0.0
    # It goes on once they have gone.
    for walker in row:
        walker.north_m = -500.0
    flight.run(60.0, until=lambda: flight.state in OVER)
    assert flight.states[-1:] == [FlightState.ARRIVED]


def test_one_who_crosses_is_waited_for_and_the_flight_goes_on() -> None:
    """Six cross one behind the other, so that there is no way round."""
    crossing = [Walker(20.0, -6.0 + 3.0 * n, (0.0, DECLARED_MPS)) for n in range(-3, 3)]
    flight = flown("avoid", *crossing)
    assert flight.room_m > 0.0
    flight.run(90.0, until=lambda: flight.state in OVER)
    assert flight.states[-1] is FlightState.ARRIVED, flight.states
    assert flight.room_m > 0.0


def test_who_is_not_in_the_way_is_no_reason_for_a_plan() -> None:
    flight = flown("avoid", Walker(25.0, 20.0))
    assert flight.state is FlightState.ARRIVED
    assert not [event for event in flight.events if "passing mover" in event.text]
