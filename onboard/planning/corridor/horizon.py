"""Motion over a fixed horizon: equal pieces of constant jerk on x and y, at rest at the end.

What a receding horizon plans in.  The linear maps from the jerks of one axis to its Bernstein
points, run-on points, velocities and accelerations are the same for both axes and for every plan.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from onboard.contract.run_on import RunOn
    from onboard.geometry.frames import FloatArray
    from onboard.motion.trajectory import State

PIECES: Final = 30
PIECE_S: Final = 0.2


@dataclass(frozen=True, eq=False)
class Horizon:
    """Nodes of `PIECES` pieces from a start, or of more where a motion takes longer.

    Attributes:
        start_s: time of the first node.
        nodes: (n + 1, 3, 2): position [m], velocity [m/s] and acceleration [m/s²] on x and y.
        jerk_mps3: (n, 2).
    """

    start_s: float
    nodes: FloatArray
    jerk_mps3: FloatArray

    @classmethod
    def integrated(cls, start_s: float, start: FloatArray, jerk_mps3: FloatArray) -> Horizon:
        """Integrate jerks (n, 2) from a start (3, 2)."""
        t = PIECE_S
        acceleration = start[2] + np.concatenate(([(0.0, 0.0)], np.cumsum(jerk_mps3 * t, axis=0)))
        steps = t * acceleration[:-1] + t * t / 2.0 * jerk_mps3
        velocity = start[1] + np.concatenate(([(0.0, 0.0)], np.cumsum(steps, axis=0)))
        steps = t * velocity[:-1] + t * t / 2.0 * acceleration[:-1] + t**3 / 6.0 * jerk_mps3
        position = start[0] + np.concatenate(([(0.0, 0.0)], np.cumsum(steps, axis=0)))
        return cls(start_s, np.stack((position, velocity, acceleration), axis=1), jerk_mps3)

    @classmethod
    def at_rest(cls, start_s: float, x_m: float, y_m: float) -> Horizon:
        """Return the plan to stay at a place."""
        start = np.array(((x_m, y_m), (0.0, 0.0), (0.0, 0.0)))
        return cls.integrated(start_s, start, np.zeros((PIECES, 2)))

    @property
    def start(self) -> FloatArray:
        """State (3, 2) at the first node."""
        first: FloatArray = self.nodes[0]
        return first

    def next_node(self) -> Horizon:
        """Return the same plan from its second node on; one of `PIECES` is filled up with rest."""
        if len(self.jerk_mps3) > PIECES:
            return Horizon(self.start_s + PIECE_S, self.nodes[1:], self.jerk_mps3[1:])
        nodes = np.concatenate((self.nodes[1:], self.nodes[-1:]))
        nodes[-1, 1:] = 0.0
        jerk_mps3 = np.concatenate((self.jerk_mps3[1:], ((0.0, 0.0),)))
        return Horizon(self.start_s + PIECE_S, nodes, jerk_mps3)

    def trajectory(self, z_m: float) -> Trajectory:
        """Return the plan as a trajectory at one height."""
        count = len(self.jerk_mps3)
        motion = np.zeros((4, count, 3))
        motion[:3, :, :2] = np.moveaxis(self.nodes[:-1], 1, 0)
        motion[0, :, 2] = z_m
        motion[3, :, :2] = self.jerk_mps3
        return Trajectory(self.start_s, np.full(count, PIECE_S), *motion)

    @cached_property
    def extent_m(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest Bernstein points of each piece: two arrays (n, 2)."""
        points = self._bernstein[0]
        return points.min(axis=1), points.max(axis=1)

    def swept_m(self, run_on: RunOn) -> FloatArray:
        """Bernstein points (n, 4 m, 2) of the path and its run-on points."""
        if run_on not in self._swept_m:  # a plan is asked several times, with the contract's run
            position, velocity, acceleration = self._bernstein
            runs = [position + k * velocity + c * acceleration for k, c in run_on.gains]
            self._swept_m[run_on] = np.concatenate((position, *runs), axis=1)
        return self._swept_m[run_on]

    @cached_property
    def _swept_m(self) -> dict[RunOn, FloatArray]:
        """What `swept_m` has returned."""
        return {}

    @cached_property
    def _bernstein(self) -> FloatArray:
        """Cubic Bernstein points (3, n, 4, 2) of position, velocity and acceleration."""
        return _bernstein(self.nodes)


def state_of(state: State) -> FloatArray:
    """Return position, velocity and acceleration on x and y as (3, 2)."""
    return np.array([vector[:2] for vector in state])


def _bernstein(nodes: FloatArray) -> FloatArray:
    """Cubic Bernstein points (3, n, 4, k) of position, velocity and acceleration."""
    p, v, a = nodes[:-1, 0], nodes[:-1, 1], nodes[:-1, 2]
    p1, v1, a1 = nodes[1:, 0], nodes[1:, 1], nodes[1:, 2]
    t = PIECE_S
    middle = v + a * t / 2.0
    points = np.empty((3, len(p), 4, p.shape[1]))
    points[0, :, 0], points[0, :, 1] = p, p + v * t / 3.0
    points[0, :, 2], points[0, :, 3] = p + 2.0 * v * t / 3.0 + a * t * t / 6.0, p1
    points[1, :, 0], points[1, :, 1] = v, (v + 2.0 * middle) / 3.0
    points[1, :, 2], points[1, :, 3] = (2.0 * middle + v1) / 3.0, v1
    points[2, :, 0], points[2, :, 1] = a, (2.0 * a + a1) / 3.0
    points[2, :, 2], points[2, :, 3] = (a + 2.0 * a1) / 3.0, a1
    return points


class JerkMaps:
    """Linear maps from the jerks of one axis, and from its start, to what the QP bounds.

    Attributes:
        rows: (m, n), from the jerks: 3 n points of the path, 3 n of each run-on point, 2 n - 1
            velocities (Bernstein points), n - 1 accelerations, and the two of the end.
        free: (m, 3), from the start.
        hessian: (n, n), of the cost: squared distance to targets at the nodes, with a little
            acceleration and jerk.
    """

    TARGET_WEIGHT: Final = 1.0
    ACCELERATION_WEIGHT: Final = 0.05
    JERK_WEIGHT: Final = 0.002

    def __init__(self, run_on: RunOn) -> None:
        nodes, free = _node_maps()
        position, velocity, acceleration = _bernstein_maps(nodes, free)
        blocks = [_points_after_start(position)]
        for k, c in run_on.gains:
            runs = (
                position[0] + k * velocity[0] + c * acceleration[0],
                position[1] + k * velocity[1] + c * acceleration[1],
            )
            blocks.append(_points_after_start(runs))
        self._speeds, self._speeds_free = _speeds_of(nodes), _speeds_of(free)
        blocks.append((self._speeds, self._speeds_free))
        blocks.append((nodes[1:-1, 2], free[1:-1, 2]))
        blocks.append((nodes[-1, 1:], free[-1, 1:]))
        self.rows = np.ascontiguousarray(np.concatenate([block[0] for block in blocks]))
        self.free = np.concatenate([block[1] for block in blocks])
        self._place, self._place_free = nodes[1:, 0], free[1:, 0]
        self._pull, self._pull_free = nodes[1:, 2], free[1:, 2]
        self.hessian = np.ascontiguousarray(
            2.0
            * (
                self.TARGET_WEIGHT * self._place.T @ self._place
                + self.ACCELERATION_WEIGHT * self._pull.T @ self._pull
                + self.JERK_WEIGHT * np.eye(PIECES)
            )
        )
        self._end, self._end_free = nodes[-1, 1:], free[-1, 1:]
        self._repair = np.linalg.pinv(self._end)

    def gradient(self, start: FloatArray, targets_m: FloatArray) -> FloatArray:
        """Return the linear part of the cost for one axis: start (3,), targets (n,)."""
        place = self._place.T @ (self._place_free @ start - targets_m)
        pull = self._pull.T @ (self._pull_free @ start)
        gradient: FloatArray = 2.0 * (self.TARGET_WEIGHT * place + self.ACCELERATION_WEIGHT * pull)
        return gradient

    def speeds_mps(self, start: FloatArray, jerk_mps3: FloatArray) -> FloatArray:
        """Return the Bernstein points of one axis's velocity that the rows bound, (2 n - 1,)."""
        speeds: FloatArray = self._speeds @ jerk_mps3 + self._speeds_free @ start
        return speeds

    def ending_at_rest(self, start: FloatArray, jerk_mps3: FloatArray) -> FloatArray:
        """Return the jerks repaired so that velocity and acceleration end at zero, exactly."""
        left = self._end @ jerk_mps3 + self._end_free @ start
        repaired: FloatArray = jerk_mps3 - self._repair @ left
        return repaired


def _node_maps() -> tuple[FloatArray, FloatArray]:
    """Return maps (n + 1, 3, n) from jerks and (n + 1, 3, 3) from the start to each node."""
    t = PIECE_S
    step = np.array(((1.0, t, t * t / 2.0), (0.0, 1.0, t), (0.0, 0.0, 1.0)))
    push = np.array((t**3 / 6.0, t * t / 2.0, t))
    nodes = np.zeros((PIECES + 1, 3, PIECES))
    free = np.zeros((PIECES + 1, 3, 3))
    free[0] = np.eye(3)
    for k in range(PIECES):
        nodes[k + 1] = step @ nodes[k]
        nodes[k + 1][:, k] += push
        free[k + 1] = step @ free[k]
    return nodes, free


def _speeds_of(maps: FloatArray) -> FloatArray:
    """Return the rows (2 n - 1, k) of each piece's middle velocity point and the inner nodes."""
    return np.concatenate((maps[:-1, 1] + PIECE_S / 2.0 * maps[:-1, 2], maps[1:-1, 1]))


_Maps = tuple["FloatArray", "FloatArray"]


def _bernstein_maps(nodes: FloatArray, free: FloatArray) -> tuple[_Maps, _Maps, _Maps]:
    """Return the maps (n, 4, k) to the Bernstein points of position, velocity, acceleration."""
    (p, v, a), (p0, v0, a0) = _bernstein(nodes), _bernstein(free)
    return (p, p0), (v, v0), (a, a0)


def _points_after_start(maps: _Maps) -> _Maps:
    """Return the last three of each piece's four points, as rows; the first is the last before."""
    from_jerks, from_start = (m[:, 1:].reshape(3 * PIECES, -1) for m in maps)
    return from_jerks, from_start
