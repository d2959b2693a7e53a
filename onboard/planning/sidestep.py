"""Stop, look, sidestep, go: the closed form by which every obstacle of the clause is passed.

Two-tier theory, sections 2.2 (A3) and 4.4 (P), as corrected.  Each motion runs from rest to rest
along one axis, with ramps of constant jerk.  On the way to its target it keeps ``kappa v + c a``
within the distance left plus an overhang at every time, so that a run-on ends within the overhang.
Nothing here decides on safety: `onboard.planning.rest_certifier` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon
from onboard.planning.corridor.rectangles import COVER, Rectangle
from onboard.planning.rest_certifier import GRID_TOLERANCE_M

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from onboard.contract.run_on import RunOn
    from onboard.geometry.box import Box
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.planning.rest_certifier import RestLimits

# How far a run-on may end beyond the target, the quickest first.
OVERHANGS_M: Final = (1.0, 0.6, 0.4, 0.2, 0.1)
# How far beyond the keep-out face to go: a cell's diagonal at least, more shows more behind it.
_BEYOND_FACE_M: Final = (0.6, 0.4, 0.25, 0.15)
# A metre of room at the side, up to the most of that, is worth so much of a way.
_ROOM_WEIGHT: Final = 1.5
_TARGETS_MAX: Final = 12
# Of what stands abreast, the nearest: the time for a decision is bounded.
_ABREAST_MAX: Final = 24
# Beside an obstacle that is nearer than this, a cell at its corner may not be seen free.
_GRAZING_CELLS: Final = 2
# How far to draw back first, and what to keep from what is not free: cells along the front face
# are seen at a grazing angle only.
_BACK_M: Final = (0.0, 0.3, 0.6, 1.0)
_ROOM_M: Final = 0.3
# Setting off for less than this does not count as progress.
GO_MIN_M: Final = 0.2
_REACH_M: Final = 12.0
_STEP_M: Final = 0.1
# Steps away from what is not seen, and how far ahead they have to lead.
_ASIDE_M: Final = (0.3, 0.6, 1.0, 1.5, 2.2, 3.0, 4.0)
_AHEAD_M: Final = 1.0
# Places nearer to each other than this are the same.
_SAME_PLACE_M: Final = 0.1
# Shares of the greatest speed and of the accelerations that are tried.
_SPEED_SHARES: Final = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.12, 0.06)
_PULL_SHARES: Final = (1.0, 0.5, 0.2)
# What an axis uses of its limits: tolerances of the certifier are not for planning.
_LIMIT_SHARE: Final = 0.999
_RAMPS_MAX: Final = 6
_ROUND_OFF_M: Final = 1e-9


@dataclass(frozen=True)
class Standstill:
    """Where the vehicle rests, and what it knows.

    Attributes:
        flown: the plan to stay there; a motion starts at its second node.
        grid: the seen-free set.
        boxes: known obstacles, leg frame.
        limits: as the certifier checks them.
        margin_m: that boxes are grown by to keep-outs of the reference: body and face error.
        goal_leg_m: end of the leg.
        tried_leg_m: places that have led no farther.
    """

    flown: Horizon
    grid: FreeGrid
    boxes: Sequence[Box]
    limits: RestLimits
    margin_m: float
    goal_leg_m: tuple[float, float]
    tried_leg_m: Sequence[tuple[float, float]] = ()

    @property
    def place_leg_m(self) -> tuple[float, float]:
        """Position (x, y) of the reference."""
        x_m, y_m = self.flown.nodes[-1, 0].tolist()
        return x_m, y_m

    def obstacle_ahead(self, *, cells: int = 0) -> Box | None:
        """Return the nearest known obstacle whose keep-out the line along the leg meets.

        Args:
            cells: or comes nearer to than so many cells.
        """
        x_m, y_m = self.place_leg_m
        margin_m = self.margin_m + 2.0 * GRID_TOLERANCE_M + cells * self.grid.cell_m
        ahead = [
            box
            for box in self.boxes
            if box.y_min_m - margin_m < y_m < box.y_max_m + margin_m
            and box.x_max_m + margin_m > x_m
        ]
        return min(ahead, key=lambda box: box.x_min_m, default=None)


def looks_aside_rad(
    shown_half_rad: float, radius_m: float, tracking_error_m: float
) -> tuple[float, ...]:
    """Return headings whose views show all that a sidestep to either side needs.

    All bearings within 45 deg + atan((rho_b + E) / (rho_b - E)) of the leg, where rho_b = radius
    plus E: what lies nearer is the place where the vehicle rests (P iii).

    Args:
        shown_half_rad: how far off the nose a look shows cells as a whole.
        radius_m: of the vehicle.
        tracking_error_m: E.
    """
    widest_rad = math.pi / 4.0 + math.atan2(radius_m + 2.0 * tracking_error_m, radius_m)
    count = math.ceil(widest_rad / shown_half_rad)
    step_rad = 2.0 * (widest_rad - shown_half_rad) / max(count - 1, 1)
    if count == 1:
        return (0.0,)
    return tuple(widest_rad - shown_half_rad - k * step_rad for k in range(count))


def go_ahead(at: Standstill) -> Iterator[Horizon]:
    """Yield motions along the leg as far as the space seen free lets the vehicle, from rest.

    They end some way before an obstacle, so that there is room to look and to sidestep.  What is
    only not seen yet is better seen from near.
    """
    x_m, _ = at.place_leg_m
    goal_x_m, reach_m, ahead = at.goal_leg_m[0], _free_ahead_m(at), at.obstacle_ahead()
    near_m = x_m + reach_m + at.margin_m + _ROOM_M
    room_m = _ROOM_M if ahead is not None and ahead.x_min_m <= near_m else 0.0
    for overhang_m in overhangs_m(at.limits.run_on):
        if goal_x_m + overhang_m <= x_m + reach_m:
            target_m = goal_x_m
        else:
            target_m = min(goal_x_m, x_m + reach_m - max(overhang_m, room_m))
        arrives = target_m >= goal_x_m - _SAME_PLACE_M and target_m > x_m + _STEP_M
        if target_m - x_m >= GO_MIN_M or arrives:
            found = motion(at, ((0, target_m - x_m),), overhang_m)
            if found is not None:
                yield found


def sidesteps(at: Standstill) -> Iterator[Horizon]:
    """Yield motions to either side of the obstacle ahead, or aside to the leg's end, from rest.

    Those whose strips are not seen free are left out.  The side with room comes first, then the
    nearer one; before it moves sideways the vehicle may draw back a little.  Where nothing known is
    ahead, they lead to where the way ahead is seen free.
    """
    x_m, y_m = at.place_leg_m
    for target_m in _targets_m(at):
        aside_m = target_m - y_m
        if abs(aside_m) < _SAME_PLACE_M:
            continue
        for back_m in _BACK_M:
            if not is_tried(at, (x_m - back_m, target_m)):
                yield from _aside(at, back_m, aside_m)


def _aside(at: Standstill, back_m: float, aside_m: float) -> Iterator[Horizon]:
    """Yield the quickest motion back and aside whose strips are seen free; none if none are."""
    x_m, y_m = at.place_leg_m
    for overhang_m in overhangs_m(at.limits.run_on):
        moves, strips = [(1, aside_m)], [strip(x_m - back_m, y_m, (1, aside_m), overhang_m)]
        if back_m > 0.0:
            moves.insert(0, (0, -back_m))
            strips.append(strip(x_m, y_m, (0, -back_m), overhang_m))
        if all(has_room(at, strip) for strip in strips):
            found = motion(at, moves, overhang_m)
            if found is not None:
                yield found
                return


def _targets_m(at: Standstill) -> list[float]:
    """Return the lateral positions to go to, y in the leg frame, the best first.

    Beside a face of what stands abreast of the obstacle ahead, where no known obstacle is in the
    way along the leg.
    """
    (x_m, y_m), (goal_x_m, goal_y_m) = at.place_leg_m, at.goal_leg_m
    ahead = at.obstacle_ahead(cells=_GRAZING_CELLS)
    if ahead is None:
        return [goal_y_m] if abs(x_m - goal_x_m) < GO_MIN_M else _towards_seen_m(at)
    past_m = ahead.x_max_m + 2.0 * at.margin_m
    abreast = sorted(
        (
            box
            for box in at.boxes
            if box.x_max_m + at.margin_m > x_m - _BACK_M[-1] and box.x_min_m - at.margin_m < past_m
        ),
        key=lambda box: max(box.y_min_m - y_m, y_m - box.y_max_m),
    )[:_ABREAST_MAX]
    left_m = np.array([box.y_min_m for box in abreast]) - at.margin_m
    right_m = np.array([box.y_max_m for box in abreast]) + at.margin_m
    beyond_m = np.array(_BEYOND_FACE_M)[:, None]
    gaps_m = (left_m[:, None] + right_m[None, :]) / 2.0
    targets_m = np.concatenate(
        [(left_m - beyond_m).ravel(), (right_m + beyond_m).ravel(), gaps_m.ravel()]
    )
    room_m = np.maximum(left_m - targets_m[:, None], targets_m[:, None] - right_m).min(axis=1)
    ways_m = np.abs(targets_m - y_m) - _ROOM_WEIGHT * np.minimum(room_m, _BEYOND_FACE_M[0])
    order = np.argsort(ways_m, kind="stable")
    # A cell takes up to its edge from the room on either side.
    clear = order[room_m[order] > at.grid.cell_m]
    return [float(target_m) for target_m in targets_m[clear[:_TARGETS_MAX]]]


def _towards_seen_m(at: Standstill) -> list[float]:
    """Return lateral positions from which the way ahead is seen free, the nearest first."""
    x_m, y_m = at.place_leg_m
    inwards = math.copysign(1.0, at.goal_leg_m[1] - y_m)
    targets_m = [y_m + sign * aside_m for aside_m in _ASIDE_M for sign in (inwards, -inwards)]
    seen = [has_room(at, Rectangle(x_m, x_m + _AHEAD_M, y, y)) for y in (y_m, *targets_m)]
    return [] if seen[0] else list(compress(targets_m, seen[1:]))


def is_tried(at: Standstill, place_leg_m: tuple[float, float]) -> bool:
    """Tell whether a place has led no farther."""
    return any(math.dist(place_leg_m, tried) < _SAME_PLACE_M for tried in at.tried_leg_m)


def overhangs_m(run_on: RunOn) -> tuple[float, ...]:
    """Return how far a run-on may end beyond a target, the quickest motion first."""
    return OVERHANGS_M if run_on.gains else (0.0,)


def strip(x_m: float, y_m: float, move: tuple[int, float], overhang_m: float) -> Rectangle:
    """Return where the reference may be while it makes a move of (axis, distance), and runs on."""
    axis, distance_m = move
    farther_m = distance_m + math.copysign(overhang_m, distance_m)
    low_m, high_m = min(0.0, farther_m), max(0.0, farther_m)
    if axis == 0:
        return Rectangle(x_m + low_m, x_m + high_m, y_m, y_m)
    return Rectangle(x_m, x_m, y_m + low_m, y_m + high_m)


def has_room(at: Standstill, way: Rectangle) -> bool:
    """Tell whether the body may be anywhere in a rectangle."""
    return bool(_have_room(at, *(np.array([face_m]) for face_m in way))[0])


def _have_room(
    at: Standstill, x0_m: FloatArray, x1_m: FloatArray, y0_m: FloatArray, y1_m: FloatArray
) -> NDArray[np.bool_]:
    """Tell of rectangles (n,) whether the body's square has room in them, or else its disc."""
    grown_m = at.limits.body_radius_m + 2.0 * GRID_TOLERANCE_M
    free = at.grid.are_free(x0_m - grown_m, x1_m + grown_m, y0_m - grown_m, y1_m + grown_m)
    if not free[0]:
        x_m, y_m = grown_m * np.array(COVER).T[:, :, None]
        covers = at.grid.are_free(x0_m - x_m, x1_m + x_m, y0_m - y_m, y1_m + y_m)
        free = np.logical_and.reduce(covers)
    return free


def _free_ahead_m(at: Standstill) -> float:
    """Return how far ahead the body's strip along the leg is seen free."""
    x_m, y_m = at.place_leg_m
    ways_m = np.arange(0.0, _REACH_M, _STEP_M)
    ones = np.ones_like(ways_m)
    free = _have_room(at, x_m * ones, x_m + ways_m, y_m * ones, y_m * ones)
    return float(ways_m[np.count_nonzero(np.logical_and.accumulate(free)) - 1]) if free[0] else 0.0


def motion(at: Standstill, moves: Sequence[tuple[int, float]], overhang_m: float) -> Horizon | None:
    """Return moves of (axis, distance) one after another, each from rest to rest."""
    base = at.flown.next_node()
    parts = []
    for axis, distance_m in moves:
        jerks = rest_to_rest(abs(distance_m), axis, at.limits, overhang_m)
        if jerks is None:
            return None
        part = np.zeros((len(jerks), 2))
        part[:, axis] = math.copysign(1.0, distance_m) * jerks
        parts.append(part)
    count = sum(map(len, parts))
    parts.append(np.zeros((max(PIECES - count, 0), 2)))
    return Horizon.integrated(base.start_s, base.start, np.concatenate(parts))


def rest_to_rest(
    distance_m: float, axis: int, limits: RestLimits, overhang_m: float
) -> FloatArray | None:
    """Return the jerks of the quickest motion over a distance, of those that are tried.

    Args:
        distance_m: above zero.
        axis: 0 along the leg, 1 across it.
        limits: of the vehicle.
        overhang_m: how far a run-on may end beyond the target.

    Returns:
        One value [m/s³] for each piece of `PIECE_S`; None if every motion that is tried runs on
        too far.
    """
    found = []
    for pulls_mps2 in _pulls_mps2(distance_m, axis, limits, overhang_m):
        for share in _SPEED_SHARES:
            speed_mps = share * limits.speed_max_mps
            jerks = _trapezium(distance_m, speed_mps, pulls_mps2, limits.jerk_max_mps3)
            if jerks is not None:
                found.append(jerks)
    for jerks in sorted(found, key=len):
        if _run_on_ends_within(jerks, distance_m, overhang_m, limits.run_on):
            return jerks
    return None


def _pulls_mps2(
    distance_m: float, axis: int, limits: RestLimits, overhang_m: float
) -> list[tuple[float, float]]:
    """Return accelerations and decelerations to try.

    With a deceleration of up to ``2 o / kappa²`` the run ``kappa v`` ends within o of the target at
    every speed; the first instant asks for ``c a`` within the distance plus o.
    """
    brake, forward, left, right = limits.acceleration_max_mps2
    box_mps2 = (brake, forward) if axis == 0 else (left, right)
    pull_mps2 = min(limits.acceleration_disc_mps2, *box_mps2)
    kappa_s = limits.run_on.reach_m(1.0)
    if kappa_s == 0.0:
        return [(pull_mps2, pull_mps2)]
    c_s2 = max(c_s2 for _, c_s2 in limits.run_on.gains)
    rising_mps2 = min(pull_mps2, (distance_m + overhang_m) / c_s2 if c_s2 > 0.0 else math.inf)
    falling_mps2 = min(pull_mps2, 2.0 * overhang_m / kappa_s**2)
    return [
        (rise * rising_mps2, fall * falling_mps2) for rise in _PULL_SHARES for fall in _PULL_SHARES
    ]


def _trapezium(
    distance_m: float, speed_mps: float, pulls_mps2: tuple[float, float], jerk_mps3: float
) -> FloatArray | None:
    """Return a motion of whole pieces up to a speed at most; None if the way is too short for it.

    Both changes of speed and the hold between take whole pieces; then the speed is lowered so that
    the distance is met exactly, which lowers every acceleration and jerk with it.
    """
    speed_mps *= _LIMIT_SHARE
    rise, fall = (
        _change(speed_mps, _LIMIT_SHARE * pull_mps2, _LIMIT_SHARE * jerk_mps3)
        for pull_mps2 in pulls_mps2
    )
    changing_s = PIECE_S * (rise.pieces + fall.pieces) / 2.0
    hold_s = distance_m / speed_mps - changing_s
    if hold_s < 0.0:
        return None
    hold = math.ceil(hold_s / PIECE_S - _ROUND_OFF_M)
    peak_mps = distance_m / (changing_s + hold * PIECE_S)
    return np.concatenate((rise.jerks(peak_mps), np.zeros(hold), -fall.jerks(peak_mps)))


class _Change(NamedTuple):
    """A change of speed in whole pieces: a ramp of acceleration, a hold, and the ramp back."""

    ramp: int
    hold: int

    @property
    def pieces(self) -> int:
        return 2 * self.ramp + self.hold

    def jerks(self, speed_mps: float) -> FloatArray:
        """Return the jerks that reach a speed from rest, exactly."""
        jerk_mps3 = speed_mps / (self.ramp * (self.ramp + self.hold) * PIECE_S**2)
        ramp = np.full(self.ramp, jerk_mps3)
        return np.concatenate((ramp, np.zeros(self.hold), -ramp))


def _change(speed_mps: float, pull_mps2: float, jerk_mps3: float) -> _Change:
    """Return the shortest change to a speed within limits of acceleration and jerk."""
    found = []
    for ramp in range(1, _RAMPS_MAX + 1):
        needed = max(speed_mps / (pull_mps2 * PIECE_S), speed_mps / (jerk_mps3 * ramp * PIECE_S**2))
        found.append(_Change(ramp, max(0, math.ceil(needed - ramp - _ROUND_OFF_M))))
    return min(found, key=lambda change: change.pieces)


def _run_on_ends_within(
    jerks: FloatArray, distance_m: float, overhang_m: float, run_on: RunOn
) -> bool:
    """Tell whether every run-on point of a motion stays within the target plus the overhang."""
    if not run_on.gains:
        return True
    motion = Horizon.integrated(0.0, np.zeros((3, 2)), np.stack((jerks, 0.0 * jerks), axis=1))
    farthest_m = float(motion.swept_m(run_on)[:, :, 0].max())
    return farthest_m <= distance_m + overhang_m + _ROUND_OFF_M
