"""OSQP as a QP backend, set up to solve the same way on every machine and in every run.

Nothing adapts by elapsed time (no rho updates, no time limit, no polishing) and every solve
starts from a point that follows from its QP, so a plan is a function of its problem.  Rows are
scaled here instead of by OSQP's equilibration, which would slow convergence down.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import osqp
from scipy import sparse

from onboard.planning.qp.solver import Optimum

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

# Rows that cost little to move are scaled down: found to make ADMM converge fastest.
_ROW_SCALING_EXPONENT = -0.375

# What OSQP is told instead of infinity.
_INACTIVE = 1e8

_SOLVED = int(osqp.SolverStatus.OSQP_SOLVED)

_SETTINGS: dict[str, Any] = {
    "scaling": 0,
    "rho": 1.5,
    "sigma": 1e-9,
    "alpha": 1.6,
    "adaptive_rho": False,
    "eps_abs": 1e-3,
    "eps_rel": 0.0,
    "check_termination": 15,
    # Of 2800 QPs that have an optimum seven take longer; nearly all that do have none, and were
    # most of the time of the slowest plans.
    "max_iter": 600,
    "polishing": False,
    "verbose": False,
}


class Solver:
    """A solver of `onboard.planning.qp.solver.QpSolver`.

    Holds the factorisation, and no other state between solves.
    """

    def __init__(self, hessian: FloatArray, rows: FloatArray) -> None:
        variables, count = hessian.shape[0], rows.shape[0]
        inverse = np.linalg.inv(hessian)
        # The square of a row's change that costs one.
        sensitivity = np.einsum("ij,jk,ik->i", rows, inverse, rows)
        self._scale = sensitivity**_ROW_SCALING_EXPONENT
        self._rows = self._scale[:, None] * rows
        self._constraint_sensitivity = self._scale**2 * sensitivity
        self._descent = -inverse
        # What the variables change by as a row's multiplier grows by one, (m, n).
        self._responses = -self._rows @ inverse
        wrapper = osqp.OSQP()
        wrapper.setup(
            P=sparse.csc_matrix(np.triu(hessian)),
            q=np.zeros(variables),
            A=sparse.csc_matrix(self._rows),
            l=np.zeros(count),
            u=np.zeros(count),
            **_SETTINGS,
        )
        # The wrapper imports a module for each update and copies forty fields of each result, which
        # takes as long as thirty iterations, or half of all solves.
        self._osqp = wrapper._solver  # noqa: SLF001

    def solve(self, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> Optimum | None:
        """Return the optimum; see `QpSolver.solve`."""
        if (lower > upper).any():
            return None
        lower = np.maximum(lower * self._scale, -_INACTIVE)
        upper = np.minimum(upper * self._scale, _INACTIVE)
        self._osqp.update_data_vec(q=gradient, l=lower, u=upper)
        self._osqp.warm_start(*self._guess(gradient, lower, upper))
        self._osqp.solve()
        info = self._osqp.info
        if info.status_val != _SOLVED:
            return None
        return Optimum(np.array(self._osqp.solution.x), info.obj_val)

    def _guess(
        self, gradient: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return variables and multipliers of the QP with its costliest row alone: a closed form.

        It halves the number of iterations, and often is the optimum already.
        """
        free = self._descent @ gradient
        values = self._rows @ free
        excess = values - values.clip(lower, upper)
        row = int((excess * excess / self._constraint_sensitivity).argmax())
        multipliers = np.zeros(len(values))
        multipliers[row] = excess[row] / self._constraint_sensitivity[row]
        return free + multipliers[row] * self._responses[row], multipliers
