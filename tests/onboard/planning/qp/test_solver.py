"""The QP backends: chosen by name, deterministic, and of one opinion."""

from __future__ import annotations

import sys
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.geometry.frames import FloatArray
from onboard.planning.certifier import certify_avoidance
from onboard.planning.planner import Plan, Planner
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import AxisProgram, across_task, along_task, build
from onboard.planning.qp.crossing_times import crossing_times
from onboard.planning.qp.solver import Optimum, QpBackend, solver_of
from tests.onboard.planning.avoidance_cases import Variety, draw

BACKENDS: tuple[QpBackend, ...] = ("osqp", "daqp")
MATRICES = bspline.TwoPhaseSpline.with_ratio(1.0)
# What OSQP may be off by, in the units of the scaled rows.
TOLERANCE = 1e-2


def programs(count: int, variety: Variety) -> list[AxisProgram]:
    """QPs as the planner asks them: both axes, at a crossing time in the middle of those to try."""
    rng, found = Random(83), list[AxisProgram]()
    while len(found) < count:
        problem = draw(rng, variety)
        tasks = along_task(problem, clear=False), across_task(problem, "right", clear=False)
        times_s = crossing_times(*tasks, 5).times_s
        if len(times_s):
            piece_s = np.array(times_s[2] / bspline.PIECES)
            found += [build(MATRICES, task, piece_s) for task in tasks]
    return found


def excess(program: AxisProgram, optimum: Optimum) -> float:
    """How far the worst row is out of bounds."""
    values = MATRICES.rows @ optimum.variables
    return float(np.abs(values - values.clip(program.lower, program.upper)).max())


@pytest.mark.parametrize("variety", [Variety(), Variety(lopsided=True)], ids=str)
def test_osqp_agrees_with_the_exact_solver_on_the_planners_programs(variety: Variety) -> None:
    approximate, exact = (solver_of(name)(MATRICES.hessian, MATRICES.rows) for name in BACKENDS)
    agreed = 0
    for program in programs(60, variety):
        arguments = program.gradient, program.lower, program.upper
        found, best = approximate.solve(*arguments), exact.solve(*arguments)
        if best is None:
            # What has no solution is not given one; at the edge OSQP may overlook its tolerance.
            assert found is None or excess(program, found) <= TOLERANCE
            continue
        assert excess(program, best) <= 1e-6
        if found is None:
            continue
        agreed += 1
        assert excess(program, found) <= TOLERANCE
        # Out of bounds by its tolerance, it may be cheaper; it must not be much more expensive.
        scale = 1.0 + abs(best.objective)
        assert found.objective == pytest.approx(best.objective, abs=0.02 * scale)
    assert agreed >= 50


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_active_bounds_the_optimum_is_that_of_the_gradient(backend: QpBackend) -> None:
    solver = solver_of(backend)(MATRICES.hessian, MATRICES.rows)
    gradient = MATRICES.gradient_from_parameters @ np.array([0.4, 0.1, 0.9])
    free = np.full(bspline.ROWS, np.inf)
    optimum = solver.solve(gradient, -free, free)
    assert optimum is not None
    expected = -np.linalg.solve(MATRICES.hessian, gradient)
    np.testing.assert_allclose(optimum.variables, expected, rtol=1e-6, atol=1e-6)
    objective = expected @ MATRICES.hessian @ expected / 2.0 + gradient @ expected
    assert optimum.objective == pytest.approx(objective)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_binding_row_has_a_closed_form(backend: QpBackend) -> None:
    """OSQP is given it as its first guess, and finds nothing better."""
    solver = solver_of(backend)(MATRICES.hessian, MATRICES.rows)
    gradient = MATRICES.gradient_from_parameters @ np.array([0.4, 0.0, 0.9])
    lower, upper = np.full(bspline.ROWS, -np.inf), np.full(bspline.ROWS, np.inf)
    free = -np.linalg.solve(MATRICES.hessian, gradient)
    crossing = MATRICES.rows[bspline.CROSSING_ROW]
    lower[bspline.CROSSING_ROW] = crossing @ free + 1.0
    optimum = solver.solve(gradient, lower, upper)
    assert optimum is not None
    # By Lagrange: the least that moves the row by one.
    response = np.linalg.solve(MATRICES.hessian, crossing)
    expected = free + response / (crossing @ response)
    np.testing.assert_allclose(optimum.variables, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_contradicting_bounds_have_no_optimum(backend: QpBackend) -> None:
    solver = solver_of(backend)(MATRICES.hessian, MATRICES.rows)
    lower, upper = np.full(bspline.ROWS, -np.inf), np.full(bspline.ROWS, np.inf)
    lower[3], upper[3] = 1.0, 0.5
    assert solver.solve(np.zeros(bspline.FREE), lower, upper) is None
    # The end cannot lie 1,000 lengths ahead if no piece may be faster than 1.
    lower[3], upper[3] = -np.inf, np.inf
    upper[:] = 1.0
    upper[bspline.END_ROW], lower[bspline.END_ROW] = np.inf, 1e3
    assert solver.solve(np.zeros(bspline.FREE), lower, upper) is None


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_answer_does_not_depend_on_what_was_solved_before(backend: QpBackend) -> None:
    asked = programs(10, Variety())
    used = solver_of(backend)(MATRICES.hessian, MATRICES.rows)
    for program in asked:
        arguments = program.gradient, program.lower, program.upper
        fresh = solver_of(backend)(MATRICES.hessian, MATRICES.rows).solve(*arguments)
        again = used.solve(*arguments)
        assert (fresh is None) == (again is None)
        if fresh is not None and again is not None:
            assert fresh.variables.tobytes() == again.variables.tobytes()


@given(st.integers(1, 6), st.integers(1, 8), st.integers(0, 2**32 - 1), st.sampled_from(BACKENDS))
@settings(max_examples=60)
def test_no_feasible_point_is_cheaper(
    variables: int, count: int, seed: int, backend: QpBackend
) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(variables, variables))
    hessian: FloatArray = root @ root.T + np.eye(variables)
    rows: FloatArray = rng.normal(size=(count, variables))
    gradient = rng.normal(size=variables)
    # Around a point, so that there is a solution.
    inside = rows @ rng.normal(size=variables)
    lower, upper = inside - rng.uniform(0.1, 1.0, count), inside + rng.uniform(0.1, 1.0, count)
    optimum = solver_of(backend)(hessian, rows).solve(gradient, lower, upper)
    if optimum is None:
        assert backend == "osqp"  # too few iterations for rows of any direction
        return

    def objective(z: FloatArray) -> float:
        return float(z @ hessian @ z / 2.0 + gradient @ z)

    assert optimum.objective == pytest.approx(objective(optimum.variables), abs=1e-6)
    for _ in range(50):
        other = optimum.variables + rng.normal(size=variables) * rng.choice([0.01, 0.1, 1.0])
        values = rows @ other
        if ((values >= lower) & (values <= upper)).all():
            assert objective(other) >= optimum.objective - 2e-2


def test_an_unknown_backend_is_refused_with_those_that_are_known() -> None:
    unknown: Any = "simplex"
    with pytest.raises(
        ValueError, match="unknown QP backend 'simplex'; expected one of: osqp, daqp"
    ):
        Planner(qp_backend=unknown)


def test_only_the_backend_in_use_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "onboard.planning.qp.daqp_solver", raising=False)
    monkeypatch.setitem(sys.modules, "daqp", None)
    assert isinstance(Planner().plan(draw(Random(3), Variety())), Plan)
    with pytest.raises(ModuleNotFoundError, match="daqp"):
        solver_of("daqp")


def test_plans_of_either_backend_certify_and_cost_the_same() -> None:
    osqp, daqp = (Planner(qp_backend=name) for name in BACKENDS)
    rng, both = Random(89), 0
    for _ in range(25):
        problem = draw(rng, Variety())
        plans = [planner.plan(problem) for planner in (osqp, daqp)]
        assert all(isinstance(plan, Plan) for plan in plans)
        for plan in plans:
            assert isinstance(plan, Plan)
            assert certify_avoidance(plan.trajectory, problem).valid
        first, second = plans
        assert isinstance(first, Plan)
        assert isinstance(second, Plan)
        if first.kind == second.kind == "qp":
            both += 1
            assert second.cost == pytest.approx(first.cost, abs=0.1 * (1.0 + abs(first.cost)))
    assert both >= 23
