"""Motion over the horizon: integration, and the linear maps that the QPs use."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs_tools.benchmark.run_on_models import frozen_run_on
from onboard.contract.run_on import NO_RUN_ON
from onboard.geometry.frames import FloatArray
from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon, JerkMaps, state_of

RUN_ON = frozen_run_on(1.14, gain_per_s=0.95, velocity_gain_per_s=1.8)
MAPS = JerkMaps(RUN_ON)
jerks = arrays(np.float64, (PIECES, 2), elements=st.floats(-6.0, 6.0))
starts = arrays(np.float64, (3, 2), elements=st.floats(-3.0, 3.0))


@given(starts, jerks)
def test_the_trajectory_joins_and_passes_the_nodes(
    start: FloatArray,
    jerk: FloatArray,
) -> None:
    plan = Horizon.integrated(3.0, start, jerk)
    trajectory = plan.trajectory(-5.0)
    for end, begin in zip(trajectory.ends, trajectory.motion, strict=False):
        assert end[:-1] == pytest.approx(begin[1:], abs=1e-9)
    assert state_of(trajectory.sample(3.0 + 7 * PIECE_S)) == pytest.approx(plan.nodes[7], abs=1e-6)
    assert trajectory.sample(3.0).position_leg_m[2] == -5.0


@given(starts, jerks)
def test_the_maps_give_what_integration_gives(
    start: FloatArray,
    jerk: FloatArray,
) -> None:
    plan = Horizon.integrated(0.0, start, jerk)
    swept = plan.swept_m(RUN_ON).reshape(PIECES, 3, 4, 2)
    for axis in (0, 1):
        rows = MAPS.rows @ jerk[:, axis] + MAPS.free @ start[:, axis]
        for block in range(3):
            expected = swept[:, block, 1:, axis].ravel()
            assert rows[90 * block : 90 * (block + 1)] == pytest.approx(expected, abs=1e-6)
        assert rows[-2:] == pytest.approx(plan.nodes[-1, 1:, axis], abs=1e-6)
        speeds = MAPS.speeds_mps(start[:, axis], jerk[:, axis])
        assert rows[270 : 270 + speeds.size] == pytest.approx(speeds, abs=1e-9)
        assert speeds[PIECES:] == pytest.approx(plan.nodes[1:-1, 1, axis], abs=1e-6)


@given(starts, jerks)
def test_repaired_jerks_end_at_rest(
    start: FloatArray,
    jerk: FloatArray,
) -> None:
    for axis in (0, 1):
        jerk[:, axis] = MAPS.ending_at_rest(start[:, axis], jerk[:, axis])
    assert Horizon.integrated(0.0, start, jerk).nodes[-1, 1:] == pytest.approx(0.0, abs=1e-9)


def test_the_gradient_is_that_of_the_cost() -> None:
    rng = np.random.default_rng(1)
    start, targets, jerk = rng.normal(size=3), rng.normal(size=PIECES), rng.normal(size=PIECES)

    def cost(values: FloatArray) -> float:
        both = np.stack((values, values), axis=1)
        nodes = Horizon.integrated(0.0, np.stack((start, start), axis=1), both).nodes[1:, :, 0]
        far = ((nodes[:, 0] - targets) ** 2).sum()
        pull, effort = (nodes[:, 2] ** 2).sum(), (values**2).sum()
        return float(
            MAPS.TARGET_WEIGHT * far + MAPS.ACCELERATION_WEIGHT * pull + MAPS.JERK_WEIGHT * effort
        )

    slope = MAPS.hessian @ jerk + MAPS.gradient(start, targets)
    for k in range(0, PIECES, 7):
        step = np.zeros(PIECES)
        step[k] = 1e-4
        numeric = (cost(jerk + step) - cost(jerk - step)) / 2e-4
        assert slope[k] == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_the_next_node_is_the_same_plan_filled_up_with_rest() -> None:
    jerk = np.zeros((PIECES, 2))
    jerk[:6, 0] = 2.0
    start = np.zeros((3, 2))
    jerk[:, 0] = MAPS.ending_at_rest(start[:, 0], jerk[:, 0])
    plan = Horizon.integrated(1.0, start, jerk)
    after = plan.next_node()
    for time_s in (1.2, 2.05, 6.9):
        before_m = plan.trajectory(0.0).sample(time_s).position_leg_m
        assert after.trajectory(0.0).sample(time_s).position_leg_m == pytest.approx(before_m)
    assert after.start_s == pytest.approx(1.0 + PIECE_S)
    assert (after.nodes[-1, 1:] == 0.0).all()


def test_the_extent_holds_the_path() -> None:
    rng = np.random.default_rng(2)
    plan = Horizon.integrated(0.0, rng.normal(size=(3, 2)), rng.normal(size=(PIECES, 2)))
    low, high = plan.extent_m
    trajectory = plan.trajectory(0.0)
    for piece in range(PIECES):
        for share in np.linspace(0.0, 1.0, 11)[:-1].tolist():
            place = trajectory.sample((piece + share) * PIECE_S).position_leg_m[:2]
            assert (np.array(place) >= low[piece] - 1e-9).all()
            assert (np.array(place) <= high[piece] + 1e-9).all()


def test_without_run_on_only_the_path_is_bounded() -> None:
    assert len(JerkMaps(NO_RUN_ON).rows) == len(MAPS.rows) - 2 * 3 * PIECES
