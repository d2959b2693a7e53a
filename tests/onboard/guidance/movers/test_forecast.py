"""What planning keeps clear of around movers, and what it does where nothing is clear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from onboard.files.contract_file import Contract
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.movers.forecast import AHEAD_S, WINDOW_M, Forecast
from onboard.guidance.phases import FlightState, Phase
from onboard.planning.mover_certifier import Movers
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace
from tests.onboard.guidance.movers.test_yielding import requiring
from tests.onboard.guidance.perfect_flight import mission_to

NOW_S = 100.0
BODY_M = 0.5
# A leg to the east: x is east, and what lies to its right is south.
EAST = LegFrame((10.0, 20.0, 0.0), math.pi / 2.0)


@dataclass
class Loiterer:
    """One mover that stays about a place, as movers do that go round and round.

    Attributes:
        north_m, east_m: where.
        radius_m: somewhere within that.
        speed_mps: with which it may leave.
        now_s: the time.
    """

    north_m: float
    east_m: float
    radius_m: float = 1.0
    speed_mps: float = 1.0
    now_s: float = NOW_S

    @property
    def movers(self) -> Movers:
        return Movers(self, (), 0.0)

    def free_until_s(self, places_ned_m: FloatArray) -> FloatArray:
        away_m = np.hypot(places_ned_m[:, 0] - self.north_m, places_ned_m[:, 1] - self.east_m)
        left_s = (away_m - self.radius_m) / self.speed_mps
        return np.where(left_s > 0.0, self.now_s + left_s, -math.inf)

    def first_reached(self, low: FloatArray, high: FloatArray, until_s: FloatArray) -> int | None:
        place = np.array((self.north_m, self.east_m))
        away_m = np.hypot(*np.maximum(np.maximum(low - place, place - high), 0.0).T)
        reached = np.flatnonzero(away_m - self.radius_m < self.speed_mps * (until_s - self.now_s))
        return int(reached[0]) if reached.size else None


def forecast(mover: Loiterer, here_leg_m: tuple[float, float] = (0.0, 0.0)) -> Forecast:
    return Forecast(mover, EAST, here_leg_m, BODY_M, NOW_S)


def test_where_a_mover_comes_soon_is_met_in_the_frame_of_the_leg() -> None:
    # 6 m along the leg, 2 m to its left, is 6 m east and 2 m north of its origin.
    mover = Loiterer(12.0, 26.0)
    met = forecast(mover).are_met(np.array((6.0,)), np.array((-2.0, 0.5, 2.0)))
    assert met.tolist() == [[True, True, False]]
    edge_m = 1.0 + AHEAD_S
    near = forecast(mover).are_met(
        np.array((6.0 - edge_m + 0.1, 6.0 - edge_m - 0.1)), np.array((-2.0,))
    )
    assert near.tolist() == [[True], [False]]


def test_beyond_the_window_nothing_is_met() -> None:
    mover = Loiterer(10.0, 20.0 + WINDOW_M + 0.5, radius_m=2.0)
    met = forecast(mover).are_met(np.array((WINDOW_M - 0.1, WINDOW_M + 0.1)), np.array((0.0,)))
    assert met.tolist() == [[True], [False]]
    assert forecast(mover).are_met(np.array((50.0,)), np.array((0.0,))).tolist() == [[False]]


def test_a_vehicle_beside_a_mover_may_leave_by_what_it_reaches_first() -> None:
    mover = Loiterer(10.0, 21.8)  # 0.3 m from the body
    beside = forecast(mover)
    met = beside.are_met(np.array((-1.5, -0.4, 0.0, 0.6)), np.array((0.0,)))
    assert met[:, 0].tolist() == [False, False, False, True]


def test_the_seen_free_set_loses_what_is_met_and_nothing_else() -> None:
    cells = np.zeros((201, 201), np.int32)
    grid = FreeGrid((-10.0, -10.0), 0.1, cells)
    clear = forecast(Loiterer(12.0, 26.0)).clear_of(grid)
    assert not clear.is_free(5.9, 6.1, -2.1, -1.9)
    assert not clear.is_free(3.3, 6.1, -2.1, -1.9)
    assert clear.is_free(-9.0, 2.6, -9.0, 9.0)
    assert clear.is_free(-9.0, 9.0, 1.6, 9.0)
    assert grid.is_free(-9.0, 9.0, -9.0, 9.0)
    far = Loiterer(500.0, 500.0)
    assert forecast(far).clear_of(grid) is grid


def test_who_loiters_in_the_way_is_passed_at_a_distance(contract: Contract) -> None:
    """The certificate alone lets the vehicle wait for ever: the mover never leaves."""
    mission = mission_to((20.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
    seen = IdealSeenSpace(start_known=True)
    flight = FieldFlight(requiring(contract, "best_effort"), mission, (), seen)
    mover = Loiterer(12.0, 0.5, radius_m=1.5, speed_mps=0.5)
    flight.navigator.see_by(seen, mover)
    flight.depart()
    over = (FlightState.ARRIVED, FlightState.HOLDING)
    nearest_m = math.inf
    while flight.state not in over and flight.now_s < 60.0:
        flight.tick()
        mover.now_s = flight.now_s
        north_m, east_m, _ = flight.pose.position_ned_m
        nearest_m = min(nearest_m, math.hypot(north_m - mover.north_m, east_m - mover.east_m))
    assert flight.state is FlightState.ARRIVED, flight.states
    assert nearest_m > mover.radius_m + flight.navigator.assessment.terms.body_m


def test_where_nothing_is_clear_of_a_mover_it_is_the_reason_to_wait(contract: Contract) -> None:
    """A mover that shuts the whole corridor: YIELD, not a pause that ends in a hold."""
    mission = mission_to((20.0, 0.0)).model_copy(update={"start_clear_m": 3.0})
    seen = IdealSeenSpace(start_known=True)
    flight = FieldFlight(requiring(contract, "best_effort"), mission, (), seen)
    mover = Loiterer(13.0, 0.0, radius_m=9.0)
    flight.navigator.see_by(seen, mover)
    flight.depart()
    waiting_s = 0.0
    while flight.now_s < 12.0:
        flight.tick()
        mover.now_s = flight.now_s
        waiting_s += 0.02 if flight.state.phase is Phase.YIELD else 0.0
        assert flight.state is not FlightState.HOLDING
    assert waiting_s > 4.0
