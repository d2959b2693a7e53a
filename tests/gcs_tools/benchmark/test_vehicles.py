"""What the vehicles run on to after a loss of the stream."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.benchmark.obstacles import Floats
from gcs_tools.benchmark.vehicles import vehicles
from onboard.contract.run_on import RunOn


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_loss_stays_within_the_run_on_that_is_certified(name: str) -> None:
    vehicle = vehicles()[name]
    assert vehicle.after_loss is not None
    rng = np.random.default_rng(3)
    for _ in range(200):
        state = rng.normal(size=(3, 2))
        state[1] *= 2.8 / max(2.8, float(np.hypot(*state[1])))
        state[2] *= 2.63 / max(2.63, float(np.hypot(*state[2])))
        low, high = hull(state, vehicle.run_on)
        run = vehicle.after_loss(state)
        assert (run >= low - 0.02).all()
        assert (run <= high + 0.02).all()


def hull(state: Floats, run_on: RunOn) -> tuple[Floats, Floats]:
    points = [state[0]] + [state[0] + k * state[1] + c * state[2] for k, c in run_on.gains]
    return np.min(points, axis=0), np.max(points, axis=0)
