"""In flight the set grows, moves along and never holds a point of a true obstacle."""

from pathlib import Path

import numpy as np
import pytest

from gcs_tools.scenario import load_scenario
from onboard.files.obstacle_field import ObstacleField
from onboard.geometry.frames import FloatArray
from onboard.guidance.phases import Phase
from onboard.recording.state import state_of
from sitl.virtual.simulation import SimulatedFlight, Simulation

CONFIG = Path(__file__).parents[3] / "config"
TICKS_BETWEEN = 20
PER_SIDE = 25


def points_ned_m(field: ObstacleField) -> FloatArray:
    """Return points in and on the edge of every obstacle, (n, 3)."""
    share = np.linspace(-1.0, 1.0, PER_SIDE)
    unit = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    points = []
    for center_m, half_m, yaw_rad in zip(
        field.center_ned_m, field.half_size_m, field.yaw_rad, strict=True
    ):
        x_m, y_m = (unit * half_m).T
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        north_m = center_m[0] + cosine * x_m - sine * y_m
        east_m = center_m[1] + sine * x_m + cosine * y_m
        points.append(np.stack((north_m, east_m, np.zeros_like(x_m)), axis=1))
    return np.concatenate(points)


@pytest.mark.parametrize(
    "name",
    [
        "paper",
        "scenarios/ardupilot_three_obstacles",
        "scenarios/mission_changed",
    ],
)
def test_no_point_of_an_obstacle_is_ever_free(name: str) -> None:
    scenario = load_scenario(CONFIG / f"{name}.yaml")
    simulation = Simulation(
        SimulatedFlight(
            scenario.contract,
            scenario.mission,
            scenario.sitl_config(seed=1),
            scenario.obstacles,
            faults=scenario.faults,
            time_limit_s=100.0,
        )
    )
    points = points_ned_m(scenario.obstacles)
    largest = checks = 0
    while not simulation.over:
        simulation.advance()
        autonomy = simulation.autonomy
        if round(simulation.now_s / 0.02) % TICKS_BETWEEN or not autonomy.supervisor.seen.size:
            continue
        space = autonomy.supervisor.seen
        x_m, y_m, _ = autonomy.navigator.leg.position_leg_from_ned(points).T
        free = space.grid().are_free(x_m, x_m, y_m, y_m)
        assert not free.any(), (simulation.now_s, points[free])
        checks += autonomy.navigator.phase in (Phase.CRUISE, Phase.AVOID)
        size = state_of(autonomy, simulation.now_s).free_cells
        assert size == space.size
        largest = max(largest, size)
    # It was there to be wrong: seen in flight, and as large as a view.
    assert checks > 10
    assert largest > 5000
