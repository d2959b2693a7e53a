"""Eq. 17 on one axis, for a given side and horizon: the QP is built here and solved elsewhere.

With the side, the crossing time and the ratio of the two phases chosen, clearing the obstacle is
one linear bound per axis (short of the front face at the crossing, beyond the side face from it
on), and the axes are independent QPs with the same matrices (spline.py).  Positions are relative
to the start, and the lateral axis is mirrored so that the way out is towards +y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from onboard import spline
from onboard.avoidance import DELAY_COST_M2PS4
from onboard.profile import AxisState
from onboard.trajectory import X

if TYPE_CHECKING:
    from onboard.avoidance import AvoidanceProblem, Side
    from onboard.frames import FloatArray
    from onboard.profile import AxisLimits

# Kept from every face and border, and left of every limit: more than the solver's tolerance eats.
MARGIN_M = 2e-3
MARGIN_MPS = 5e-3
USED_SHARE = 0.995

# What OSQP is told instead of infinity.
_INACTIVE = 1e8

_ANYWHERE = (-math.inf, math.inf)


@dataclass(frozen=True)
class AxisTask:
    """Everything that distinguishes one axis of one problem, in SI units.

    Attributes:
        start: state at the start; its position is only an origin.
        limits: acceleration and jerk.
        end_speed_mps: velocity to end with.
        crossing_m: least and greatest position at the crossing, relative to the start.
        end_max_m: greatest position at the end, likewise.
        speed_before_mps: least and greatest velocity before the crossing.
        speed_after_mps: the same after it.
        reward_mps3: what the cost falls by for every metre that the end lies farther on.
    """

    start: AxisState
    limits: AxisLimits
    end_speed_mps: float
    crossing_m: tuple[float, float]
    end_max_m: float
    speed_before_mps: tuple[float, float]
    speed_after_mps: tuple[float, float]
    reward_mps3: float

    @property
    def unit_mps2(self) -> float:
        """The unit of acceleration of the dimensionless problem: the larger limit."""
        return max(self.limits.acceleration_max_mps2, -self.limits.acceleration_min_mps2)

    def parameters(self, piece_s: FloatArray) -> FloatArray:
        """Dimensionless start and end, and reward for the end position: (..., 4).

        Args:
            piece_s: lengths of the pieces of the first phase, (...).
        """
        unit_mps = self.unit_mps2 * piece_s
        return np.stack(
            (
                self.start.velocity_mps / unit_mps,
                np.full_like(piece_s, self.start.acceleration_mps2 / self.unit_mps2),
                self.end_speed_mps / unit_mps,
                self.reward_mps3 * piece_s / (2.0 * self.unit_mps2),
            ),
            axis=-1,
        )

    def bounds(self, piece_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Dimensionless lower and upper bounds of the rows: (..., ROWS) each.

        Args:
            piece_s: lengths of the pieces of the first phase, (...).
        """
        lower = np.empty((*piece_s.shape, spline.ROWS))
        upper = np.empty_like(lower)
        lower[..., spline.ACCELERATION_ROWS] = (
            self.limits.acceleration_min_mps2 * USED_SHARE / self.unit_mps2
        )
        upper[..., spline.ACCELERATION_ROWS] = (
            self.limits.acceleration_max_mps2 * USED_SHARE / self.unit_mps2
        )
        jerk_unit_mps3 = self.unit_mps2 / piece_s[..., None]
        upper[..., spline.JERK_ROWS] = self.limits.jerk_max_mps3 * USED_SHARE / jerk_unit_mps3
        lower[..., spline.JERK_ROWS] = -upper[..., spline.JERK_ROWS]
        speed_unit_mps = self.unit_mps2 * piece_s[..., None]
        for rows, (low_mps, high_mps) in (
            (spline.VELOCITY_ROWS, self.speed_before_mps),
            (spline.VELOCITY_ROWS_AFTER, self.speed_after_mps),
        ):
            lower[..., rows] = (low_mps + MARGIN_MPS) / speed_unit_mps
            upper[..., rows] = (high_mps - MARGIN_MPS) / speed_unit_mps
        unit_m = self.unit_mps2 * piece_s * piece_s
        lower[..., spline.CROSSING_ROW] = (self.crossing_m[0] + MARGIN_M) / unit_m
        upper[..., spline.CROSSING_ROW] = (self.crossing_m[1] - MARGIN_M) / unit_m
        lower[..., spline.END_ROW] = -math.inf
        upper[..., spline.END_ROW] = (self.end_max_m - MARGIN_M) / unit_m
        return lower, upper

    def cost_unit(self, piece_s: FloatArray) -> FloatArray:
        """Cost [m²/s³] of a dimensionless cost of one."""
        return self.unit_mps2 * self.unit_mps2 * piece_s


@dataclass(frozen=True, eq=False)
class AxisProgram:
    """One QP: minimise ``z^T P z / 2 + gradient^T z`` with scaled rows between bounds.

    Attributes:
        ends: parameters of the spline, start and end (3,).
        gradient: (FREE,).
        lower, upper: bounds of the scaled rows, (ROWS,), never infinite.
        cost_unit: cost [m²/s³] of an objective of one.
        cost_of_ends: what start and end cost with z = 0 [m²/s³].
    """

    ends: FloatArray
    gradient: FloatArray
    lower: FloatArray
    upper: FloatArray
    cost_unit: float
    cost_of_ends: float

    def cost(self, objective: float) -> float:
        """Cost [m²/s³] of a solution, from the objective that the solver reports."""
        return self.cost_unit * objective + self.cost_of_ends


def build(matrices: spline.TwoPhaseSpline, task: AxisTask, piece_s: FloatArray) -> AxisProgram:
    """Build the QP of one axis for one horizon; P and the rows are those of ``matrices``.

    Args:
        matrices: the spline, which is dimensionless.
        task: the axis.
        piece_s: length of the pieces of the first phase, ().
    """
    parameters = task.parameters(piece_s)
    ends, reward = parameters[:3], parameters[3]
    gradient = matrices.gradient_from_parameters @ ends
    gradient[spline.END_POSITION] -= reward
    lower, upper = task.bounds(piece_s)
    fixed = matrices.rows_from_parameters @ ends
    cost_unit = float(task.cost_unit(piece_s))
    return AxisProgram(
        ends,
        gradient,
        np.maximum((lower - fixed) * matrices.row_scale, -_INACTIVE),
        np.minimum((upper - fixed) * matrices.row_scale, _INACTIVE),
        # The objective is half of what it stands for.
        2.0 * cost_unit,
        cost_unit * float(ends @ matrices.energy_of_parameters @ ends),
    )


def along_task(problem: AvoidanceProblem, *, clear: bool) -> AxisTask:
    """The x axis: short of the front face until clear, and back to the exit speed in the end."""
    start, region = problem.start.axis(X), problem.region
    front_m = region.keep_out.x_min_m - start.position_m
    forward = (0.0, problem.envelope.speed_max_mps)
    return AxisTask(
        start=start,
        limits=problem.envelope.along,
        end_speed_mps=problem.exit_speed_mps,
        crossing_m=_ANYWHERE if clear else (-math.inf, front_m),
        end_max_m=region.x_pob_m - start.position_m,
        speed_before_mps=forward,
        speed_after_mps=forward,
        # What lies beyond the end is flown at exit speed.
        reward_mps3=DELAY_COST_M2PS4 / problem.exit_speed_mps,
    )


def across_task(problem: AvoidanceProblem, side: Side, *, clear: bool) -> AxisTask:
    """The y axis, mirrored for the left side: beyond the side face from the crossing on."""
    sidestep = problem.sidestep(side)
    start = sidestep.start
    outward = (0.0, sidestep.speed_max_mps)
    either_way = (-sidestep.speed_max_mps, sidestep.speed_max_mps)
    return AxisTask(
        start=start,
        limits=sidestep.limits,
        end_speed_mps=0.0,
        crossing_m=_ANYWHERE if clear else (sidestep.face_m - start.position_m, math.inf),
        end_max_m=sidestep.lane_m - start.position_m,
        speed_before_mps=outward if clear else either_way,
        speed_after_mps=outward,
        reward_mps3=0.0,
    )
