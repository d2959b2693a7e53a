"""The search over horizons: cheapest first, and no more solves than it is worth."""

from __future__ import annotations

import dataclasses
from random import Random

import pytest

from onboard.planning.certifier import certify_avoidance
from onboard.planning.plan import Plan
from onboard.planning.problem import AvoidanceProblem, cost
from onboard.planning.qp import search
from onboard.planning.qp.search import QpPlanner, spline_library
from onboard.planning.qp.solver import solver_of
from tests.onboard.planning.avoidance_cases import Variety, draw

PLANNER = QpPlanner()


def found(
    problem: AvoidanceProblem, incumbent: Plan | None = None
) -> tuple[Plan | None, list[str]]:
    reasons: list[str] = []
    return PLANNER.plan(problem, None, incumbent, reasons), reasons


def test_a_plan_is_certified_and_costs_what_it_says() -> None:
    rng = Random(19)
    for _ in range(20):
        problem = draw(rng, Variety())
        plan, reasons = found(problem)
        assert plan is not None
        assert reasons == []
        assert plan.kind == "qp"
        assert certify_avoidance(plan.trajectory, problem) == plan.certificate
        assert plan.cost == cost(plan.trajectory, problem)
        assert plan.crossing_s is not None
        assert problem.start_s < plan.crossing_s < plan.trajectory.end_s


def test_an_incumbent_is_kept_unless_something_is_worth_the_change() -> None:
    problem = draw(Random(23), Variety())
    plan, _ = found(problem)
    assert plan is not None
    kept, _ = found(problem, plan)
    assert kept is plan
    expensive = dataclasses.replace(plan, cost=10.0 * (abs(plan.cost) + 1.0))
    better, _ = found(problem, expensive)
    assert better is not None
    assert better.cost <= plan.cost + 0.1 * (1.0 + abs(plan.cost))


def test_what_is_impossible_is_said_for_either_side() -> None:
    """At full speed a hand's breadth before the face."""
    problem = draw(Random(29), Variety(drift=False))
    x_m = problem.region.keep_out.x_min_m - 0.1
    start = problem.start._replace(
        position_leg_m=(x_m, 0.0, 0.0),
        velocity_leg_mps=(problem.envelope.speed_max_mps, 0.0, 0.0),
    )
    plan, reasons = found(dataclasses.replace(problem, start=start))
    assert plan is None
    for side in ("left", "right"):
        assert any(reason.startswith(f"qp, {side}: ") for reason in reasons)


def test_the_number_of_solves_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    solver = solver_of("osqp")
    solves = 0
    solve = solver.solve

    def counted(self: object, *arguments: object) -> object:
        nonlocal solves
        solves += 1
        return solve(self, *arguments)  # type: ignore[arg-type]  # as it is called

    monkeypatch.setattr(solver, "solve", counted)
    rng, most = Random(31), 0
    for _ in range(25):
        solves = 0
        found(draw(rng, Variety(lag=False)))
        most = max(most, solves)
    # One candidate may begin when one solve is left, and takes two.
    assert 0 < most <= search._SOLVES_UNTIL_FOUND + 1


def test_planners_share_the_factorisations() -> None:
    solver = solver_of("osqp")
    assert spline_library(1.0, solver) is spline_library(1.0, solver)
    assert spline_library(1.0, solver) is not spline_library(1.2, solver)
    assert spline_library(1.0, solver) is not spline_library(1.0, solver_of("daqp"))


def test_a_plan_prefers_the_cheaper_side() -> None:
    """Far to the left of the middle of the face, the left edge is nearer."""
    rng, checked = Random(37), 0
    while checked < 10:
        problem = draw(rng, Variety(drift=False))
        face = problem.region.keep_out
        _, y_m, _ = problem.start.position_leg_m
        share = (y_m - face.y_min_m) / (face.y_max_m - face.y_min_m)
        if not (0.0 < share < 0.25 or 0.75 < share < 1.0):
            continue
        checked += 1
        plan, _ = found(problem)
        assert plan is not None
        assert plan.side == ("left" if share < 0.5 else "right")


def test_the_horizon_of_the_plan_that_is_flown_is_tried_again() -> None:
    problem = draw(Random(41), Variety())
    plan, _ = found(problem)
    assert plan is not None
    now_s = problem.start_s + 0.2 * (plan.trajectory.end_s - problem.start_s)
    middle = dataclasses.replace(problem, start=plan.trajectory.sample(now_s), start_s=now_s)
    following = PLANNER.plan(middle, plan, None, [])
    assert following is not None
    assert certify_avoidance(following.trajectory, middle).valid
    assert following.side == plan.side
