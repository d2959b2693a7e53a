"""DAQP as a QP backend: a dual active-set method, exact to round-off.

For comparison with OSQP, whose answers are within its tolerance; needs the package ``daqp``, which
the daemon does not install.  Every solve starts from an empty active set.
"""

from __future__ import annotations

import daqp
import numpy as np

from onboard.geometry.frames import FloatArray
from onboard.planning.qp.solver import Optimum

# Stands for infinity, as DAQP has it.
_INACTIVE = 1e30

_PRIMAL_TOLERANCE = 1e-8


class Solver:
    """A solver of `onboard.planning.qp.solver.QpSolver`."""

    def __init__(self, hessian: FloatArray, rows: FloatArray) -> None:
        self._hessian, self._rows = np.ascontiguousarray(hessian), np.ascontiguousarray(rows)

    def solve(self, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> Optimum | None:
        """Return the optimum; see `QpSolver.solve`."""
        if (lower > upper).any():
            return None
        variables, objective, exit_flag, _ = daqp.solve(
            self._hessian,
            gradient,
            self._rows,
            upper.clip(-_INACTIVE, _INACTIVE),
            lower.clip(-_INACTIVE, _INACTIVE),
            primal_tol=_PRIMAL_TOLERANCE,
        )
        return Optimum(np.array(variables), float(objective)) if exit_flag == 1 else None
