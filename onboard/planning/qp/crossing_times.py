"""Which crossing time and which ratio of the two phases: ranked before any QP is solved.

For every candidate the QP without its inequalities has a closed form.  So has the QP with the
crossing and any one other row as equalities, and the dearest of those is nearly what the whole QP
costs.  The estimates of all candidates are a few array operations, and the lowest usually is the
best.
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

# Below this a phase is only noise to a vehicle that turns in tenths of a second.
_CROSSING_MIN_S = 0.25

# Longest crossing time, in the larger of the times to sidestep and to approach at speed.
_PATIENCE = 2.5

# Where nothing is in the way any more: long enough for whatever is left to be done gently.
_UNHURRIED_S = 2.0

# A start slower than this share of the exit speed counts as this fast.
_SLOW_SHARE = 0.3

# More than any vehicle reaches in a sidestep.
_UNBOUNDED_MPS = 1e3

# A row that hardly bends once the crossing is fixed cannot be mended by bending it.
_LEAST_CHEAPNESS = 1e-3


# Enough of the rows to find the dearest, nearly: every other one, and the end.
_CHECKED_ROWS = np.append(np.arange(0, bspline.CROSSING_ROW, 2), bspline.END_ROW)
# Last, the row of the crossing itself.
_ASKED_ROWS = np.append(_CHECKED_ROWS, bspline.CROSSING_ROW)


class CostEstimates:
    """Estimates of the cost of an axis, for all ratios and many crossing times at once.

    Args:
        splines: one for each ratio.
    """

    def __init__(self, splines: list[bspline.TwoPhaseSpline]) -> None:
        terms = [_closed_form(matrices) for matrices in splines]
        cost, rows, bend, cheapness, cheapness_held = (
            np.array(term) for term in zip(*terms, strict=True)
        )
        self._cost = cost.reshape(len(splines), -1)
        self._crossing = rows[:, bspline.CROSSING_ROW]
        self._crossing_cheapness = cheapness[:, bspline.CROSSING_ROW, None]
        # As functions of the parameters and of the bend of the crossing.  Single precision is
        # plenty to choose by, and half of the memory to go through.
        checked = np.concatenate((rows, bend[..., None]), axis=-1)[:, _CHECKED_ROWS]
        self._rows = checked.astype(np.float32)
        self._dearness = (1.0 / cheapness[:, _CHECKED_ROWS, None]).astype(np.float32)
        self._dearness_held = (1.0 / cheapness_held[:, _CHECKED_ROWS, None]).astype(np.float32)

    def of(self, questions: Sequence[tuple[AxisTask, FloatArray]]) -> list[FloatArray]:
        """Return costs [m²/s³], (ratios, crossings), for each task and its crossing times (n,).

        All at once, because what takes time here is the number of array operations.
        """
        counts = [len(crossings_s) for _, crossings_s in questions]
        batch = TaskBatch.of(
            [(task, crossings_s / bspline.PIECES) for task, crossings_s in questions], _ASKED_ROWS
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
        bend = crossing.clip(batch.lower[-1], batch.upper[-1])
        bend -= crossing
        bent = np.empty((len(bend), parameters.shape[1] + 1, len(parameters)), np.float32)
        bent[:, :-1], bent[:, -1] = parameters.T, bend
        rows = self._rows @ bent
        excess = np.maximum(rows, batch.lower[:-1].astype(np.float32))
        np.minimum(excess, batch.upper[:-1].astype(np.float32), out=excess)
        excess -= rows
        excess *= excess
        dearest = (excess * self._dearness).max(axis=1)
        excess *= self._dearness_held
        dearest_held = excess.max(axis=1)
        cost += bend**2 / self._crossing_cheapness
        cost += np.where(bend == 0.0, dearest, dearest_held)
        return cost


def _closed_form(matrices: bspline.TwoPhaseSpline) -> tuple[FloatArray, ...]:
    """Optimum of the QP without inequalities, as a function of the parameters (v, a, v_T, reward).

    Returns:
        Cost as a quadratic form (4, 4); rows (ROWS, 4); what the rows change by as the crossing
        is moved by one (ROWS,); cheapness: the square of a row's change that costs one, (ROWS,);
        the same while the crossing is held.
    """
    inverse = np.linalg.inv(matrices.hessian)
    end = np.zeros((bspline.FREE, 1))
    end[bspline.END_POSITION] = 1.0
    gradient = np.hstack((matrices.gradient_from_parameters, -end))
    cost = -gradient.T @ inverse @ gradient
    cost[:3, :3] += matrices.energy_of_parameters
    rows = -matrices.rows @ inverse @ gradient
    rows[:, :3] += matrices.rows_from_parameters
    coupling = matrices.rows @ inverse @ matrices.rows.T
    cheapness = np.diag(coupling)
    crossing = coupling[:, bspline.CROSSING_ROW]
    bend = crossing / cheapness[bspline.CROSSING_ROW]
    held = np.maximum(cheapness - crossing * bend, _LEAST_CHEAPNESS * cheapness)
    return cost, rows, bend, cheapness, held


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
