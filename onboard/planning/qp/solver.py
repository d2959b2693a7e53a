"""What the planner asks of a QP solver, and the solvers that it may be given by name.

A solver has to be deterministic: its answer is a function of its matrices and of the arguments of
`QpSolver.solve`, never of elapsed time or of what it solved before.  Whatever it answers is
certified before it is flown, so an inexact solver costs comfort, not safety.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Protocol

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

QpBackend = Literal["osqp", "daqp"]

# Each module has a class `Solver`; it is imported when the first planner asks for it.
_MODULES: Final[dict[str, str]] = {
    "osqp": "onboard.planning.qp.osqp_solver",
    "daqp": "onboard.planning.qp.daqp_solver",
}


class Optimum(NamedTuple):
    """Variables and objective at the optimum."""

    variables: FloatArray
    objective: float


class QpSolver(Protocol):
    """Minimises ``z^T P z / 2 + q^T z`` subject to ``lower <= A z <= upper``, for fixed P and A."""

    def __init__(self, hessian: FloatArray, rows: FloatArray) -> None:
        """Prepare for P, positive definite, (n, n), and A, (m, n)."""

    def solve(self, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> Optimum | None:
        """Return the optimum; None if there is none, or it was not found.

        Args:
            gradient: q, (n,).
            lower: lower bounds of the rows, (m,), may be infinite.
            upper: upper bounds of the rows, (m,), likewise.
        """


def solver_of(backend: QpBackend) -> type[QpSolver]:
    """Return the class of a backend's solvers.

    Raises:
        ValueError: no backend has this name.
        ModuleNotFoundError: the package of this backend is not installed.
    """
    module = _MODULES.get(backend)
    if module is None:
        known = ", ".join(_MODULES)
        raise ValueError(f"unknown QP backend {backend!r}; expected one of: {known}")
    solver: type[QpSolver] = importlib.import_module(module).Solver
    return solver
