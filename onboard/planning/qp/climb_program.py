"""Eq. 17 on all three axes at once: rising buys agility (theory, erratum 8; Fig. 15b).

Roll and pitch bound the ratio of horizontal acceleration to lift, so W grows with upward
acceleration: x <= (forward / g) (g - z), linear, and alike on the other sides.  These rows couple
the axes into one QP.  Thrust needs no row: at a corner of W it is proportional to g - z, and the
envelope's upward limit is chosen for it.

The vehicle rises and comes back within the plan; every control point of z lies in the height
band, and with them all of the path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from onboard.contract.agility import GRAVITY_MPS2
from onboard.motion.axis_profile import AxisLimits
from onboard.motion.trajectory import Z
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import MARGIN_M, USED_SHARE, AxisTask

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray
    from onboard.planning.problem import AvoidanceProblem
    from onboard.planning.qp.solver import QpSolver

# What an upward acceleration counts in the QP, where climbing is preferred: enough to settle it.
_PREFERRED_WEIGHT = 0.02

# How near to the cruise height a plan ends; the cruise after it settles the rest.
_RETURN_M = 0.02

# Of the vertical jerk limit: height is dimensionless in the unit of x, in which the solver's
# tolerance is a larger part of it.
_VERTICAL_JERK_SHARE = 0.97

_ACCELERATIONS = slice(0, bspline.ROW_COUNTS[0])
_OTHERS = slice(bspline.ROW_COUNTS[0], bspline.ROWS)
_Z_JERKS = slice(bspline.ROW_COUNTS[0], sum(bspline.ROW_COUNTS[:2]))


@dataclass(frozen=True)
class Coupling:
    """What the matrices of the coupled QP depend on besides the spline.

    Attributes:
        along, across: limits on x and y in level flight.
        vertical_weight: what squared z acceleration counts.
    """

    along: AxisLimits
    across: AxisLimits
    vertical_weight: float


class ClimbProgram:
    """The coupled QP of one spline and one set of limits.

    Variables are the free variables of x, y and z, one after the other, each dimensionless in its
    own unit of acceleration; that of z is the one of x.

    Rows: all but the accelerations of x and of y; accelerations and jerks of z; control points of
    z; then, at every inner node, x forwards and backwards, y towards and away.
    """

    def __init__(
        self, matrices: bspline.TwoPhaseSpline, coupling: Coupling, solver: type[QpSolver]
    ) -> None:
        self._matrices = matrices
        along, across = coupling.along, coupling.across
        unit_x_mps2, unit_y_mps2 = along.largest_mps2, across.largest_mps2
        self._weights = (1.0, (unit_y_mps2 / unit_x_mps2) ** 2, coupling.vertical_weight)
        accelerations, others = matrices.rows[_ACCELERATIONS], matrices.rows[_OTHERS]
        # Sides of W: axis, sign, limit [m/s²].
        self._sides = (
            (0, 1.0, along.acceleration_max_mps2),
            (0, -1.0, -along.acceleration_min_mps2),
            (1, 1.0, across.acceleration_max_mps2),
            (1, -1.0, -across.acceleration_min_mps2),
        )
        self._units_mps2 = (unit_x_mps2, unit_y_mps2, unit_x_mps2)
        blocks = [
            _row_block(0, others),
            _row_block(1, others),
            _row_block(2, matrices.rows[: _Z_JERKS.stop]),
            _row_block(2, np.eye(bspline.FREE)),
        ]
        for axis, sign, limit_mps2 in self._sides:
            share = limit_mps2 / self._units_mps2[axis]
            block = _row_block(axis, sign * accelerations)
            block += _row_block(2, share * self._lift * accelerations)
            blocks.append(block)
        hessian = np.kron(np.diag(self._weights), matrices.hessian).astype(np.float64)
        self._solver = solver(hessian, np.vstack(blocks))

    @property
    def _lift(self) -> float:
        """The unit of z acceleration as a share of gravity."""
        return self._units_mps2[2] / GRAVITY_MPS2

    def solve(
        self, problem: AvoidanceProblem, along: AxisTask, across: AxisTask, piece_s: float
    ) -> FloatArray | None:
        """Return accelerations (nodes, 3) [m/s²], y as the task has it; None if none was found.

        Args:
            problem: gives the height band and the state in height.
            along: the task on x.
            across: the task on y, mirrored for the left side.
            piece_s: mean length of the pieces of the first phase.
        """
        matrices, piece = self._matrices, np.array(piece_s)
        vertical = vertical_task(problem, self._units_mps2[2])
        tasks = (along, across, vertical)
        parameters = [task.parameters(piece) for task in tasks]
        ends = [values[:3] for values in parameters]
        gradient = np.concatenate([matrices.gradient_from_parameters @ end for end in ends])
        gradient[bspline.END_POSITION] -= parameters[0][3]
        gradient *= np.repeat(self._weights, bspline.FREE)
        fixed = [matrices.rows_from_parameters @ end for end in ends]
        lower, upper = (
            np.concatenate(parts)
            for parts in zip(*self._bounds(problem, tasks, fixed, piece), strict=True)
        )
        optimum = self._solver.solve(gradient, lower, upper)
        if optimum is None:
            return None
        free = optimum.variables.reshape(3, bspline.FREE)
        nodes: FloatArray = np.stack(
            [
                unit_mps2 * matrices.accelerations(variables, end)
                for unit_mps2, variables, end in zip(self._units_mps2, free, ends, strict=True)
            ],
            axis=1,
        )
        return nodes

    def _bounds(
        self,
        problem: AvoidanceProblem,
        tasks: tuple[AxisTask, AxisTask, AxisTask],
        fixed: list[FloatArray],
        piece_s: FloatArray,
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Lower and upper bounds, block by block."""
        bounds: list[tuple[FloatArray, FloatArray]] = []
        for task, offset in zip(tasks[:2], fixed[:2], strict=True):
            lower, upper = task.bounds(piece_s)
            bounds.append(((lower - offset)[_OTHERS], (upper - offset)[_OTHERS]))
        lower, upper = tasks[2].bounds(piece_s)
        vertical = slice(0, _Z_JERKS.stop)
        bounds.append(((lower - fixed[2])[vertical], (upper - fixed[2])[vertical]))
        bounds.append(self._height_bounds(problem, tasks[2], float(piece_s)))
        inner_z = fixed[2][_ACCELERATIONS]
        for axis, sign, limit_mps2 in self._sides:
            share = limit_mps2 / self._units_mps2[axis]
            offset = sign * fixed[axis][_ACCELERATIONS] + share * self._lift * inner_z
            below = share * USED_SHARE - offset
            bounds.append((np.full_like(below, -math.inf), below))
        return bounds

    def _height_bounds(
        self, problem: AvoidanceProblem, task: AxisTask, piece_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Control points of z within the band, the last ones back at the cruise height."""
        unit_m = task.unit_mps2 * piece_s * piece_s
        cruise_m = problem.cruise_z_m - task.start.position_m
        lower = np.full(bspline.FREE, (cruise_m - problem.climb_m + MARGIN_M) / unit_m)
        upper = np.full(bspline.FREE, (cruise_m - MARGIN_M) / unit_m)
        lower[bspline.END_POSITION] = (cruise_m - _RETURN_M + MARGIN_M) / unit_m
        return lower, upper


def coupling_of(problem: AvoidanceProblem, along: AxisTask, across: AxisTask) -> Coupling:
    """Return what the matrices depend on for a problem and its tasks."""
    weight = _PREFERRED_WEIGHT if problem.climb_preferred else 1.0
    return Coupling(along.limits, across.limits, weight)


def vertical_task(problem: AvoidanceProblem, unit_mps2: float) -> AxisTask:
    """Return the z axis, which only has to end at rest."""
    anything, vertical = (-math.inf, math.inf), problem.envelope.vertical
    return AxisTask(
        start=problem.start.axis(Z),
        limits=vertical._replace(jerk_max_mps3=_VERTICAL_JERK_SHARE * vertical.jerk_max_mps3),
        end_speed_mps=0.0,
        crossing_m=anything,
        end_max_m=math.inf,
        speed_before_mps=anything,
        speed_after_mps=anything,
        progress_gain_mps3=0.0,
        unit_mps2=unit_mps2,
    )


def _row_block(axis: int, rows: FloatArray) -> FloatArray:
    """Place rows over the free variables of one of three axes."""
    block = np.zeros((rows.shape[0], 3 * bspline.FREE))
    block[:, axis * bspline.FREE : (axis + 1) * bspline.FREE] = rows
    return block
