"""The collision set by numerical reachability: Hamilton-Jacobi on a grid, with `hj_reachability`.

The state is (x, ẋ, y, ẏ) in front of a face at x = 0, |y| < S/2.  The avoid tube of the face is cut
at cruise speed and no lateral speed, where the paper draws its boundary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import hj_reachability as hj
import jax
import jax.numpy as jnp
import numpy as np

from onboard.contract.agility import AccelerationLimits
from onboard.geometry.frames import FloatArray


class DoubleIntegrators(hj.ControlAndDisturbanceAffineDynamics):  # type: ignore[misc]  # untyped
    """Eq. 5: two chains of integrators; the control avoids, nothing disturbs."""

    def __init__(self, limits: AccelerationLimits) -> None:
        least = jnp.array([-limits.brake_mps2, -limits.left_mps2])
        most = jnp.array([limits.forward_mps2, limits.right_mps2])
        nothing = hj.sets.Box(jnp.zeros(1), jnp.zeros(1))
        super().__init__("max", "min", hj.sets.Box(least, most), nothing)

    def open_loop_dynamics(self, state: Any, _time: Any) -> Any:
        """Positions follow velocities."""
        _, speed_mps, _, lateral_mps = state
        return jnp.array([speed_mps, 0.0, lateral_mps, 0.0])

    def control_jacobian(self, _state: Any, _time: Any) -> Any:
        """Inputs are accelerations."""
        return jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])

    def disturbance_jacobian(self, _state: Any, _time: Any) -> Any:
        """Nothing disturbs."""
        return jnp.zeros((4, 1))


@cache
def dynamics_of(limits: AccelerationLimits) -> DoubleIntegrators:
    """The same object for the same limits: the solver is compiled once for each object."""
    return DoubleIntegrators(limits)


@dataclass(frozen=True)
class GridProblem:
    """A face to be avoided, and the grid on which that is computed.

    Attributes:
        limits: of the accelerations.
        speed_mps: at which the boundary is wanted.
        width_m: of the face.
        cells: across the face; a cell is as long along x.
        speed_cells, lateral_cells: of the two velocities.
    """

    limits: AccelerationLimits
    speed_mps: float
    width_m: float
    cells: int = 16
    speed_cells: int = 13
    lateral_cells: int = 17

    @property
    def cell_m(self) -> float:
        """Resolution in both positions."""
        return self.width_m / self.cells

    @property
    def horizon_s(self) -> float:
        """A time by which everything is decided: stopped, or clear from the worst point."""
        both_mps2 = self.limits.left_mps2 + self.limits.right_mps2
        clear_s = math.sqrt(2.0 * self.width_m / both_mps2)
        return 1.1 * min(clear_s, self.speed_mps / self.limits.brake_mps2)

    def grid(self) -> Any:
        """The grid, just large enough for the vehicles that matter."""
        lateral_mps = 1.15 * max(self.limits.left_mps2, self.limits.right_mps2) * self.horizon_s
        braked_mps = max(self.speed_mps - self.limits.brake_mps2 * self.horizon_s, 0.0)
        reach_m = 0.65 * (self.speed_mps + braked_mps) * self.horizon_s + 2.0 * self.cell_m
        behind_m, half_m = 3.0 * self.cell_m, 0.9 * self.width_m
        low = np.array([-reach_m, -0.35 * self.speed_mps, -half_m, -lateral_mps])
        high = np.array([behind_m, 1.12 * self.speed_mps, half_m, lateral_mps])
        shape = (
            round((reach_m + behind_m) / self.cell_m) + 1,
            self.speed_cells,
            round(2.0 * half_m / self.cell_m) + 1,
            self.lateral_cells,
        )
        return hj.Grid.from_lattice_parameters_and_boundary_conditions(
            hj.sets.Box(low, high), shape
        )

    def depths(self, y_m: FloatArray) -> FloatArray:
        """Depth of the collision set in front of the face at each y, from its middle [m]."""
        grid = self.grid()
        face = jnp.maximum(-grid.states[..., 0], jnp.abs(grid.states[..., 2]) - self.width_m / 2.0)
        settings = hj.SolverSettings.with_accuracy(
            "medium", hamiltonian_postprocessor=hj.solver.backwards_reachable_tube
        )
        values = hj.step(
            settings,
            dynamics_of(self.limits),
            grid,
            0.0,
            face,
            -self.horizon_s,
            progress_bar=False,
        )
        x_m = np.linspace(float(grid.domain.lo[0]), 0.0, 1001)
        return np.array([self._depth(grid, values, x_m, each_m) for each_m in y_m.tolist()])

    def _depth(self, grid: Any, values: Any, x_m: FloatArray, y_m: float) -> float:
        states = np.zeros((len(x_m), 4))
        states[:, 0], states[:, 1], states[:, 2] = x_m, self.speed_mps, y_m
        along = jax.vmap(lambda state: grid.interpolate(values, state))(jnp.asarray(states))
        inside = np.flatnonzero(np.asarray(along) <= 0.0)
        return -float(x_m[inside[0]]) if len(inside) else 0.0
