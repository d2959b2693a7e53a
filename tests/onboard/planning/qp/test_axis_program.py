"""The QP of one axis states the problem: bounds in the right units, and independent of them."""

from __future__ import annotations

import dataclasses
import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.geometry.frames import FloatArray
from onboard.planning.problem import DELAY_COST_M2PS4
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import (
    MARGIN_M,
    MARGIN_MPS,
    USED_SHARE,
    AxisTask,
    TaskBatch,
    across_task,
    along_task,
    build,
)
from onboard.planning.qp.osqp_solver import Solver
from tests.onboard.planning.avoidance_cases import Variety, draw

PIECES_S = st.floats(0.02, 1.0)
COUNTS = np.cumsum((0, *bspline.ROW_COUNTS))


def tasks(seed: int, *, clear: bool = False) -> tuple[AxisTask, AxisTask]:
    problem = draw(Random(seed), Variety(passive_safety=True))
    return along_task(problem, clear=clear), across_task(problem, "left", clear=clear)


def test_build_states_the_problem() -> None:
    """The closed form, fitted with the spline, satisfies the rows the solver is given."""
    problem = draw(Random(53), Variety(drift=False))
    matrices = bspline.TwoPhaseSpline.with_ratio(1.3)
    task = along_task(problem, clear=False)
    piece_s = np.array(0.1)
    # Coasting: all accelerations zero, which costs nothing but arrives at the start speed.
    speed_mps = problem.start.velocity_leg_mps[0]
    coasting = dataclasses.replace(task, end_speed_mps=speed_mps)
    program = build(matrices, coasting, piece_s)
    duration_s = 0.1 * float(matrices.durations.sum())
    unit_m = task.unit_mps2 * 0.1 * 0.1
    free: FloatArray = np.linalg.lstsq(
        matrices.node_accelerations,
        -matrices.node_accelerations_from_parameters @ program.ends,
        rcond=None,
    )[0].astype(np.float64)
    np.testing.assert_allclose(matrices.accelerations(free, program.ends), 0.0, atol=1e-9)
    assert free[bspline.END_POSITION] * unit_m == pytest.approx(speed_mps * duration_s)
    at_crossing = (matrices.rows @ free + matrices.rows_from_parameters @ program.ends)[
        bspline.CROSSING_ROW
    ]
    assert at_crossing * unit_m == pytest.approx(speed_mps * 0.1 * bspline.PIECES)
    front_m = problem.region.keep_out.x_min_m - problem.start.position_leg_m[0]
    bound_m = task.bounds(piece_s)[1][bspline.CROSSING_ROW] * unit_m
    assert front_m - 0.01 < bound_m < front_m


def test_a_batch_of_tasks_states_what_each_task_states() -> None:
    problem = draw(Random(54), Variety())
    tasks = along_task(problem, clear=False), across_task(problem, "left", clear=False)
    pieces_s = np.array([0.05, 0.2]), np.array([0.1])
    rows = np.array([bspline.END_ROW, 3, bspline.CROSSING_ROW])
    batch = TaskBatch.of(list(zip(tasks, pieces_s, strict=True)), rows)
    asked = [(task, at_s) for task, each_s in zip(tasks, pieces_s, strict=True) for at_s in each_s]
    for k, (task, piece_s) in enumerate(asked):
        lower, upper = task.bounds(piece_s)
        np.testing.assert_array_equal(batch.parameters[k], task.parameters(piece_s))
        np.testing.assert_array_equal(batch.lower[:, k], lower[rows])
        np.testing.assert_array_equal(batch.upper[:, k], upper[rows])
        assert batch.cost_unit[k] == task.cost_unit(piece_s)


@given(st.integers(0, 500), PIECES_S)
def test_bounds_are_the_limits_less_the_margins(seed: int, piece_s: float) -> None:
    for task in tasks(seed):
        lower, upper = task.bounds(np.array(piece_s))
        unit_mps = task.unit_mps2 * piece_s
        acceleration, jerk, before, after = (slice(*COUNTS[i : i + 2]) for i in range(4))
        for bound, limit in ((lower, task.limits[0]), (upper, task.limits[1])):
            assert bound[acceleration] * task.unit_mps2 == pytest.approx(USED_SHARE * limit)
        most_mps3 = USED_SHARE * task.limits.jerk_max_mps3
        assert upper[jerk] * task.unit_mps2 / piece_s == pytest.approx(most_mps3)
        assert lower[jerk] * task.unit_mps2 / piece_s == pytest.approx(-most_mps3)
        for rows, speeds_mps in ((before, task.speed_before_mps), (after, task.speed_after_mps)):
            assert lower[rows] * unit_mps == pytest.approx(speeds_mps[0] + MARGIN_MPS)
            assert upper[rows] * unit_mps == pytest.approx(speeds_mps[1] - MARGIN_MPS)
        end_m = upper[bspline.END_ROW] * unit_mps * piece_s
        assert end_m == pytest.approx(task.end_max_m - MARGIN_M)
        assert lower[bspline.END_ROW] == -math.inf


@given(st.integers(0, 500), PIECES_S, st.floats(0.5, 4.0))
def test_the_unit_of_acceleration_does_not_matter(seed: int, piece_s: float, factor: float) -> None:
    """Parameters and bounds are in units: another unit scales all of them alike."""
    task, _ = tasks(seed)
    other = dataclasses.replace(task, unit_mps2=factor * task.unit_mps2)
    piece = np.array(piece_s)
    np.testing.assert_allclose(other.parameters(piece) * factor, task.parameters(piece))
    for bound, scaled in zip(task.bounds(piece), other.bounds(piece), strict=True):
        np.testing.assert_allclose(scaled * factor, bound)
    assert other.cost_unit(piece) == pytest.approx(factor * factor * task.cost_unit(piece))


def test_the_cost_of_a_solution_is_in_si_units() -> None:
    """The objective of the QP, back in m²/s³, is effort less what the progress saves."""
    matrices, piece_s = bspline.TwoPhaseSpline.with_ratio(1.0), np.array(0.2)
    task, _ = tasks(3)
    program = build(matrices, task, piece_s)
    optimum = Solver(matrices.hessian, matrices.rows).solve(
        program.gradient, program.lower, program.upper
    )
    assert optimum is not None
    nodes = task.unit_mps2 * matrices.accelerations(optimum.variables, program.ends)
    a, b = nodes[:-1], nodes[1:]
    effort = float(((a * a + a * b + b * b) / 3.0) @ (matrices.durations * 0.2))
    end_m = optimum.variables[bspline.END_POSITION] * task.unit_mps2 * 0.2 * 0.2
    expected = effort - task.progress_gain_mps3 * end_m
    assert program.cost(optimum.objective) == pytest.approx(expected, rel=1e-6)


def test_lift_adds_acceleration_and_nothing_else() -> None:
    task, _ = tasks(5)
    lifted = task.lifted(1.2)
    assert lifted.limits == task.limits.scaled(1.2)
    assert dataclasses.replace(lifted, limits=task.limits) == task


def test_the_task_along_the_leg() -> None:
    problem = draw(Random(8), Variety())
    task, x_m = along_task(problem, clear=False), problem.start.position_leg_m[0]
    assert task.crossing_m == (-math.inf, problem.region.keep_out.x_min_m - x_m)
    assert task.end_max_m == problem.region.x_pob_m - x_m
    assert task.speed_before_mps == task.speed_after_mps == (0.0, problem.envelope.speed_max_mps)
    assert task.end_speed_mps == problem.exit_speed_mps
    assert task.progress_gain_mps3 == DELAY_COST_M2PS4 / problem.exit_speed_mps
    assert along_task(problem, clear=True).crossing_m == (-math.inf, math.inf)


def test_the_task_across_is_mirrored_for_the_left_side() -> None:
    problem = draw(Random(8), Variety(lopsided=True))
    region, (_, y_m, _) = problem.region, problem.start.position_leg_m
    right, left = (across_task(problem, side, clear=False) for side in ("right", "left"))
    assert right.crossing_m[0] == region.keep_out.y_max_m - y_m
    assert left.crossing_m[0] == y_m - region.keep_out.y_min_m
    assert right.end_max_m == region.lane_right_m - y_m
    assert left.end_max_m == y_m - region.lane_left_m
    assert left.start.velocity_mps == -right.start.velocity_mps
    assert left.limits == right.limits.mirrored()
    assert left.end_speed_mps == right.end_speed_mps == 0.0
    assert left.progress_gain_mps3 == 0.0


def test_who_is_clear_already_may_not_come_back() -> None:
    problem = draw(Random(8), Variety())
    clear = across_task(problem, "right", clear=True)
    assert clear.crossing_m == (-math.inf, math.inf)
    assert clear.speed_before_mps[0] == clear.speed_after_mps[0] == 0.0
    blocked = across_task(problem, "right", clear=False)
    assert blocked.speed_before_mps[0] < 0.0


def test_passive_safety_limits_the_lateral_speed() -> None:
    safe = draw(Random(12), Variety(passive_safety=True))
    task, sidestep = across_task(safe, "right", clear=False), safe.sidestep("right")
    assert math.isfinite(sidestep.speed_max_mps)
    assert task.speed_after_mps == (0.0, sidestep.speed_max_mps)
    assert task.speed_before_mps == (-sidestep.speed_max_mps, sidestep.speed_max_mps)


@given(st.integers(0, 500), st.floats(0.0, 6.0))
def test_a_profile_to_a_speed_begins_at_the_origin(seed: int, speed_mps: float) -> None:
    task, _ = tasks(seed)
    profile = task.profile_to(speed_mps)
    assert profile.position_m == 0.0
    assert profile.final.velocity_mps == pytest.approx(speed_mps, abs=1e-6)
    assert task.braking.final.velocity_mps == pytest.approx(0.0, abs=1e-6)
