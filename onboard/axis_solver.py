"""OSQP behind one small door: solves the axis QPs, the same way on every machine and in every run.

Nothing adapts by elapsed time (no rho updates, no time limit, no polishing) and every solve
starts from an explicit point, so a plan is a function of its problem.  Rows are scaled in
advance (spline.py) instead of by OSQP's equilibration, which would slow convergence down.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import osqp
from scipy import sparse

from onboard import spline

if TYPE_CHECKING:
    from onboard.axis_program import AxisProgram
    from onboard.frames import FloatArray

_SETTINGS: dict[str, Any] = {
    "scaling": 0,
    "rho": 1.0,
    "sigma": 1e-9,
    "alpha": 1.6,
    "adaptive_rho": False,
    "eps_abs": 1e-3,
    "eps_rel": 0.0,
    "check_termination": 10,
    "max_iter": 600,
    "polishing": False,
    "verbose": False,
}


class Optimum(NamedTuple):
    """Free variables (FREE,) and objective of a solved QP."""

    free: FloatArray
    objective: float


class AxisSolver:
    """Solves the QPs of one ratio; holds the factorisation, and no other state between solves."""

    def __init__(self, matrices: spline.TwoPhaseSpline) -> None:
        self.matrices = matrices
        self._osqp = osqp.OSQP()
        self._osqp.setup(
            P=sparse.csc_matrix(np.triu(matrices.hessian)),
            q=np.zeros(spline.FREE),
            A=sparse.csc_matrix(matrices.row_scale[:, None] * matrices.rows),
            l=np.zeros(spline.ROWS),
            u=np.zeros(spline.ROWS),
            **_SETTINGS,
        )
        self._origin = np.zeros(spline.FREE), np.zeros(spline.ROWS)

    def solve(self, program: AxisProgram) -> Optimum | None:
        """Return the optimum; None if there is none, or it was not found."""
        if (program.lower > program.upper).any():
            return None
        self._osqp.update(q=program.gradient, l=program.lower, u=program.upper)
        self._osqp.warm_start(*self._origin)
        result = self._osqp.solve(raise_error=False)
        solved = result.info.status_val == osqp.SolverStatus.OSQP_SOLVED
        return Optimum(np.array(result.x), result.info.obj_val) if solved else None
