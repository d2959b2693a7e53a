"""A vehicle that sees ahead only: the mover-free set is what carries it, or stops it.

It flies along x, goes on for a tick where "that, then brake" meets no place that a mover may have
come to, and brakes where it does not.  Walkers chase it from all round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import View
from onboard.perception.movers.glance import Glance, boxes_array, without
from onboard.perception.movers.mover_free import MoverFree

PERIOD_S = 0.1
RANGE_M = 11.0
BODY_M = 0.5
ERROR_M = 0.05
BRAKE_MPS2 = 2.5
CRUISE_MPS = 2.5
MOVER_MPS = 0.5
WORD_M = 5.0


@dataclass
class Walker:
    """A square of 0.4 m that runs to the vehicle, to where it will be, or across its way."""

    x_m: float
    y_m: float
    speed_mps: float
    lead_s: float
    rows: int = 0

    @property
    def box(self) -> Box:
        return Box(self.x_m - 0.2, self.x_m + 0.2, self.y_m - 0.2, self.y_m + 0.2)

    def go(self, to_x_m: float) -> None:
        away_m = math.hypot(to_x_m - self.x_m, self.y_m)
        if away_m > 1e-6:
            self.x_m += self.speed_mps * PERIOD_S * (to_x_m - self.x_m) / away_m
            self.y_m -= self.speed_mps * PERIOD_S * self.y_m / away_m

    def gap_m(self, x_m: float) -> float:
        return math.hypot(max(abs(self.x_m - x_m) - 0.2, 0.0), max(abs(self.y_m) - 0.2, 0.0))


@dataclass
class Ahead:
    """The vehicle, what it sees, and what it may.

    Attributes:
        half_rad: of its view.
        walkers: who is about.
        word_m: within which none is at the start, as the operator says.
        tree: stands still, and movers may hide behind it.
    """

    half_rad: float
    walkers: list[Walker] = field(default_factory=list)
    word_m: float = WORD_M
    tree: Box | None = None
    now_s: float = 0.0
    x_m: float = 0.0
    speed_mps: float = 0.0
    touched_moving: int = 0
    stops: int = 0

    def __post_init__(self) -> None:
        self.free = MoverFree(MOVER_MPS, RANGE_M)
        self.free.take_word(0.0, 0.0, self.word_m, 0.0)

    def see(self) -> None:
        """Take a frame; who comes into view is named in the third that shows a part of it."""
        boxes = []
        for walker in self.walkers:
            box = walker.box
            corners = [
                (x, y) for x in (box.x_min_m, box.x_max_m) for y in (box.y_min_m, box.y_max_m)
            ]
            visible = any(
                math.hypot(x - self.x_m, y) <= RANGE_M
                and abs(math.atan2(y, x - self.x_m)) <= self.half_rad
                for x, y in corners
            )
            walker.rows = walker.rows + 1 if visible else 0
            if walker.rows >= 3:
                boxes.append(box)
        grown = [box.inflated(ERROR_M) for box in boxes]
        rows = boxes_array([(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in grown])
        standing = [] if self.tree is None else [self.tree]
        blocked = [*boxes, *standing]
        view = View((self.x_m, 0.0), 0.0, self.half_rad, RANGE_M, blocked, ERROR_M)
        self.free.centre_on(self.x_m, 0.0)
        self.free.see(Glance(view, self.now_s, rows), "front")

    def may(self, speed_mps: float) -> bool:
        """Tell whether a tick towards a speed and braking then meets no place of a mover."""
        times_s = (
            np.arange(1, math.ceil((PERIOD_S + speed_mps / BRAKE_MPS2) / PERIOD_S) + 2) * PERIOD_S
        )
        left_s = np.clip(times_s - PERIOD_S, 0.0, speed_mps / BRAKE_MPS2)
        ahead_m = speed_mps * np.minimum(times_s, PERIOD_S) + speed_mps * left_s
        ahead_m -= BRAKE_MPS2 * left_s**2 / 2.0
        before_m = np.concatenate(((0.0,), ahead_m[:-1]))
        low = np.stack((self.x_m + before_m - BODY_M, np.full(len(times_s), -BODY_M)), axis=1)
        high = np.stack((self.x_m + ahead_m + BODY_M, np.full(len(times_s), BODY_M)), axis=1)
        until_s = (self.now_s + times_s).astype(np.float64)
        return self.free.are_free(low, high, until_s)

    def run(self, duration_s: float, speed_mps: float = CRUISE_MPS) -> None:
        for _ in range(round(duration_s / PERIOD_S)):
            self.see()
            wanted_mps = min(speed_mps, self.speed_mps + BRAKE_MPS2 * PERIOD_S)
            if self.may(wanted_mps):
                self.speed_mps = wanted_mps
            elif self.speed_mps > 0.0:
                self.speed_mps = max(0.0, self.speed_mps - BRAKE_MPS2 * PERIOD_S)
                self.stops += self.speed_mps == 0.0
            self.x_m += self.speed_mps * PERIOD_S
            self.now_s += PERIOD_S
            for walker in self.walkers:
                walker.go(self.x_m + self.speed_mps * walker.lead_s)
                if self.speed_mps > 0.0 and walker.gap_m(self.x_m) < BODY_M - 0.1:
                    self.touched_moving += 1


def hostile(seed: int, within_m: float) -> list[Walker]:
    """Return walkers beside, behind and ahead, none nearer to the start than told."""
    draw = Random(seed)
    found: list[Walker] = []
    while len(found) < 8:
        x_m, y_m = draw.uniform(-8.0, 30.0), draw.uniform(-8.0, 8.0)
        if math.hypot(x_m, y_m) > within_m + 0.4:
            found.append(Walker(x_m, y_m, MOVER_MPS, draw.choice((0.0, 1.0, 3.0))))
    return found


def test_a_steady_cruise_goes_on_for_ever_in_a_view_that_is_wide_enough() -> None:
    flight = Ahead(math.radians(60.0))
    flight.run(12.5)
    # The operator's word has worn off by then, and the start is far behind.
    assert flight.now_s > WORD_M / MOVER_MPS
    assert flight.stops == 0
    assert flight.x_m > 25.0


def test_in_a_narrow_view_the_cruise_comes_to_rest_once_the_word_has_worn_off() -> None:
    flight = Ahead(math.radians(12.0))
    flight.run(12.5)
    assert flight.stops > 0
    assert flight.x_m < 25.0


def test_a_vehicle_that_is_no_faster_than_who_follows_comes_to_rest() -> None:
    flight = Ahead(math.radians(60.0))
    flight.run(12.5, speed_mps=MOVER_MPS)
    assert flight.stops > 0
    # Whoever was behind may be there now: without another word it stays.
    rested_m = flight.x_m
    flight.run(3.0)
    assert flight.x_m == rested_m
    flight.free.take_word(flight.x_m, 0.0, WORD_M, flight.now_s)
    flight.run(3.0)
    assert flight.x_m > rested_m + 3.0


@pytest.mark.parametrize(("more", "stops"), [(1.0, False), (0.2, True)])
def test_who_hides_behind_a_tree_asks_for_room_beside_it(more: float, *, stops: bool) -> None:
    """With v_o t_s and the cells' metre beside the body it passes; with a part of that it waits."""
    stopping_s = 2.0 * PERIOD_S + CRUISE_MPS / BRAKE_MPS2
    beside_m = BODY_M + more * (MOVER_MPS * stopping_s + 1.0)
    tree = Box(7.0, 7.4, beside_m, beside_m + 0.4)
    flight = Ahead(math.radians(60.0), tree=tree)
    flight.run(6.0)
    assert (flight.stops > 0) == stops
    assert (flight.x_m > 10.0) != stops


def test_without_a_word_it_does_not_start() -> None:
    flight = Ahead(math.radians(60.0), word_m=0.1)
    flight.run(3.0)
    assert flight.x_m == 0.0


@pytest.mark.parametrize("seed", range(2))
def test_no_pursuer_touches_it_while_it_moves(seed: int) -> None:
    flight = Ahead(math.radians(60.0), hostile(seed, WORD_M))
    flight.run(10.0)
    assert flight.x_m > 2.0
    assert flight.touched_moving == 0


def test_where_the_word_is_wrong_some_do() -> None:
    flight = Ahead(math.radians(60.0), [Walker(-0.1, -0.65, MOVER_MPS, 0.5)])
    flight.run(2.0)
    assert flight.touched_moving > 0


def test_a_word_counts_from_its_time_on_at_every_height() -> None:
    free = MoverFree(1.0, RANGE_M)
    free.take_word(2.0, 0.0, 3.0, 10.0)
    assert free.is_free_at(2.0, 0.0, 12.4)
    assert not free.is_free_at(2.0, 0.0, 13.0)
    assert not free.is_free_at(5.2, 0.0, 10.0)
    free.forget_seen()
    assert free.is_free_at(2.0, 0.0, 12.4)
    # Frames of before tell nothing of after.
    early = View((0.0, 0.0), 0.0, math.pi, RANGE_M, [], ERROR_M)
    assert not free.see(Glance(early, 9.9, boxes_array([])), "ring")
    free.void()
    assert not free.is_free_at(2.0, 0.0, 10.0)


def test_a_word_that_is_contradicted_is_not_taken_again() -> None:
    free = MoverFree(1.0, RANGE_M)
    free.take_word(0.0, 0.0, 4.0, 0.0)
    there = boxes_array([(2.0, 2.4, -0.2, 0.2)])
    view = View((0.0, 0.0), 0.0, math.pi, RANGE_M, [Box(2.0, 2.4, -0.2, 0.2)], ERROR_M)
    free.see(Glance(view, 0.1, there), "front")
    assert not free.is_free_at(1.9, 0.0, 0.4)
    free.forget_seen()
    assert not free.is_free_at(0.0, 0.0, 0.1)


def test_what_a_box_may_reach_is_no_surprise_but_what_it_fills_is() -> None:
    """At the edge of a view the hidden part of a mover may lie where none is."""
    around = boxes_array([(2.0, 4.4, -1.2, 1.2)])
    view = View((0.0, 0.0), 0.0, math.pi, RANGE_M, [Box(4.0, 4.4, -0.2, 0.2)], ERROR_M)
    left = []
    for core in ((3.9, 3.9, 0.0, 0.0), (2.2, 2.4, 0.0, 0.2)):
        free = MoverFree(1.0, RANGE_M)
        free.take_word(0.0, 0.0, 3.5, 0.0)
        free.see(Glance(view, 0.1, around, cores=boxes_array([core])), "front")
        left.append(free.free_cells(2.9))
        assert not free.is_free_at(2.2, 0.0, 0.1)
    assert left[0] > left[1] == 0


def test_the_shadow_of_a_mover_never_counts_as_seen() -> None:
    """Of what stands still it does, where the contract says that none hides there."""
    box = Box(2.0, 2.4, -0.4, 0.4)
    for moves in (True, False):
        free = MoverFree(1.0, RANGE_M)
        rows = boxes_array([(2.0, 2.4, -0.4, 0.4)] if moves else [])
        view = View((0.0, 0.0), 0.0, math.pi, RANGE_M, [box], ERROR_M)
        for index in range(6):
            seen = Glance(view, index * 0.05, rows, without(view, [moves]))
            free.see(seen, "ring")
        assert free.is_free_at(4.0, 0.0, 0.25) != moves
