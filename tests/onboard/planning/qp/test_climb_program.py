"""The coupled QP: rising buys lateral acceleration, within the height band and the thrust."""

from __future__ import annotations

import dataclasses
from random import Random

import numpy as np
import pytest

from onboard.contract.agility import GRAVITY_MPS2
from onboard.geometry.frames import FloatArray
from onboard.planning.problem import AvoidanceProblem
from onboard.planning.qp import bspline
from onboard.planning.qp.axis_program import AxisTask, across_task, along_task
from onboard.planning.qp.climb_program import ClimbProgram, coupling_of, vertical_task
from onboard.planning.qp.crossing_times import crossing_times
from onboard.planning.qp.solver import QpBackend, solver_of
from tests.onboard.planning.avoidance_cases import Variety, draw

MATRICES = bspline.TwoPhaseSpline.with_ratio(1.6)


def climbing(seed: int, *, preferred: bool = True) -> AvoidanceProblem:
    problem = draw(Random(seed), Variety(drift=False))
    return dataclasses.replace(problem, climb_m=1.0, climb_preferred=preferred)


def solved(
    problem: AvoidanceProblem, backend: QpBackend = "osqp"
) -> tuple[FloatArray | None, AxisTask, AxisTask, float]:
    along = along_task(problem, clear=False)
    across = across_task(problem, "right", clear=False)
    times_s = crossing_times(along, across, 5).times_s
    piece_s = float(times_s[2]) / bspline.PIECES
    program = ClimbProgram(MATRICES, coupling_of(problem, along, across), solver_of(backend))
    return program.solve(problem, along, across, piece_s), along, across, piece_s


SOLVABLE = tuple(seed for seed in range(12) if solved(climbing(seed))[0] is not None)


def test_most_problems_have_a_solution() -> None:
    assert len(SOLVABLE) >= 8


@pytest.mark.parametrize("seed", SOLVABLE[:6])
def test_horizontal_accelerations_stay_in_the_box_that_the_lift_gives(seed: int) -> None:
    nodes, along, across, _ = solved(climbing(seed))
    assert nodes is not None
    x, y, z = nodes.T
    lift = 1.0 - z / GRAVITY_MPS2
    for values, limits in ((x, along.limits), (y, across.limits)):
        assert (values <= limits.acceleration_max_mps2 * lift + 1e-2).all()
        assert (values >= limits.acceleration_min_mps2 * lift - 1e-2).all()


@pytest.mark.parametrize("seed", SOLVABLE[:6])
def test_the_height_stays_in_its_band_and_comes_back(seed: int) -> None:
    problem = climbing(seed)
    nodes, _, _, piece_s = solved(problem)
    assert nodes is not None
    durations_s = MATRICES.durations * piece_s
    z, height_m, speed_mps = nodes[:, 2], [0.0], 0.0
    for before, after, duration_s in zip(z[:-1], z[1:], durations_s, strict=True):
        step_m = duration_s * (speed_mps + duration_s * (2.0 * before + after) / 6.0)
        height_m.append(height_m[-1] + step_m)
        speed_mps += duration_s * (before + after) / 2.0
    assert min(height_m) >= -problem.climb_m - 1e-2
    assert max(height_m) <= 1e-2
    assert height_m[-1] >= -0.03
    assert speed_mps == pytest.approx(0.0, abs=1e-2)


def test_a_preferred_climb_rises_more() -> None:
    rises = {}
    for preferred in (False, True):
        nodes, *_ = solved(climbing(SOLVABLE[0], preferred=preferred))
        assert nodes is not None
        rises[preferred] = float(np.abs(nodes[:, 2]).max())
    assert rises[True] > rises[False]


def test_either_backend_finds_nearly_the_same() -> None:
    for seed in SOLVABLE[:3]:
        problem = climbing(seed)
        (approximate, *_), (exact, *_) = solved(problem), solved(problem, "daqp")
        assert approximate is not None
        assert exact is not None
        scale = float(np.abs(exact).max())
        assert float(np.abs(approximate - exact).mean()) < 0.1 * scale


def test_the_matrices_depend_on_limits_and_preference_alone() -> None:
    one, other = climbing(3), climbing(3, preferred=False)
    along, across = along_task(one, clear=False), across_task(one, "right", clear=False)
    assert coupling_of(one, along, across) == coupling_of(one, along, across)
    assert coupling_of(one, along, across).vertical_weight < 1.0
    assert coupling_of(other, along, across).vertical_weight == 1.0
    assert hash(coupling_of(one, along, across)) == hash(coupling_of(one, along, across))


def test_the_vertical_task_only_has_to_end_at_rest() -> None:
    problem = climbing(3)
    task = vertical_task(problem, 2.0)
    assert task.end_speed_mps == 0.0
    assert task.progress_gain_mps3 == 0.0
    assert task.unit_mps2 == 2.0
    assert task.limits[:2] == problem.envelope.vertical[:2]
    assert task.limits.jerk_max_mps3 < problem.envelope.vertical.jerk_max_mps3
