"""The spline: its matrices are those of the motion that a trajectory integrates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.motion.trajectory import State, Trajectory
from onboard.planning.qp import bspline

RATIOS = st.floats(0.3, 6.0)
GROWTHS = st.sampled_from([1.0, 1.1, 1.2])


def test_the_spline_is_what_the_trajectory_integrates() -> None:
    matrices = bspline.TwoPhaseSpline.with_ratio(0.7, growth=1.2)
    rng = np.random.default_rng(59)
    free, ends = rng.normal(size=bspline.FREE), np.array([0.4, -0.3, 0.9])
    accelerations = matrices.accelerations(free, ends)
    nodes = np.stack((accelerations, accelerations, accelerations), axis=1)
    start = State((0.0, 0.0, 0.0), (0.4, 0.4, 0.4), (-0.3, -0.3, -0.3))
    trajectory = Trajectory.from_accelerations(0.0, start, matrices.durations, nodes)
    assert accelerations[0] == pytest.approx(-0.3)
    assert trajectory.final.velocity_leg_mps[0] == pytest.approx(0.9)
    assert trajectory.final.acceleration_leg_mps2[0] == pytest.approx(0.0, abs=1e-9)
    rows = matrices.rows @ free + matrices.rows_from_parameters @ ends
    assert trajectory.final.position_leg_m[0] == pytest.approx(rows[bspline.END_ROW])
    crossing = trajectory.sample(float(bspline.PIECES)).position_leg_m[0]
    assert crossing == pytest.approx(rows[bspline.CROSSING_ROW])
    counts = np.cumsum((0, *bspline.ROW_COUNTS))
    np.testing.assert_allclose(rows[counts[1] : counts[2]], trajectory.jerk_leg_mps3[:, 0])
    # Velocity control points bound the velocity that they govern.
    low, high = trajectory.velocity_range_mps(0)
    points = [*rows[counts[2] : counts[4]], 0.4, 0.9, trajectory.sample(0.1).velocity_leg_mps[0]]
    assert min(points) <= low + 0.05
    assert max(points) >= high - 0.05
    # And the objective is half the integral of the squared acceleration.
    a, b = accelerations[:-1], accelerations[1:]
    energy = float(((a * a + a * b + b * b) / 3.0) @ matrices.durations)
    objective = free @ matrices.hessian @ free / 2.0
    objective += free @ matrices.gradient_from_parameters @ ends
    constant = ends @ matrices.energy_of_parameters @ ends
    assert 2.0 * objective + constant == pytest.approx(energy)


@given(RATIOS, GROWTHS)
@settings(max_examples=30)
def test_the_crossing_parts_the_phases_in_their_ratio(ratio: float, growth: float) -> None:
    durations = bspline.TwoPhaseSpline.with_ratio(ratio, growth).durations
    assert durations.shape == (bspline.TOTAL_PIECES,)
    first, second = durations[: bspline.PIECES], durations[bspline.PIECES :]
    assert first.sum() == pytest.approx(bspline.PIECES)
    assert second.sum() == pytest.approx(ratio * bspline.PIECES)
    np.testing.assert_allclose(first[1:] / first[:-1], growth)
    np.testing.assert_allclose(second, ratio * first)


@given(RATIOS, GROWTHS)
@settings(max_examples=30)
def test_shapes_and_definiteness(ratio: float, growth: float) -> None:
    matrices = bspline.TwoPhaseSpline.with_ratio(ratio, growth)
    free, rows = bspline.FREE, bspline.ROWS
    assert matrices.hessian.shape == (free, free)
    assert matrices.rows.shape == (rows, free)
    assert matrices.rows_from_parameters.shape == (rows, 3)
    assert matrices.node_accelerations.shape == (bspline.TOTAL_PIECES + 1, free)
    np.testing.assert_allclose(matrices.hessian, matrices.hessian.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrices.hessian).min() > 0.0


@given(RATIOS, GROWTHS, st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_the_quadratic_form_is_the_integral_of_the_square(
    ratio: float, growth: float, seed: int
) -> None:
    matrices = bspline.TwoPhaseSpline.with_ratio(ratio, growth)
    rng = np.random.default_rng(seed)
    free, ends = rng.normal(size=bspline.FREE), rng.normal(size=3)
    nodes = matrices.accelerations(free, ends)
    a, b = nodes[:-1], nodes[1:]
    energy = float(((a * a + a * b + b * b) / 3.0) @ matrices.durations)
    form = free @ matrices.hessian @ free + 2.0 * free @ matrices.gradient_from_parameters @ ends
    form += ends @ matrices.energy_of_parameters @ ends
    assert form == pytest.approx(energy, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("ends", [(0.7, 0.0, 0.7), (-1.2, 0.0, -1.2)])
def test_coasting_costs_nothing_and_is_found(ends: tuple[float, float, float]) -> None:
    matrices, parameters = bspline.TwoPhaseSpline.with_ratio(2.0), np.array(ends)
    free = -np.linalg.solve(matrices.hessian, matrices.gradient_from_parameters @ parameters)
    np.testing.assert_allclose(matrices.accelerations(free, parameters), 0.0, atol=1e-9)
    rows = matrices.rows @ free + matrices.rows_from_parameters @ parameters
    assert rows[bspline.CROSSING_ROW] == pytest.approx(ends[0] * bspline.PIECES)
    assert rows[bspline.END_ROW] == pytest.approx(ends[0] * matrices.durations.sum())


def test_rows_are_counted_as_they_are_stacked() -> None:
    assert sum(bspline.ROW_COUNTS) == bspline.ROWS
    assert (bspline.CROSSING_ROW, bspline.END_ROW) == (bspline.ROWS - 2, bspline.ROWS - 1)
    assert bspline.END_POSITION == bspline.FREE - 1
