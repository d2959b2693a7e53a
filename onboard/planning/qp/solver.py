"""OSQP behind one small door: solves QPs the same way on every machine and in every run.

Nothing adapts by elapsed time (no rho updates, no time limit, no polishing) and every solve
starts from a point that follows from its QP, so a plan is a function of its problem.  Rows are
scaled here instead of by OSQP's equilibration, which would slow convergence down.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import osqp
from scipy import sparse

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

# Rows whose change costs much are scaled down: found to make ADMM converge fastest.
_ROW_SCALING_EXPONENT = -0.375

# What OSQP is told instead of infinity.
_INACTIVE = 1e8

_SETTINGS: dict[str, Any] = {
    "scaling": 0,
    "rho": 1.5,
    "sigma": 1e-9,
    "alpha": 1.6,
    "adaptive_rho": False,
    "eps_abs": 1e-3,
    "eps_rel": 0.0,
    "check_termination": 15,
    "max_iter": 1000,
    "polishing": False,
    "verbose": False,
}


class Optimum(NamedTuple):
    """Variables and objective at the optimum."""

    variables: FloatArray
    objective: float


class QpSolver:
    """Minimises ``z^T P z / 2 + q^T z`` subject to ``lower <= A z <= upper``, for fixed P and A.

    Holds the factorisation, and no other state between solves.

    Args:
        hessian: P, positive definite, (n, n).
        rows: A, (m, n).
    """

    def __init__(self, hessian: FloatArray, rows: FloatArray) -> None:
        variables, count = hessian.shape[0], rows.shape[0]
        inverse = np.linalg.inv(hessian)
        # The square of a row's change that costs one.
        cheapness = np.einsum("ij,jk,ik->i", rows, inverse, rows)
        self._scale = cheapness**_ROW_SCALING_EXPONENT
        self._rows = self._scale[:, None] * rows
        self._cheapness = self._scale**2 * cheapness
        self._descent = -inverse
        # What the variables change by as a row's multiplier grows by one, (m, n).
        self._responses = -self._rows @ inverse
        self._osqp = osqp.OSQP()
        self._osqp.setup(
            P=sparse.csc_matrix(np.triu(hessian)),
            q=np.zeros(variables),
            A=sparse.csc_matrix(self._rows),
            l=np.zeros(count),
            u=np.zeros(count),
            **_SETTINGS,
        )

    def solve(self, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> Optimum | None:
        """Return the optimum; None if there is none, or it was not found.

        Args:
            gradient: q, (n,).
            lower: lower bounds of the rows, (m,), may be infinite.
            upper: upper bounds of the rows, (m,), likewise.
        """
        if (lower > upper).any():
            return None
        lower = np.maximum(lower * self._scale, -_INACTIVE)
        upper = np.minimum(upper * self._scale, _INACTIVE)
        self._osqp.update(q=gradient, l=lower, u=upper)
        self._osqp.warm_start(*self._guess(gradient, lower, upper))
        result = self._osqp.solve(raise_error=False)
        solved = result.info.status_val == osqp.SolverStatus.OSQP_SOLVED
        return Optimum(np.array(result.x), result.info.obj_val) if solved else None

    def _guess(
        self, gradient: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return variables and multipliers of the QP with its dearest row alone: a closed form.

        It halves the number of iterations, and often is the optimum already.
        """
        free = self._descent @ gradient
        values = self._rows @ free
        excess = values - values.clip(lower, upper)
        dearest = int((excess * excess / self._cheapness).argmax())
        multipliers = np.zeros(len(values))
        multipliers[dearest] = excess[dearest] / self._cheapness[dearest]
        return free + multipliers[dearest] * self._responses[dearest], multipliers
