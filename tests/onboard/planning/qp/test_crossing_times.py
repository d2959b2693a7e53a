"""Crossing times: within what is possible, and ranked nearly as the QPs cost."""

from __future__ import annotations

import dataclasses
import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.motion.axis_profile import AxisState
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import AxisTask, across_task, along_task, build
from onboard.planning.qp.crossing_times import CostEstimates, crossing_times
from onboard.planning.qp.osqp_solver import Solver
from tests.onboard.planning.avoidance_cases import Variety, draw


def tasks(seed: int, variety: Variety | None = None) -> tuple[AxisTask, AxisTask]:
    problem = draw(Random(seed), variety or Variety())
    return along_task(problem, clear=False), across_task(problem, "right", clear=False)


def test_estimates_come_near_what_the_qp_costs() -> None:
    ratios = (0.8, 1.6, 3.2)
    splines = [bspline.TwoPhaseSpline.with_ratio(ratio) for ratio in ratios]
    estimates = CostEstimates(splines)
    solvers = [Solver(matrices.hessian, matrices.rows) for matrices in splines]
    rng = Random(61)
    errors: list[float] = []
    for _ in range(40):
        problem = draw(rng, Variety())
        tasks = along_task(problem, clear=False), across_task(problem, "left", clear=False)
        crossings_s = crossing_times(*tasks, 4).times_s
        for task in tasks:
            (estimated,) = estimates.of([(task, crossings_s)])
            for (i, k), estimate in np.ndenumerate(estimated):
                program = build(splines[i], task, np.array(crossings_s[k] / bspline.PIECES))
                optimum = solvers[i].solve(program.gradient, program.lower, program.upper)
                if optimum is not None:
                    axis_cost = program.cost(optimum.objective)
                    errors.append(float((estimate - axis_cost) / (1.0 + abs(axis_cost))))
    assert len(errors) > 200
    assert abs(np.median(errors)) < 0.02
    assert np.mean(np.abs(errors) < 0.15) > 0.75


def test_estimates_do_not_depend_on_what_else_is_asked() -> None:
    splines = [bspline.TwoPhaseSpline.with_ratio(ratio) for ratio in (0.8, 1.6)]
    estimates = CostEstimates(splines)
    first, second = tasks(4), tasks(5)
    queries = [
        (task, crossing_times(*pair, count).times_s)
        for pair, count in ((first, 4), (second, 7))
        for task in pair
    ]
    together = estimates.of(queries)
    for query, found in zip(queries, together, strict=True):
        (alone,) = estimates.of([query])
        assert found.shape == (2, len(query[1]))
        np.testing.assert_allclose(found, alone, rtol=1e-5)


@given(st.integers(0, 2000), st.integers(1, 16))
def test_times_ascend_between_the_earliest_and_the_latest(seed: int, count: int) -> None:
    along, across = tasks(seed)
    times_s, _ = crossing_times(along, across, count)
    if len(times_s) == 0:
        return
    assert len(times_s) == count
    assert (np.diff(times_s) > 0.0).all()
    # Full input sideways is not beyond the face before the first of them.
    rushing = across.profile_to(1e3)
    assert rushing.at(float(times_s[0])).position_m >= across.crossing_m[0] - 1e-6
    # And full braking has not led to the front face by the last of them.
    assert along.braking.at(float(times_s[-1])).position_m <= along.crossing_m[1] + 1e-6


def test_there_are_none_where_the_face_cannot_be_cleared_in_time() -> None:
    along, across = tasks(1)
    near = dataclasses.replace(along, crossing_m=(-math.inf, 0.05))
    assert along.start.velocity_mps > 0.5
    assert len(crossing_times(near, across, 8).times_s) == 0


def test_who_can_stop_before_the_face_may_wait() -> None:
    along, across = tasks(1)
    stop_m = along.braking.final.position_m
    far = dataclasses.replace(along, crossing_m=(-math.inf, stop_m + 0.1))
    wide = dataclasses.replace(across, crossing_m=(60.0, math.inf))
    times_s, waiting = crossing_times(far, wide, 8)
    assert waiting
    assert len(times_s) == 8
    assert not crossing_times(far, dataclasses.replace(across, crossing_m=(0.1, math.inf)), 8)[1]


def test_where_nothing_is_in_the_way_there_is_time() -> None:
    along, across = tasks(2)
    anywhere = (-math.inf, math.inf)
    free = dataclasses.replace(along, crossing_m=anywhere)
    clear = dataclasses.replace(across, crossing_m=anywhere, start=AxisState(0.0, 0.0, 0.0))
    times_s, waiting = crossing_times(free, clear, 8)
    assert not waiting
    assert 0.25 <= times_s[0] < times_s[-1] <= 2.0


def test_a_start_at_rest_has_finite_times() -> None:
    along, across = tasks(3)
    resting = dataclasses.replace(along, start=AxisState(0.0, 0.0, 0.0))
    times_s, _ = crossing_times(resting, across, 8)
    assert len(times_s) == 8
    assert np.isfinite(times_s).all()


@pytest.mark.parametrize("drift_mps", [-0.4, -0.05])
def test_a_drift_towards_the_face_is_turned_back_first(drift_mps: float) -> None:
    """Beyond the face and drifting back: clear for good no sooner than the drift is over."""
    along, across = tasks(6)
    beyond = dataclasses.replace(
        across, start=AxisState(0.0, drift_mps, 0.0), crossing_m=(-1e-4, math.inf)
    )
    times_s, _ = crossing_times(along, beyond, 8)
    if len(times_s):
        assert times_s[0] >= 0.25
        ended_s = beyond.braking.duration_s
        assert ended_s > 0.0
