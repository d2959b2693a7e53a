"""Eq. 17 on one axis, for a given side and horizon: the QP is built here and solved elsewhere.

With the side, the crossing time and the ratio of the two phases chosen, clearing the obstacle is
one linear bound per axis (short of the front face at the crossing, beyond the side face from it
on), and the axes are independent QPs with the same matrices (bspline.py).  Positions are relative
to the start, and the lateral axis is mirrored so that the way out is towards +y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from onboard.motion.axis_profile import Profile, speed_change
from onboard.motion.trajectory import X
from onboard.planning.problem import DELAY_COST_M2PS4
from onboard.planning.qp import bspline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.frames import FloatArray, IntArray
    from onboard.motion.axis_profile import AxisLimits, AxisState
    from onboard.planning.problem import AvoidanceProblem, Side

# Kept from every face and border, and left of every limit: more than the solver's tolerance.
MARGIN_M = 2e-3
MARGIN_MPS = 5e-3
USED_SHARE = 0.995

# Exponents of the piece length, shifted by two to be indices: velocity counts in units of A h,
# length in A h², jerk in A / h (bspline.py), and the progress_gain in A / h.
_PARAMETER_POWERS = np.array([-1, 0, -1, 1]) + 2
_ROW_KINDS = np.repeat(np.arange(len(bspline.ROW_COUNTS)), bspline.ROW_COUNTS)
_ROW_POWERS = (np.array([0, 1, -1, -1, -2, -2]) + 2)[_ROW_KINDS]

_ANYWHERE = (-math.inf, math.inf)


def _powers(piece_s: FloatArray) -> FloatArray:
    """Powers -2 to 1 of the piece lengths, (..., 4); filled in place, faster than np.stack."""
    powers = np.empty((*piece_s.shape, 4))
    inverse = powers[..., 1] = 1.0 / piece_s
    powers[..., 0] = inverse * inverse
    powers[..., 2] = 1.0
    powers[..., 3] = piece_s
    return powers


@dataclass(frozen=True)
class AxisTask:
    """All inputs of one axis of one problem, in SI units.

    Attributes:
        start: state at the start; its position is only an origin.
        limits: acceleration and jerk.
        end_speed_mps: velocity to end with.
        crossing_m: least and greatest position at the crossing, relative to the start.
        end_max_m: greatest position at the end, likewise.
        speed_before_mps: least and greatest velocity before the crossing.
        speed_after_mps: the same after it.
        progress_gain_mps3: what the cost falls by for every metre that the end lies farther on.
        unit_mps2: unit of acceleration of the dimensionless problem.
    """

    start: AxisState
    limits: AxisLimits
    end_speed_mps: float
    crossing_m: tuple[float, float]
    end_max_m: float
    speed_before_mps: tuple[float, float]
    speed_after_mps: tuple[float, float]
    progress_gain_mps3: float
    unit_mps2: float

    def lifted(self, factor: float) -> AxisTask:
        """Return the task with the acceleration that extra lift would allow."""
        return replace(self, limits=self.limits.scaled(factor))

    def profile_to(self, speed_mps: float) -> Profile:
        """Change to a speed, from position 0, as quickly as the limits allow."""
        start = self.start._replace(position_m=0.0)
        return Profile(0.0, start.velocity_mps, speed_change(start, speed_mps, self.limits))

    @cached_property
    def braking(self) -> Profile:
        """The profile that comes to a halt as quickly as the limits allow, from position 0."""
        return self.profile_to(0.0)

    def parameters(self, piece_s: FloatArray) -> FloatArray:
        """Dimensionless start and end, and progress_gain for the end position: (..., 4).

        Args:
            piece_s: mean lengths of the pieces of the first phase, (...).
        """
        return _powers(piece_s)[..., _PARAMETER_POWERS] * self.si_parameters

    def bounds(self, piece_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Dimensionless lower and upper bounds of the rows: (..., ROWS) each.

        Args:
            piece_s: mean lengths of the pieces of the first phase, (...).
        """
        units = _powers(piece_s)[..., _ROW_POWERS]
        lower, upper = self.si_bounds
        return units * lower, units * upper

    @cached_property
    def si_parameters(self) -> FloatArray:
        """The parameters for pieces of one second, (4,)."""
        start, unit_mps2 = self.start, self.unit_mps2
        values = start.velocity_mps, start.acceleration_mps2, self.end_speed_mps
        return np.array((*values, self.progress_gain_mps3 / 2.0)) / unit_mps2

    @cached_property
    def si_bounds(self) -> FloatArray:
        """The bounds for pieces of one second, less the margins, lower and upper: (2, ROWS)."""
        jerk_mps3 = self.limits.jerk_max_mps3 * USED_SHARE
        lower = (
            self.limits.acceleration_min_mps2 * USED_SHARE,
            -jerk_mps3,
            self.speed_before_mps[0] + MARGIN_MPS,
            self.speed_after_mps[0] + MARGIN_MPS,
            self.crossing_m[0] + MARGIN_M,
            -math.inf,
        )
        upper = (
            self.limits.acceleration_max_mps2 * USED_SHARE,
            jerk_mps3,
            self.speed_before_mps[1] - MARGIN_MPS,
            self.speed_after_mps[1] - MARGIN_MPS,
            self.crossing_m[1] - MARGIN_M,
            self.end_max_m - MARGIN_M,
        )
        return (np.array((lower, upper)) / self.unit_mps2)[:, _ROW_KINDS]

    def cost_unit(self, piece_s: FloatArray) -> FloatArray:
        """Cost [m²/s³] of a dimensionless cost of one."""
        return self.unit_mps2 * self.unit_mps2 * piece_s


class TaskBatch(NamedTuple):
    """Dimensionless problems of several tasks, each at several piece lengths, n in all.

    Attributes:
        parameters: as `AxisTask.parameters`, (n, 4).
        lower, upper: bounds of the rows asked for, (rows, n).
        cost_unit: cost [m²/s³] of a dimensionless cost of one, (n,).
    """

    parameters: FloatArray
    lower: FloatArray
    upper: FloatArray
    cost_unit: FloatArray

    @classmethod
    def of(cls, queries: Sequence[tuple[AxisTask, FloatArray]], rows: IntArray) -> Self:
        """Collect tasks with their piece lengths [s], and some rows of their bounds."""
        counts = [len(pieces_s) for _, pieces_s in queries]
        pieces_s = np.concatenate([pieces_s for _, pieces_s in queries])
        si_parameters = np.array([task.si_parameters for task, _ in queries])
        si_bounds = np.array([task.si_bounds for task, _ in queries]).transpose(1, 2, 0)
        units_mps2 = np.array([task.unit_mps2 for task, _ in queries])
        powers = _powers(pieces_s)
        # In the order of memory: fancy indices would leave the long axis outermost.
        lower, upper = si_bounds[:, rows].repeat(counts, axis=2)
        units = powers.T.take(_ROW_POWERS[rows], axis=0)
        return cls(
            powers[:, _PARAMETER_POWERS] * si_parameters.repeat(counts, axis=0),
            units * lower,
            units * upper,
            (units_mps2 * units_mps2).repeat(counts) * pieces_s,
        )


@dataclass(frozen=True, eq=False)
class AxisProgram:
    """One QP: minimise ``z^T P z / 2 + gradient^T z`` with the rows between bounds.

    Attributes:
        ends: parameters of the spline, start and end (3,).
        gradient: (FREE,).
        lower, upper: bounds of the rows, (ROWS,), infinite where there is none.
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


def build(matrices: bspline.TwoPhaseSpline, task: AxisTask, piece_s: FloatArray) -> AxisProgram:
    """Build the QP of one axis for one horizon; P and the rows are those of ``matrices``.

    Args:
        matrices: the spline, which is dimensionless.
        task: the axis.
        piece_s: length of the pieces of the first phase, ().
    """
    parameters = task.parameters(piece_s)
    ends, progress_gain = parameters[:3], parameters[3]
    gradient = matrices.gradient_from_parameters @ ends
    gradient[bspline.END_POSITION] -= progress_gain
    lower, upper = task.bounds(piece_s)
    fixed = matrices.rows_from_parameters @ ends
    cost_unit = float(task.cost_unit(piece_s))
    return AxisProgram(
        ends,
        gradient,
        lower - fixed,
        upper - fixed,
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
        # The way beyond the end is flown at exit speed.
        progress_gain_mps3=DELAY_COST_M2PS4 / problem.exit_speed_mps,
        unit_mps2=problem.envelope.along.largest_mps2,
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
        progress_gain_mps3=0.0,
        unit_mps2=sidestep.limits.largest_mps2,
    )
