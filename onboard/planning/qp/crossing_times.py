"""Ranks crossing times and ratios of the two phases before any QP is solved.

For every candidate the QP without its inequalities has a closed form.  So has the QP with the
crossing and any one other row as equalities, and the costliest of those costs nearly as much as the
whole QP.  The estimates of all candidates are a few array operations, and the candidate with the
lowest is usually the best.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import TaskBatch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.geometry.frames import FloatArray
    from onboard.planning.qp.axis_program import AxisTask

# A vehicle that turns in tenths of a second cannot make use of a shorter phase.
_CROSSING_MIN_S = 0.25

# Longest crossing time, in the larger of the times to sidestep and to approach at speed.
_PATIENCE = 2.5

# The latest crossing where the obstacle is cleared already: long enough for gentle accelerations.
_UNHURRIED_S = 2.0

# A start slower than this share of the exit speed counts as this fast.
_SLOW_SHARE = 0.3

# More than any vehicle reaches in a sidestep.
_UNBOUNDED_MPS = 1e3

# With the crossing held, a row keeps at least this share of its sensitivity: one that hardly moves
# any more would seem to cost without limit.
_SENSITIVITY_MIN_SHARE = 1e-3

# Enough of the rows to find the costliest, nearly: every other one, and the end.
_CHECKED_ROWS = np.append(np.arange(0, bspline.CROSSING_ROW, 2), bspline.END_ROW)
# Last, the row of the crossing itself.
_ASKED_ROWS = np.append(_CHECKED_ROWS, bspline.CROSSING_ROW)


class CostEstimates:
    """Estimates of the cost of an axis, for all ratios and many crossing times at once.

    Args:
        splines: one for each ratio.
    """

    def __init__(self, splines: list[bspline.TwoPhaseSpline]) -> None:
        forms = [_closed_form(matrices) for matrices in splines]
        optimum = _ClosedForm(*(np.array(part) for part in zip(*forms, strict=True)))
        sensitivity = optimum.constraint_sensitivity
        self._cost = optimum.cost.reshape(len(splines), -1)
        self._crossing = optimum.rows[:, bspline.CROSSING_ROW]
        self._crossing_sensitivity = sensitivity[:, bspline.CROSSING_ROW, None]
        # As functions of the parameters and of the shift of the crossing.  Single precision is
        # plenty to choose by, and half of the memory to go through.
        per_shift = optimum.rows_per_crossing_shift[..., None]
        checked = np.concatenate((optimum.rows, per_shift), axis=-1)[:, _CHECKED_ROWS]
        self._rows = checked.astype(np.float32)
        self._violation_weight, self._violation_weight_held = (
            (1.0 / each[:, _CHECKED_ROWS, None]).astype(np.float32)
            for each in (sensitivity, optimum.sensitivity_crossing_held)
        )

    def of(self, queries: Sequence[tuple[AxisTask, FloatArray]]) -> list[FloatArray]:
        """Return costs [m²/s³], (ratios, crossings), for each task and its crossing times (n,).

        All at once, because what takes time here is the number of array operations.
        """
        counts = [len(crossings_s) for _, crossings_s in queries]
        batch = TaskBatch.of(
            [(task, crossings_s / bspline.PIECES) for task, crossings_s in queries], _ASKED_ROWS
        )
        cost = batch.cost_unit * self._dimensionless(batch)
        ends = list(itertools.accumulate(counts))
        return [cost[:, end - count : end] for count, end in zip(counts, ends, strict=True)]

    def _dimensionless(self, batch: TaskBatch) -> FloatArray:
        """Return dimensionless costs (ratios, n)."""
        parameters = batch.parameters
        products = parameters[:, :, None] * parameters[:, None, :]
        cost: FloatArray = self._cost @ products.reshape(len(products), self._cost.shape[1]).T
        crossing = self._crossing @ parameters.T
        crossing_shift = crossing.clip(batch.lower[-1], batch.upper[-1])
        crossing_shift -= crossing
        given = np.empty(
            (len(crossing_shift), parameters.shape[1] + 1, len(parameters)), np.float32
        )
        given[:, :-1], given[:, -1] = parameters.T, crossing_shift
        rows = self._rows @ given
        excess = np.maximum(rows, batch.lower[:-1].astype(np.float32))
        np.minimum(excess, batch.upper[:-1].astype(np.float32), out=excess)
        excess -= rows
        excess *= excess
        costliest = (excess * self._violation_weight).max(axis=1)
        excess *= self._violation_weight_held
        costliest_held = excess.max(axis=1)
        cost += crossing_shift**2 / self._crossing_sensitivity
        cost += np.where(crossing_shift == 0.0, costliest, costliest_held)
        return cost


class _ClosedForm(NamedTuple):
    """Optimum of the QP without inequalities, as a function of the parameters.

    The parameters are (v, a, v_T, progress gain), as of `AxisTask.parameters`.

    Attributes:
        cost: quadratic form, (4, 4).
        rows: values of the rows, (ROWS, 4).
        rows_per_crossing_shift: what the rows change by as the crossing is moved by one, (ROWS,).
        constraint_sensitivity: the square of a row's change that costs one, (ROWS,).
        sensitivity_crossing_held: the same while the crossing stays where it is, (ROWS,).
    """

    cost: FloatArray
    rows: FloatArray
    rows_per_crossing_shift: FloatArray
    constraint_sensitivity: FloatArray
    sensitivity_crossing_held: FloatArray


def _closed_form(matrices: bspline.TwoPhaseSpline) -> _ClosedForm:
    inverse = np.linalg.inv(matrices.hessian)
    end = np.zeros((bspline.FREE, 1))
    end[bspline.END_POSITION] = 1.0
    gradient = np.hstack((matrices.gradient_from_parameters, -end))
    cost = -gradient.T @ inverse @ gradient
    cost[:3, :3] += matrices.energy_of_parameters
    rows = -matrices.rows @ inverse @ gradient
    rows[:, :3] += matrices.rows_from_parameters
    coupling = matrices.rows @ inverse @ matrices.rows.T
    sensitivity = np.diag(coupling)
    crossing = coupling[:, bspline.CROSSING_ROW]
    per_shift = crossing / sensitivity[bspline.CROSSING_ROW]
    held = np.maximum(sensitivity - crossing * per_shift, _SENSITIVITY_MIN_SHARE * sensitivity)
    return _ClosedForm(cost, rows, per_shift, sensitivity, held)


class CrossingTimes(NamedTuple):
    """Crossing times to try.

    Attributes:
        times_s: ascending; empty if the obstacle cannot be cleared in time.
        waiting: the vehicle has to stop early and wait for its sidestep, so that the beginning of
            the phase needs finer pieces than the rest.
    """

    times_s: FloatArray
    waiting: bool


def crossing_times(along: AxisTask, across: AxisTask, count: int) -> CrossingTimes:
    """Choose crossing times between the least and the greatest that are possible.

    The least is the time to clear the side face with full input, the greatest the time at which a
    vehicle that brakes as hard as it can passes the front face.
    """
    earliest_s = max(_time_to_reach(across, across.crossing_m[0]), _CROSSING_MIN_S)
    front_m = along.crossing_m[1]
    if math.isinf(front_m):
        latest_s, waiting = max(3.0 * earliest_s, _UNHURRIED_S), False
    else:
        braking = along.braking
        waiting = braking.duration_s < earliest_s
        speed_mps = max(along.start.velocity_mps, _SLOW_SHARE * along.end_speed_mps)
        approach_s = max(front_m, 0.0) / speed_mps
        latest_s = braking.last_time_at_s(front_m) or math.inf
        latest_s = min(latest_s, _PATIENCE * max(earliest_s, approach_s))
    if latest_s < earliest_s:
        return CrossingTimes(np.empty(0), waiting)
    # At either end only a bang-bang input would do: stay off them.
    shares = (np.arange(count) + 0.5) / count
    return CrossingTimes(earliest_s * (latest_s / earliest_s) ** shares, waiting)


def _time_to_reach(task: AxisTask, position_m: float) -> float:
    """Least time from which on a position is kept; 0 if it lies behind and nothing drifts back."""
    drifting_back = task.start.velocity_mps < 0.0
    if position_m <= 0.0 and not drifting_back:
        return 0.0
    rushing = task.profile_to(min(task.speed_before_mps[1], _UNBOUNDED_MPS))
    reached_s = rushing.last_time_at_s(position_m)
    if reached_s is None and drifting_back:
        # Never that far back; but it has to come to an end.
        return task.braking.duration_s
    if reached_s is not None:
        return reached_s
    coast_m = position_m - rushing.final.position_m
    return rushing.duration_s + coast_m / rushing.final.velocity_mps
