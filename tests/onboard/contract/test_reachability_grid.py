"""The closed form of the boundary agrees with numerical reachability, within a cell of its grid."""

from __future__ import annotations

import numpy as np
import pytest

from onboard.contract.agility import AccelerationLimits
from onboard.contract.arithmetic import SCALAR
from onboard.contract.region import boundary_depth_at, dimensions
from onboard.geometry.box import Box
from tests.onboard.contract.grid_reachability import GridProblem
from tests.onboard.contract.ideal_encounter import ideal_encounter

FLAT = GridProblem(AccelerationLimits(2.6286, 2.6286, 2.7213, 2.7213), 2.8, 4.0)
POINTED = GridProblem(AccelerationLimits(2.6286, 2.6286, 2.7213, 2.7213), 4.5, 4.0)
LOPSIDED = GridProblem(AccelerationLimits(2.0, 3.0, 1.0, 2.5), 3.0, 3.0)


@pytest.mark.parametrize(
    ("problem", "flat"),
    [(FLAT, True), (POINTED, False), (LOPSIDED, False)],
    ids=["flat", "pointed", "lopsided"],
)
def test_boundary_agrees_with_the_grid(problem: GridProblem, flat: bool) -> None:
    half_m = problem.width_m / 2.0
    y_m = np.linspace(-0.9 * half_m, 0.9 * half_m, 19)
    face = Box(0.0, 1.0, -half_m, half_m)
    exact_m = [
        boundary_depth_at(float(each_m), face, problem.limits, problem.speed_mps) for each_m in y_m
    ]
    numerical_m = problem.depths(y_m)
    np.testing.assert_allclose(numerical_m, exact_m, atol=problem.cell_m)
    # Fine enough to tell a forgotten factor 2 from the truth.
    e = ideal_encounter(problem.limits, problem.speed_mps, (1.0, problem.width_m))
    size = dimensions(e, SCALAR)
    assert size.flat == flat
    assert numerical_m.max() == pytest.approx(size.collision_set_depth_m, abs=problem.cell_m)
    assert problem.cell_m < 0.2 * size.collision_set_depth_m
