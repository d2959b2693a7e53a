"""Certifies a way to rest: a trajectory that ends at rest inside the space that was seen free.

Shares nothing with the planner but the trajectory.  Exact in continuous time: a cubic piece lies in
the bounding box of its Bernstein points, and so does its run-on (`onboard.contract.run_on`); where
that box is not free, the run-on is covered by several boxes, and the piece is split by de
Casteljau's algorithm, a few times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.motion.trajectory import X, Y, Z
from onboard.planning.certifier import (
    ACCELERATION_TOLERANCE_MPS2,
    JERK_TOLERANCE_MPS3,
    POSITION_TOLERANCE_M,
    TIME_TOLERANCE_S,
    VELOCITY_TOLERANCE_MPS,
    Certificate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from onboard.contract.run_on import RunOn
    from onboard.geometry.frames import FloatArray
    from onboard.geometry.free_grid import FreeGrid
    from onboard.motion.trajectory import State, Trajectory

    _Strips = tuple[tuple[tuple[float, float], ...], ...]

# The body is taken to be larger by twice this, so that no round-off of the grid matters.
GRID_TOLERANCE_M: Final = 1e-3
_SPLITS_MAX: Final = 4
# Half sides of rectangles that together cover a disc of radius 1: they end at equal angles.
_ANGLES_RAD: Final = np.linspace(0.0, math.pi / 2.0, 9)
_COVERS: Final = np.stack((np.cos(_ANGLES_RAD)[:-1], np.sin(_ANGLES_RAD)[1:]))[:, :, None]


@dataclass(frozen=True)
class RestLimits:
    """What a way to rest may ask of the vehicle.

    Attributes:
        body_radius_m: rho_b, radius of the vehicle plus its tracking error.
        speed_max_mps: greatest Euclidean speed.
        acceleration_max_mps2: (brake, forward, left, right) in the leg frame, as W.
        acceleration_disc_mps2: greatest Euclidean acceleration; infinite where W is enough, since
            the nose points along the leg.
        jerk_max_mps3: greatest jerk on each axis; infinite where acceleration may jump.
        run_on: how the vehicle runs on after a loss of the stream; without points: not asked.
        jerk_y_max_mps3: greatest jerk on y, where it is another than on x.
    """

    body_radius_m: float
    speed_max_mps: float
    acceleration_max_mps2: tuple[float, float, float, float]
    acceleration_disc_mps2: float
    jerk_max_mps3: float
    run_on: RunOn
    jerk_y_max_mps3: float | None = None

    @property
    def jerk_xy_max_mps3(self) -> tuple[float, float]:
        """Greatest jerk on x and on y."""
        across_mps3 = self.jerk_y_max_mps3
        return self.jerk_max_mps3, self.jerk_max_mps3 if across_mps3 is None else across_mps3


def certify_rest(
    trajectory: Trajectory, start: State, start_s: float, limits: RestLimits, grid: FreeGrid
) -> Certificate:
    """Check that a trajectory continues ``start``, can be flown, and rests in seen-free space.

    Args:
        trajectory: at one height.
        start: state of the reference at ``start_s``.
        start_s: when the trajectory takes over.
        limits: what it may ask of the vehicle.
        grid: the seen-free set as it is now.
    """
    failures = [
        *_start_failures(trajectory, start, start_s, limits),
        *_motion_failures(trajectory, limits),
        *_rest_failures(trajectory),
    ]
    if not failures:
        failures = _space_failures(trajectory, limits, grid)
    return Certificate(tuple(failures))


def has_room(trajectory: Trajectory, limits: RestLimits, grid: FreeGrid) -> bool:
    """Tell whether a trajectory that is certified has room for a body of another radius."""
    knots = np.concatenate((trajectory.position_leg_m, trajectory.ends[0][-1:]))[:, :2]
    # Mostly there is not, and one of the places between two pieces tells so at once.
    grown_m = limits.body_radius_m + 2.0 * GRID_TOLERANCE_M
    if not _discs_are_free(knots.T, knots.T, grown_m, grid).all():
        return False
    return not _space_failures(trajectory, limits, grid)


def _start_failures(
    trajectory: Trajectory, start: State, start_s: float, limits: RestLimits
) -> list[str]:
    first = [array[0] for array in trajectory.motion[:3]]
    failures = []
    if not abs(trajectory.start_s - start_s) <= TIME_TOLERANCE_S:
        failures.append(f"start: {trajectory.start_s - start_s:+.3g} s late")
    for name, have, want, tolerance, unit in zip(
        ("position", "velocity", "acceleration"),
        first,
        start,
        (POSITION_TOLERANCE_M, VELOCITY_TOLERANCE_MPS, ACCELERATION_TOLERANCE_MPS2),
        ("m", "m/s", "m/s²"),
        strict=True,
    ):
        gaps = [abs(one - other) for one, other in zip(have.tolist(), want, strict=True)]
        may_jump = name == "acceleration" and math.isinf(limits.jerk_max_mps3)
        if not (all(gap <= tolerance for gap in gaps) or may_jump):
            failures.append(f"start: {name} jumps by {max(gaps):.3g} {unit}")
    return failures


def _motion_failures(trajectory: Trajectory, limits: RestLimits) -> list[str]:
    """Pieces join; speed, acceleration and jerk keep their limits at every time."""
    failures = []
    for name, ends, starts, tolerance in zip(
        ("position", "velocity", "acceleration"),
        trajectory.ends,
        trajectory.motion,
        (POSITION_TOLERANCE_M, VELOCITY_TOLERANCE_MPS, ACCELERATION_TOLERANCE_MPS2),
        strict=False,
    ):
        gap = float(np.abs(ends[:-1] - starts[1:]).max(initial=0.0))
        may_jump = name == "acceleration" and math.isinf(limits.jerk_max_mps3)
        if not (gap <= tolerance or may_jump):
            failures.append(f"{name} jumps by {gap:.3g} between two pieces")
    brake, forward, left, right = limits.acceleration_max_mps2
    acceleration = np.concatenate((trajectory.acceleration_leg_mps2, trajectory.ends[2]))
    low, high = acceleration.min(axis=0).tolist(), acceleration.max(axis=0).tolist()
    tilted = 0.0  # by W, where no disc bounds it
    if limits.acceleration_disc_mps2 < math.inf:
        tilted = float(np.hypot(acceleration[:, X], acceleration[:, Y]).max())
    jerk = np.abs(trajectory.jerk_leg_mps3[:, :2]).max(axis=0) - limits.jerk_xy_max_mps3
    speed = np.hypot(*velocity_points_mps(trajectory)[:, :, :2].reshape(-1, 2).T).max()
    height = np.abs(trajectory.control_points_m[:, :, Z] - trajectory.position_leg_m[0, Z]).max()
    for clause, excess, tolerance, unit in (
        ("braking limit exceeded", -low[X] - brake, ACCELERATION_TOLERANCE_MPS2, "m/s²"),
        ("forward limit exceeded", high[X] - forward, ACCELERATION_TOLERANCE_MPS2, "m/s²"),
        ("leftward limit exceeded", -low[Y] - left, ACCELERATION_TOLERANCE_MPS2, "m/s²"),
        ("rightward limit exceeded", high[Y] - right, ACCELERATION_TOLERANCE_MPS2, "m/s²"),
        (
            "tilt limit exceeded",
            tilted - limits.acceleration_disc_mps2,
            ACCELERATION_TOLERANCE_MPS2,
            "m/s²",
        ),
        ("jerk limit exceeded", jerk.max(), JERK_TOLERANCE_MPS3, "m/s³"),
        ("speed limit exceeded", speed - limits.speed_max_mps, VELOCITY_TOLERANCE_MPS, "m/s"),
        ("height changes", height, POSITION_TOLERANCE_M, "m"),
    ):
        worst = float(excess)
        if not worst <= tolerance:
            failures.append(f"{clause} by {worst:.3g} {unit}")
    return failures


def _rest_failures(trajectory: Trajectory) -> list[str]:
    _, velocity, acceleration = trajectory.final
    speed, pull = max(map(abs, velocity)), max(map(abs, acceleration))
    if speed <= VELOCITY_TOLERANCE_MPS and pull <= ACCELERATION_TOLERANCE_MPS2:
        return []
    return [f"ends at {speed:.3g} m/s and {pull:.3g} m/s², not at rest"]


def velocity_points_mps(trajectory: Trajectory) -> FloatArray:
    """Bernstein points of velocity (n, 3, 3): quadratics, degree 2."""
    _, v, a, _ = trajectory.motion
    t = trajectory.durations_s[:, None]
    points_mps = np.empty((len(v), 3, 3))
    points_mps[:, 0], points_mps[:, 1], points_mps[:, 2] = v, v + a * t / 2.0, trajectory.ends[1]
    return points_mps


def motion_points(trajectory: Trajectory) -> FloatArray:
    """Bernstein points (3, n, 4, 2) of position, velocity and acceleration, all of degree 3."""
    first, middle, last = np.moveaxis(velocity_points_mps(trajectory)[:, :, :2], 1, 0)
    begin, end = trajectory.acceleration_leg_mps2[:, :2], trajectory.ends[2][:, :2]
    points = np.empty((3, len(begin), 4, 2))
    points[0] = trajectory.control_points_m[:, :, :2]
    points[1, :, 0], points[1, :, 1] = first, (first + 2.0 * middle) / 3.0
    points[1, :, 2], points[1, :, 3] = (2.0 * middle + last) / 3.0, last
    points[2, :, 0], points[2, :, 1] = begin, (2.0 * begin + end) / 3.0
    points[2, :, 2], points[2, :, 3] = (begin + 2.0 * end) / 3.0, end
    return points


def _space_failures(trajectory: Trajectory, limits: RestLimits, grid: FreeGrid) -> list[str]:
    off_m = max(map(abs, trajectory.position_range_m(Z)))
    if off_m > grid.level_m + POSITION_TOLERANCE_M:
        return [f"flown {off_m:.3g} m off the height that was seen free"]
    points = motion_points(trajectory)
    grown_m = limits.body_radius_m + 2.0 * GRID_TOLERANCE_M
    pieces = np.arange(points.shape[1])
    run_on = limits.run_on
    whole = ((0.0, 0.0), *run_on.gains)
    for _ in range(_SPLITS_MAX + 1):
        occupied = ~_are_free(points, (whole,), grown_m, grid)
        if run_on.gains and occupied.any():
            # Strip by strip less is needed of what lies beside a run that leads aside.
            occupied[occupied] = ~_are_free(points[:, occupied], run_on.strips, grown_m, grid)
        if not occupied.any():
            return []
        points, pieces = halves(points[:, occupied]), np.repeat(pieces[occupied], 2)
    time_s = trajectory.knots_s[int(pieces.min())]
    return [f"leaves the seen-free space in the piece from {time_s:.3f} s"]


def _are_free(
    points: FloatArray, strips: _Strips, grown_m: float, grid: FreeGrid
) -> NDArray[np.bool_]:
    """Tell for each piece whether the boxes of its points, grown by a disc, are seen free.

    Args:
        points: (3, n, 4, 2).
        strips: gains of the points that each of its boxes holds.
        grown_m: radius of the disc.
        grid: the seen-free set.
    """
    # The points of a piece come first, along with the gains, so that one axis is reduced.
    position, velocity, acceleration = points.transpose(0, 2, 3, 1)[:, None]
    kappa, c, firsts = _as_columns(strips)
    swept = position + kappa * velocity + c * acceleration
    low, high = swept.min(axis=1), swept.max(axis=1)
    # By axis, box and piece.
    low = np.minimum.reduceat(low, firsts, axis=0).transpose(1, 0, 2)
    high = np.maximum.reduceat(high, firsts, axis=0).transpose(1, 0, 2)
    free = grid.are_free_between(low - grown_m, high + grown_m)
    # The corners of that square belong to no disc: without them it may be free all the same.
    if not free.all():
        left = ~free
        free[left] = _discs_are_free(low[:, left], high[:, left], grown_m, grid)
    every: NDArray[np.bool_] = np.logical_and.reduce(free, axis=0)
    return every


@lru_cache(maxsize=256)
def _as_columns(strips: _Strips) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Return all gains, (n, 1, 1, 1) each, and with which of them each strip begins.

    A contract has the same ones, as long as its speed lasts.
    """
    gains = np.array([pair for strip in strips for pair in strip])
    kappa, c = gains.T[:, :, None, None, None]
    return kappa, c, np.cumsum([0, *map(len, strips[:-1])])


def _discs_are_free(
    low: FloatArray, high: FloatArray, grown_m: float, grid: FreeGrid
) -> NDArray[np.bool_]:
    """Tell for boxes, (2, n) corners, whether each is seen free when a disc grows it.

    A point of the disc at an angle between two others is no farther along x than the first of them
    and no farther along y than the second: so many rectangles cover the disc.
    """
    covers_m = grown_m * _COVERS
    covered = grid.are_free_between(low[:, None] - covers_m, high[:, None] + covers_m)
    free: NDArray[np.bool_] = np.logical_and.reduce(covered, axis=0)
    if grid.free_disc is not None:
        *middle, radius_m = grid.free_disc
        middles = np.array(middle)[:, None]
        farthest = np.maximum(np.abs(low - middles), np.abs(high - middles))
        free |= np.hypot(*farthest) + grown_m <= radius_m
    return free


def halves(points: FloatArray) -> FloatArray:
    """Split every piece in the middle (de Casteljau): (m, n, 4, 2) -> (m, 2 n, 4, 2)."""
    a, b, c, d = np.moveaxis(points, 2, 0)
    ab, bc, cd = (a + b) / 2.0, (b + c) / 2.0, (c + d) / 2.0
    abc, bcd = (ab + bc) / 2.0, (bc + cd) / 2.0
    middle = (abc + bcd) / 2.0
    one, other = np.stack((a, ab, abc, middle), axis=2), np.stack((middle, bcd, cd, d), axis=2)
    count, pieces = points.shape[:2]
    return np.stack((one, other), axis=2).reshape(count, 2 * pieces, 4, 2)
