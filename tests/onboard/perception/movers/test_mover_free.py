"""The mover-free set: no mover of declared speed is ever where it says that none can be."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from random import Random

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.perception.line_of_sight import View
from onboard.perception.movers.glance import Glance, boxes_array, without
from onboard.perception.movers.mover_free import CELL_M, MoverFree

ERROR_M = 0.05
SIZE_M = 0.4
RANGE_M, RING_M = 8.0, 5.0


def view(boxes: list[Box], half_rad: float, range_m: float, heading_rad: float = 0.0) -> View:
    return View((0.0, 0.0), heading_rad, half_rad, range_m, boxes, ERROR_M)


def glance(
    stamp_s: float,
    movers: list[Box],
    static: list[Box],
    half_rad: float,
    range_m: float,
    *,
    hidden: bool = True,
) -> Glance:
    everything = view([*movers, *static], half_rad, range_m)
    kept = [True] * len(movers) + [False] * len(static)
    grown = [box.inflated(ERROR_M) for box in movers]
    rows = [(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in grown]
    open_view = None if hidden else without(everything, kept)
    return Glance(everything, stamp_s, boxes_array(rows), open_view)


def empty_frames(
    free: MoverFree, count: int, begin_s: float = 0.0, period_s: float = 0.05
) -> float:
    for index in range(count):
        stamp_s = begin_s + index * period_s
        free.see(glance(stamp_s, [], [], math.pi, RING_M), "ring")
    return begin_s + (count - 1) * period_s


# ---------------------------------------------------------------------- by hand


def test_before_any_frame_no_place_is_free() -> None:
    free = MoverFree(1.0, RANGE_M)
    assert not free.is_free_at(1.0, 0.0, -1e9)
    assert free.free_cells(0.0) == 0


def test_what_enough_frames_show_is_free_until_a_mover_may_come_from_beyond() -> None:
    free = MoverFree(1.0, RANGE_M, frames_needed=3)
    empty_frames(free, 2)
    assert not free.is_free_at(0.0, 0.0, 0.0)
    now_s = empty_frames(free, 4)
    for distance_m in (0.0, 1.0, 3.0):
        left_s = RING_M - distance_m
        assert free.is_free_at(distance_m, 0.0, now_s + left_s - 1.0)
        assert not free.is_free_at(distance_m, 0.0, now_s + left_s)


def test_places_are_free_until_a_mover_may_come_and_never_beyond_the_grid() -> None:
    free = MoverFree(1.0, RANGE_M)
    now_s = empty_frames(free, 8)
    places = np.array(((0.0, 0.0), (3.0, 0.0), (0.0, 500.0)))
    until_s = free.free_until_s(places)
    assert until_s[0] > until_s[1] > now_s
    assert until_s[2] == -math.inf
    for (north_m, east_m), time_s in zip(places.tolist(), until_s.tolist(), strict=True):
        if math.isfinite(time_s):
            assert free.is_free_at(north_m, east_m, time_s - 0.01)
            assert not free.is_free_at(north_m, east_m, time_s + 0.01)


def test_a_faster_mover_comes_sooner() -> None:
    slow, fast = MoverFree(1.0, RANGE_M), MoverFree(2.0, RANGE_M)
    now_s = empty_frames(slow, 8)
    empty_frames(fast, 8)
    assert slow.is_free_at(0.0, 0.0, now_s + 4.0)
    assert not fast.is_free_at(0.0, 0.0, now_s + 4.0)
    assert fast.is_free_at(0.0, 0.0, now_s + 1.9)


def test_around_a_mover_it_grows_from_its_stamp() -> None:
    free = MoverFree(1.0, RANGE_M)
    mover = Box(2.0, 2.4, -0.2, 0.2)
    for index in range(6):
        free.see(glance(index * 0.05, [mover], [], math.pi, RING_M), "ring")
    now_s = 0.25
    assert not free.is_free_at(2.1, 0.0, now_s)
    assert free.is_free_at(0.0, 0.0, now_s + 1.2)
    assert not free.is_free_at(0.0, 0.0, now_s + 2.0)
    # Behind it, none is seen to be.
    assert not free.is_free_at(3.5, 0.0, now_s)


def test_the_frame_of_another_sensor_may_come_later_and_counts_in_its_place() -> None:
    """Put in its place the set is the same, whatever the order of arrival."""
    frames = []
    for index in range(12):
        mover = Box(3.0 - 0.04 * index, 3.4 - 0.04 * index, 0.0, 0.4)
        frames.append((glance(index * 0.05, [mover], [], math.pi / 3, RANGE_M), "front"))
        frames.append((glance(index * 0.05 + 0.02, [mover], [], math.pi, RING_M), "ring"))
    in_order, late = MoverFree(1.0, RANGE_M), MoverFree(1.0, RANGE_M)
    for one, source in frames:
        assert in_order.see(one, source)
    rings = [frame for frame in frames if frame[1] == "ring"]
    fronts = [frame for frame in frames if frame[1] == "front"]
    for index, front in enumerate(fronts):
        assert late.see(*front)
        if index >= 2:
            assert late.see(*rings[index - 2])
    for ring in rings[-2:]:
        assert late.see(*ring)
    assert late.dropped == 0
    for time_s in (0.57, 0.8, 1.5):
        assert in_order.free_cells(time_s) == late.free_cells(time_s) > 0
    assert not late.see(glance(-5.0, [], [], math.pi, RING_M), "ring")
    assert late.dropped == 1


def front_and_ring(free: MoverFree, ring_s: float, end_s: float) -> float:
    """See nothing: ahead at 10 Hz, all round once in a period; return when the ring saw last."""
    ring_due_s, seen_s = 0.0, 0.0
    for index in range(round(end_s * 10.0) + 1):
        now_s = index * 0.1
        free.see(glance(now_s, [], [], math.pi / 3, RANGE_M), "front")
        if now_s >= ring_due_s - 1e-9:
            free.see(glance(now_s, [], [], math.pi, RING_M), "ring")
            ring_due_s, seen_s = ring_due_s + ring_s, now_s
    return seen_s


@pytest.mark.parametrize("ring_s", [0.1, 0.5, 1.0, 1.7])
def test_a_sensor_may_be_slower_than_another_by_any_factor(ring_s: float) -> None:
    """Behind the vehicle only the ring looks; its third frame in a row shows that place."""
    free = MoverFree(1.0, RANGE_M, frames_needed=3)
    seen_s = front_and_ring(free, ring_s, 1.4 * ring_s)
    assert free.frames_in_row("ring") == 2
    assert not free.is_free_at(-0.3, 0.0, seen_s)
    free = MoverFree(1.0, RANGE_M, frames_needed=3)
    seen_s = front_and_ring(free, ring_s, 5.0 * ring_s)
    assert (free.frames_in_row("ring"), free.frames_in_row("front")) == (3, 3)
    # A mover may have come from where the first of the three did not look.
    assert free.is_free_at(-0.3, 0.0, seen_s + RING_M - 2.0 * ring_s - 1.5)
    assert not free.is_free_at(-0.3, 0.0, seen_s + RING_M)


def test_a_row_that_a_slow_sensor_broke_begins_again() -> None:
    free = MoverFree(1.0, RANGE_M, frames_needed=3)
    front_and_ring(free, 1.0, 4.0)
    free.break_row("ring")
    assert (free.frames_in_row("ring"), free.frames_in_row("front")) == (0, 3)
    free.see(glance(5.0, [], [], math.pi, RING_M), "ring")
    assert free.frames_in_row("ring") == 1
    free.forget_seen()
    assert free.frames_in_row("front") == 0


def test_a_row_of_a_slow_sensor_moves_with_the_grid() -> None:
    moved, still = MoverFree(1.0, RANGE_M), MoverFree(1.0, RANGE_M)
    for free in (moved, still):
        seen_s = front_and_ring(free, 1.0, 2.9)
        if free is moved:
            free.centre_on(4.1, 0.0)
        seen_s = 3.0
        free.see(glance(seen_s, [], [], math.pi, RING_M), "ring")
        assert free.is_free_at(-0.3, 0.0, seen_s + 0.1)
        assert not free.is_free_at(-4.7, 0.0, seen_s + 0.1)


def test_hidden_or_not_the_shadow_of_a_tree() -> None:
    tree = Box(2.0, 2.3, -0.15, 0.15)
    for hidden in (True, False):
        free = MoverFree(1.0, RANGE_M)
        for index in range(6):
            free.see(glance(index * 0.05, [], [tree], math.pi, RING_M, hidden=hidden), "ring")
        assert free.is_free_at(3.5, 0.0, 0.25) != hidden
        assert free.is_free_at(1.5, 0.0, 1.5) != hidden


def test_a_mover_that_was_seen_to_go_behind_a_tree_may_come_out_again() -> None:
    tree = Box(2.0, 2.3, -0.6, 0.6)
    free = MoverFree(1.0, RANGE_M)
    for index in range(40):
        y_m = -1.6 + 0.05 * index  # goes into the shadow from the left
        walker = Box(3.0, 3.3, y_m, y_m + 0.3)
        seen = [walker] if y_m + 0.3 < -0.85 else []
        free.see(glance(index * 0.05, seen, [tree], math.pi, RING_M, hidden=False), "ring")
    assert not free.is_free_at(3.1, 0.0, 39 * 0.05)
    # For ever, as long as the shadow is not looked into; what is seen is free again.
    for index in range(40, 80):
        free.see(glance(index * 0.05, [], [tree], math.pi, RING_M, hidden=False), "ring")
    assert not free.is_free_at(3.1, 0.0, 79 * 0.05)
    assert free.is_free_at(3.0, 2.5, 79 * 0.05)


def test_who_is_first_seen_where_another_may_be_may_go_hiding_from_there() -> None:
    """Only a part of the second one is seen: the rest of it reaches into the shadow already."""
    tree = Box(2.0, 2.3, -0.6, 0.6)
    first = Box(2.4, 3.0, 2.7, 3.0)
    free = MoverFree(1.0, RANGE_M)
    for index in range(60):
        stamp_s = index * 0.05
        seen = [first] if index < 30 else []
        free.see(glance(stamp_s, seen, [tree], math.pi, RING_M, hidden=False), "ring")
    # By now the first one may have come to where a part of the second one comes into view.
    part, whole = Box(2.6, 2.8, 1.1, 1.3), (2.6, 4.4, -0.4, 1.4)
    stamp_s = 3.0
    frame = glance(stamp_s, [part], [tree], math.pi, RING_M, hidden=False)
    core = boxes_array([(2.7, 2.7, 1.2, 1.2)])
    free.see(replace(frame, movers=boxes_array([whole]), cores=core), "ring")
    for index in range(1, 16):
        stamp_s = 3.0 + index * 0.05
        free.see(glance(stamp_s, [], [tree], math.pi, RING_M, hidden=False), "ring")
    # It hides 0.6 m farther in than what it reached into, and had 0.75 s for that.
    assert not free.is_free_at(4.2, -1.0, stamp_s)


def test_a_doubt_forgets_that_none_is_hidden() -> None:
    tree = Box(2.0, 2.3, -0.15, 0.15)
    free = MoverFree(1.0, RANGE_M)
    free.void()
    for index in range(6):
        free.see(glance(index * 0.05, [], [tree], math.pi, RING_M, hidden=False), "ring")
    assert not free.is_free_at(3.5, 0.0, 0.25)


def test_a_frame_that_does_not_count_begins_the_row_of_its_sensor_again() -> None:
    free = MoverFree(1.0, RANGE_M, frames_needed=3)
    empty_frames(free, 2)
    free.break_row("ring")
    empty_frames(free, 2, 0.1)
    assert not free.is_free_at(1.0, 0.0, 0.15)
    empty_frames(free, 1, 0.2)
    assert free.is_free_at(1.0, 0.0, 0.2)
    # A late frame of another sensor leaves the rows as they were.
    other = MoverFree(1.0, RANGE_M, frames_needed=3)
    empty_frames(other, 2)
    other.break_row("ring")
    empty_frames(other, 2, 0.1)
    other.see(glance(0.01, [], [], math.pi / 3, RANGE_M), "front")
    assert not other.is_free_at(1.0, 0.0, 0.15)


def test_at_another_height_only_who_went_hiding_is_remembered() -> None:
    tree = Box(2.0, 2.3, -0.6, 0.6)
    free = MoverFree(1.0, RANGE_M)
    now_s = empty_frames(free, 6)
    free.forget_seen()
    assert free.free_cells(now_s) == 0
    for index in range(6):
        stamp_s = now_s + 0.05 * (index + 1)
        free.see(glance(stamp_s, [], [tree], math.pi, RING_M, hidden=False), "ring")
    assert free.is_free_at(3.1, 0.0, stamp_s)


def test_near_an_all_round_sensor_what_is_not_reported_is_not_there() -> None:
    front, ring = MoverFree(1.0, RANGE_M), MoverFree(1.0, RANGE_M)
    for index in range(5):
        front.see(glance(index * 0.05, [], [], math.pi / 3, RANGE_M), "front")
        ring.see(glance(index * 0.05, [], [], math.pi, RING_M), "ring")
    assert ring.is_free_at(0.0, 0.0, 0.2)
    assert not front.is_free_at(0.0, 0.0, 0.2)
    beside = Box(0.4, 0.6, 0.0, 0.2)
    for index in range(5, 12):
        ring.see(glance(index * 0.05, [beside], [], math.pi, RING_M), "ring")
    assert not ring.is_free_at(0.4, 0.0, 0.55)


def test_the_grid_moves_with_the_vehicle() -> None:
    free = MoverFree(1.0, RANGE_M)
    now_s = empty_frames(free, 8)
    free.centre_on(4.1, 0.0)
    assert free.is_free_at(3.0, 0.0, now_s + 1.0)
    free.centre_on(400.0, 0.0)
    assert not free.is_free_at(3.0, 0.0, now_s)
    free.centre_on(0.0, 0.0)
    assert not free.is_free_at(3.0, 0.0, now_s)


def test_rectangles_have_a_time_each() -> None:
    free = MoverFree(1.0, RANGE_M)
    now_s = empty_frames(free, 8)
    low, high = np.array(((0.0, 0.0), (2.0, -0.5))), np.array(((0.5, 0.5), (3.0, 0.5)))
    assert free.are_free(low, high, np.array((now_s + 3.0, now_s + 1.0)))
    assert free.first_reached(low, high, np.array((now_s + 3.0, now_s + 3.0))) == 1
    assert free.first_reached(low * np.nan, high, np.array((now_s, now_s))) == 0
    assert free.first_reached(low + 1e3, high + 1e3, np.array((now_s, now_s))) == 0


# ---------------------------------------------------------------------- against zigzagging movers


@dataclass
class Walker:
    """A square that heads for the sensor or anywhere, at its speed."""

    x_m: float
    y_m: float
    speed_mps: float
    heading_rad: float = 0.0
    trail: list[Box] = field(default_factory=list)

    @property
    def box(self) -> Box:
        half_m = SIZE_M / 2.0
        return Box(self.x_m - half_m, self.x_m + half_m, self.y_m - half_m, self.y_m + half_m)

    def go(self, random: Random, step_s: float) -> None:
        if random.random() < 0.1:
            inwards = math.atan2(-self.y_m, -self.x_m)
            self.heading_rad = random.choice((inwards, random.uniform(-math.pi, math.pi)))
        self.x_m += self.speed_mps * step_s * math.cos(self.heading_rad)
        self.y_m += self.speed_mps * step_s * math.sin(self.heading_rad)


def is_visible(box: Box, others: list[Box], half_rad: float, range_m: float) -> bool:
    """Tell whether any of some points of a box is in view, in range, and behind no other box."""
    for x_m in np.linspace(box.x_min_m, box.x_max_m, 5):
        for y_m in np.linspace(box.y_min_m, box.y_max_m, 5):
            if math.hypot(x_m, y_m) > range_m or abs(math.atan2(y_m, x_m)) > half_rad:
                continue
            steps = [(x_m * k / 30.0, y_m * k / 30.0) for k in range(30)]
            if not any(
                other.x_min_m <= x <= other.x_max_m and other.y_min_m <= y <= other.y_max_m
                for other in others
                for x, y in steps
            ):
                return True
    return False


STATIC = [Box(2.0, 2.4, 1.0, 1.4), Box(-2.4, -2.0, -1.5, -1.1)]


class Sensors:
    """Two sensors with trackers that report a mover in the third frame in which it is visible."""

    def __init__(self, walkers: list[Walker], ring_ticks: int = 3) -> None:
        self._walkers, self._ring_ticks = walkers, ring_ticks
        self._rows: dict[tuple[str, int], int] = {}
        self._waiting: list[tuple[float, Glance, str]] = []

    def look(self, tick: int, time_s: float) -> None:
        """Take the frames that are due: staggered, the ring's slower and later."""
        if tick % 2 == 0:
            self._take("front", math.pi / 3, RANGE_M, time_s, 0.03)
        if tick % self._ring_ticks == 1:
            self._take("ring", math.pi, RING_M, time_s, 0.09)

    def _take(
        self, source: str, half_rad: float, range_m: float, time_s: float, latency_s: float
    ) -> None:
        reported = []
        for index, walker in enumerate(self._walkers):
            others = [*STATIC, *(w.box for w in self._walkers if w is not walker)]
            visible = is_visible(walker.box, others, half_rad, range_m)
            row = self._rows.get((source, index), 0) + 1 if visible else 0
            self._rows[source, index] = row
            if row >= 3:
                reported.append(walker.box)
        frame = glance(time_s, reported, STATIC, half_rad, range_m)
        self._waiting.append((time_s + latency_s, frame, source))

    def arrived(self, time_s: float) -> list[tuple[Glance, str]]:
        due = [(frame, source) for at_s, frame, source in self._waiting if at_s <= time_s]
        self._waiting = [each for each in self._waiting if each[0] > time_s]
        return due


def contradictions(seed: int, speed_mps: float, ring_ticks: int = 3) -> int:
    """Return how often a mover was where none could be, by a set for 1 m/s."""
    random, free = Random(seed), MoverFree(1.0, RANGE_M, frames_needed=3)
    walkers = []
    for _ in range(5):
        bearing_rad, away_m = random.uniform(-math.pi, math.pi), random.uniform(2.0, 9.0)
        x_m, y_m = away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
        walkers.append(Walker(x_m, y_m, speed_mps))
    sensors, found = Sensors(walkers, ring_ticks), 0
    for tick in range(160):
        time_s = tick * 0.025
        for walker in walkers:
            walker.go(random, 0.025)
        sensors.look(tick, time_s)
        for frame, source in sensors.arrived(time_s):
            free.see(frame, source)
        for walker in walkers:
            box = walker.box
            corners = ((box.x_min_m, box.y_min_m), (box.x_max_m, box.y_max_m))
            for x_m, y_m in ((walker.x_m, walker.y_m), *corners):
                found += free.is_free_at(x_m, y_m, time_s + 1e-6)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_no_mover_of_declared_speed_is_where_none_can_be(seed: int) -> None:
    """Hostile and zigzagging, hidden behind each other and trees, with staggered late frames."""
    assert contradictions(seed, 1.0) == 0


def test_none_is_beside_a_ring_that_is_ten_times_slower_either() -> None:
    assert contradictions(1, 1.0, ring_ticks=20) == 0


def test_movers_that_are_faster_are() -> None:
    assert sum(contradictions(seed, 1.6) for seed in range(3)) > 0


def test_cells_are_not_larger_than_what_is_near() -> None:
    assert CELL_M * 2.0 < 0.7
