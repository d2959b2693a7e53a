"""Which crossing time and which ratio of the two phases: ranked before any QP is solved.

For every candidate the QP without its inequalities has a closed form.  So has the QP with the
crossing and any one other row, and the dearest of those is a lower bound on what the whole QP can
cost.  The bounds of all candidates are a few array operations, and they are tight: the first is
usually the best.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from onboard import spline
from onboard.profile import Profile, speed_change

if TYPE_CHECKING:
    from onboard.axis_program import AxisTask
    from onboard.frames import FloatArray

# Below this a phase is only noise to a vehicle that turns in tenths of a second.
_CROSSING_MIN_S = 0.25

# A row that hardly bends once the crossing is fixed cannot be mended by bending it.
_LEAST_CHEAPNESS = 1e-3


class Horizon(NamedTuple):
    """A candidate: crossing time, index of the ratio, and what its two axes cost at least."""

    crossing_s: float
    ratio_index: int
    along_cost: float
    across_cost: float


class CostBounds:
    """Lower bounds on the cost of an axis, for all ratios and many crossing times at once.

    Args:
        splines: one for each ratio.
    """

    def __init__(self, splines: list[spline.TwoPhaseSpline]) -> None:
        terms = [_closed_form(matrices) for matrices in splines]
        self._cost, self._rows, self._bend, self._cheapness, self._cheapness_bent = (
            np.array(term) for term in zip(*terms, strict=True)
        )

    def of(self, task: AxisTask, crossings_s: FloatArray) -> FloatArray:
        """Return costs [m²/s³], (ratios, crossings)."""
        piece_s = crossings_s / spline.PIECES
        parameters = task.parameters(piece_s)
        lower, upper = task.bounds(piece_s)
        cost = np.einsum("ti,rij,tj->rt", parameters, self._cost, parameters)
        rows = parameters @ self._rows.transpose(0, 2, 1)
        at_crossing = rows[..., spline.CROSSING_ROW]
        bend = (
            at_crossing.clip(lower[:, spline.CROSSING_ROW], upper[:, spline.CROSSING_ROW])
            - at_crossing
        )
        cost += bend * bend / self._cheapness[:, spline.CROSSING_ROW, None]
        rows += bend[..., None] * self._bend[:, None, :]
        excess = np.maximum(rows - upper, lower - rows).clip(min=0.0)
        cheapness = np.where(
            bend[..., None] == 0.0, self._cheapness[:, None, :], self._cheapness_bent[:, None, :]
        )
        cost += (excess * excess / cheapness).max(axis=-1)
        bounded: FloatArray = cost * task.cost_unit(piece_s)
        return bounded


def _closed_form(matrices: spline.TwoPhaseSpline) -> tuple[FloatArray, ...]:
    """Optimum of the QP without inequalities, as a function of the parameters (v, a, v_T, reward).

    Returns:
        Cost as a quadratic form (4, 4); rows (ROWS, 4); what the rows change by as the crossing
        is moved by one (ROWS,); cheapness: the square of a row's change that costs one, (ROWS,);
        the same while the crossing is held.
    """
    inverse = np.linalg.inv(matrices.hessian)
    end = np.zeros((spline.FREE, 1))
    end[spline.END_POSITION] = 1.0
    gradient = np.hstack((matrices.gradient_from_parameters, -end))
    cost = -gradient.T @ inverse @ gradient
    cost[:3, :3] += matrices.energy_of_parameters
    rows = -matrices.rows @ inverse @ gradient
    rows[:, :3] += matrices.rows_from_parameters
    coupling = matrices.rows @ inverse @ matrices.rows.T
    cheapness = np.diag(coupling)
    crossing = coupling[:, spline.CROSSING_ROW]
    bend = crossing / cheapness[spline.CROSSING_ROW]
    held = np.maximum(cheapness - crossing * bend, _LEAST_CHEAPNESS * cheapness)
    return cost, rows, bend, cheapness, held


def crossing_times_s(along: AxisTask, across: AxisTask, count: int) -> FloatArray:
    """Return crossing times to try, ascending; empty if the obstacle cannot be cleared in time.

    They lie between the least time to clear the side face and the time at which a vehicle that
    brakes as hard as it can passes the front face.
    """
    earliest_s = 0.0
    if across.crossing_m[0] > 0.0:
        rushing = _profile(across, across.speed_before_mps[1])
        reached_s = rushing.last_time_at_s(across.crossing_m[0])
        if reached_s is None:
            coast_m = across.crossing_m[0] - rushing.final.position_m
            reached_s = rushing.duration_s + coast_m / rushing.final.velocity_mps
        earliest_s = reached_s
    latest_s = math.inf
    if math.isfinite(along.crossing_m[1]):
        latest_s = _profile(along, 0.0).last_time_at_s(along.crossing_m[1]) or math.inf
    earliest_s = max(earliest_s, _CROSSING_MIN_S)
    # Unhurried: at the face at the speed of the exit, or a good while after the sidestep.
    unhurried_s = 1.2 * max(along.crossing_m[1], 0.0) / along.end_speed_mps
    latest_s = min(latest_s, max(3.0 * earliest_s, unhurried_s if unhurried_s < math.inf else 0.0))
    if latest_s < earliest_s:
        return np.empty(0)
    # At either end only a bang-bang input would do: stay off them.
    return earliest_s * (latest_s / earliest_s) ** ((np.arange(count) + 0.5) / count)


def _profile(task: AxisTask, speed_mps: float) -> Profile:
    """Change to a speed, from position 0, as quickly as the limits allow."""
    start = task.start._replace(position_m=0.0)
    limit_mps = min(speed_mps, _UNBOUNDED_MPS)
    return Profile(0.0, start.velocity_mps, speed_change(start, limit_mps, task.limits))


_UNBOUNDED_MPS = 1e3
