"""The certifier of ways to rest, against dense sampling of the body and of its run-on.

``REST_TRAJECTORIES=100000 pytest tests/onboard/planning/test_rest_certifier.py`` tries that many.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_tools.benchmark.run_on_models import coasting_run_on, frozen_run_on
from onboard.contract.run_on import NO_RUN_ON, RunOn
from onboard.geometry.frames import FloatArray
from onboard.geometry.free_grid import FreeGrid
from onboard.motion.trajectory import State, Trajectory
from onboard.planning import rest_certifier
from onboard.planning.corridor.horizon import PIECES, Horizon, JerkMaps
from onboard.planning.rest_certifier import RestLimits, certify_rest, has_room

COUNT = int(os.environ.get("REST_TRAJECTORIES", "300"))
CELL_M, SIDE = 0.1, 240
CORNER_M = (-12.0, -12.0)
RUN_ONS = (
    NO_RUN_ON,
    coasting_run_on(
        0.2, lag_s=0.19, brake_mps2=2.63, speed_max_mps=2.8, acceleration_max_mps2=2.63
    ),
    frozen_run_on(1.14, gain_per_s=0.95, velocity_gain_per_s=1.8),
)
MAPS = JerkMaps(NO_RUN_ON)
LIMITS = RestLimits(0.3, 30.0, (30.0,) * 4, math.inf, 60.0, NO_RUN_ON)


@dataclass(frozen=True)
class Case:
    """A random plan in a random grid."""

    horizon: Horizon
    unknown: NDArray[np.bool_]
    run_on: RunOn
    radius_m: float

    @property
    def grid(self) -> FreeGrid:
        table = np.zeros((SIDE + 1, SIDE + 1), np.int32)
        table[1:, 1:] = self.unknown.cumsum(axis=0).cumsum(axis=1)
        return FreeGrid(CORNER_M, CELL_M, table)

    @property
    def accepted(self) -> bool:
        limits = replace(LIMITS, body_radius_m=self.radius_m, run_on=self.run_on)
        plan = self.horizon.trajectory(-5.0)
        return certify_rest(plan, plan.sample(0.0), 0.0, limits, self.grid).valid

    def touches(self) -> bool:
        """Tell whether a sampled place of the body, or of its run-on, is in an unknown cell."""
        t = np.linspace(0.0, 0.2, 9)[None, :, None]
        p, v, a = (self.horizon.nodes[:-1, k, None, :] for k in range(3))
        j = self.horizon.jerk_mps3[:, None, :]
        place = p + v * t + a * t**2 / 2.0 + j * t**3 / 6.0
        speed, pull = v + a * t + j * t**2 / 2.0, a + j * t
        places = [place] + [place + k * speed + c * pull for k, c in self.run_on.gains]
        angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
        rim = self.radius_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
        points = (np.stack(places)[..., None, :] + rim).reshape(-1, 2)
        cells = np.floor((points - CORNER_M) / CELL_M).astype(int)
        inside = ((cells >= 0) & (cells < SIDE)).all(axis=1)
        return not inside.all() or bool(self.unknown[tuple(cells.T)].any())


def cases(count: int) -> Iterator[Case]:
    """Yield plans of some metres that end at rest, between a few unknown rectangles."""
    rng = np.random.default_rng(18)
    for number in range(count):
        start = np.zeros((3, 2))
        start[0], start[1] = rng.uniform(-1.0, 1.0, 2), rng.uniform(-2.0, 2.0, 2)
        jerk = np.zeros((PIECES, 2))
        jerk[:10] = rng.uniform(-6.0, 6.0, (10, 2))
        for axis in (0, 1):
            jerk[:, axis] = MAPS.ending_at_rest(start[:, axis], jerk[:, axis])
        unknown = np.zeros((SIDE, SIDE), bool)
        for _ in range(int(rng.integers(4, 20))):
            i, j = rng.integers(0, SIDE, 2)
            height, width = rng.integers(1, 12, 2)
            unknown[i : i + height, j : j + width] = True
        yield Case(
            Horizon.integrated(0.0, start, jerk),
            unknown,
            RUN_ONS[number % len(RUN_ONS)],
            float(rng.uniform(0.05, 0.5)),
        )


def false_accepts(count: int) -> tuple[int, int]:
    """Return how many plans were accepted, and how many of them touch unknown space."""
    accepted = false = 0
    for case in cases(count):
        if case.accepted:
            accepted += 1
            false += case.touches()
    return accepted, false


def test_what_is_accepted_never_touches_unseen_space() -> None:
    accepted, false = false_accepts(COUNT)
    assert accepted > COUNT / 10
    assert false == 0


def test_most_of_what_is_refused_does_touch_it() -> None:
    refused = [case for case in cases(300) if not case.accepted]
    assert len(refused) > 40
    assert sum(case.touches() for case in refused) > 0.6 * len(refused)


@pytest.mark.parametrize(
    "run_on",
    [
        RunOn(((math.nan, 0.0), (0.5, 0.2), (math.nan, 0.2))),
        RunOn(((0.5, 0.0), (0.5, math.nan))),
        RunOn(((0.5, 0.0), (math.inf, 0.2))),
    ],
)
def test_a_run_that_is_unknown_certifies_nothing_and_raises_nothing(run_on: RunOn) -> None:
    """Above the speed at which it was measured it is not a number."""
    assert len(run_on.strips) == 1
    everywhere_free = np.zeros((SIDE, SIDE), bool)
    for case in cases(3):
        free = replace(case, unknown=everywhere_free)
        assert replace(free, run_on=RUN_ONS[1]).accepted
        assert not replace(free, run_on=run_on).accepted


@pytest.mark.parametrize("loosened", ["body", "first_pieces", "run_on"])
def test_a_loosened_certifier_is_found_out(loosened: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sound = rest_certifier._are_free

    def loose(
        points: FloatArray,
        strips: tuple[tuple[tuple[float, float], ...], ...],
        grown_m: float,
        grid: FreeGrid,
    ) -> NDArray[np.bool_]:
        if loosened == "body":
            return sound(points, strips, 0.8 * grown_m, grid)
        if loosened == "run_on":
            return sound(points, tuple(strip[:1] for strip in strips), grown_m, grid)
        free = sound(points, strips, grown_m, grid)
        free[10:] = True
        return free

    monkeypatch.setattr(rest_certifier, "_are_free", loose)
    _, false = false_accepts(300)
    assert false > 0


def standing() -> tuple[Trajectory, State]:
    plan = Horizon.at_rest(0.0, 0.0, 0.0).trajectory(-5.0)
    return plan, plan.sample(0.0)


def all_free() -> FreeGrid:
    return FreeGrid(CORNER_M, CELL_M, np.zeros((SIDE + 1, SIDE + 1), np.int32))


def test_standing_in_free_space_is_a_way_to_rest() -> None:
    plan, start = standing()
    assert certify_rest(plan, start, 0.0, LIMITS, all_free()).valid


def test_there_is_room_for_a_larger_body_as_far_as_the_space_is_free() -> None:
    plan, _ = standing()
    x_m, y_m = (plan.position_leg_m[0, axis] for axis in (0, 1))
    unknown = np.zeros((SIDE, SIDE), np.int32)
    unknown[int((x_m - CORNER_M[0]) / CELL_M) + 8, int((y_m - CORNER_M[1]) / CELL_M)] = 1
    table = np.zeros((SIDE + 1, SIDE + 1), np.int32)
    table[1:, 1:] = unknown.cumsum(axis=0).cumsum(axis=1)
    grid = FreeGrid(CORNER_M, CELL_M, table)
    assert has_room(plan, replace(LIMITS, body_radius_m=6.0 * CELL_M), grid)
    assert not has_room(plan, replace(LIMITS, body_radius_m=9.0 * CELL_M), grid)


def moving(limit: str) -> RestLimits:
    """Limits of which one is too tight for the plan below."""
    limits = {
        "speed": replace(LIMITS, speed_max_mps=0.1),
        "braking": replace(LIMITS, acceleration_max_mps2=(0.1, 30.0, 30.0, 30.0)),
        "forward": replace(LIMITS, acceleration_max_mps2=(30.0, 0.1, 30.0, 30.0)),
        "leftward": replace(LIMITS, acceleration_max_mps2=(30.0, 30.0, 0.1, 30.0)),
        "rightward": replace(LIMITS, acceleration_max_mps2=(30.0, 30.0, 30.0, 0.1)),
        "tilt": replace(LIMITS, acceleration_disc_mps2=0.1),
        "jerk": replace(LIMITS, jerk_max_mps3=0.1),
    }
    return limits[limit]


def swaying() -> Horizon:
    jerk = np.zeros((PIECES, 2))
    jerk[0] = 3.0
    for axis in (0, 1):
        jerk[:, axis] = MAPS.ending_at_rest(np.zeros(3), jerk[:, axis])
    return Horizon.integrated(0.0, np.zeros((3, 2)), jerk)


@pytest.mark.parametrize(
    "limit", ["speed", "braking", "forward", "leftward", "rightward", "tilt", "jerk"]
)
def test_every_limit_of_the_motion_is_checked(limit: str) -> None:
    plan = swaying().trajectory(-5.0)
    start = plan.sample(0.0)
    assert certify_rest(plan, start, 0.0, LIMITS, all_free()).valid
    (failure,) = certify_rest(plan, start, 0.0, moving(limit), all_free()).failures
    assert failure.startswith(limit)


def test_a_plan_that_does_not_end_at_rest_is_refused() -> None:
    start = np.array(((0.0, 0.0), (0.5, 0.0), (0.0, 0.0)))
    plan = Horizon.integrated(0.0, start, np.zeros((PIECES, 2))).trajectory(-5.0)
    (failure,) = certify_rest(plan, plan.sample(0.0), 0.0, LIMITS, all_free()).failures
    assert "not at rest" in failure


def test_a_plan_that_does_not_continue_the_state_is_refused() -> None:
    plan, start = standing()
    aside = State((0.01, 0.0, -5.0), start.velocity_leg_mps, start.acceleration_leg_mps2)
    assert not certify_rest(plan, aside, 0.0, LIMITS, all_free()).valid
    assert not certify_rest(plan, start, 0.2, LIMITS, all_free()).valid


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_refused(value: float) -> None:
    nodes = swaying().nodes.copy()
    nodes[4, 0, 0] = value
    with pytest.raises(ValueError, match="finite"):
        Horizon(0.0, nodes, swaying().jerk_mps3).trajectory(-5.0)


def hover_among(
    unknown: tuple[int, int], free_disc: tuple[float, float, float] | None = None
) -> bool:
    """Tell whether a hover at the origin certifies, with one unknown cell, counted from there."""
    cells = np.zeros((SIDE, SIDE), bool)
    cells[SIDE // 2 + unknown[0], SIDE // 2 + unknown[1]] = True
    case = Case(Horizon.at_rest(0.0, 0.0, 0.0), cells, NO_RUN_ON, 0.5)
    limits = replace(LIMITS, body_radius_m=0.5)
    plan, grid = case.horizon.trajectory(0.0), replace(case.grid, free_disc=free_disc)
    return certify_rest(plan, plan.sample(0.0), 0.0, limits, grid).valid


def test_only_the_disc_of_the_body_has_to_be_free_not_its_square() -> None:
    corner = int(0.45 / CELL_M)
    assert hover_among((corner, corner))
    assert hover_among((-corner - 1, corner))
    assert not hover_among((corner, 0))
    assert not hover_among((int(0.35 / CELL_M), int(0.34 / CELL_M)))


def test_a_disc_that_is_free_besides_counts_as_a_whole_only() -> None:
    assert not hover_among((0, 0))
    assert hover_among((0, 0), free_disc=(0.0, 0.0, 0.51))
    assert not hover_among((0, 0), free_disc=(0.0, 0.0, 0.49))
    assert not hover_among((0, 0), free_disc=(0.02, 0.0, 0.51))


def test_a_plan_that_leaves_the_grid_is_refused() -> None:
    plan = Horizon.at_rest(0.0, 11.9, 0.0).trajectory(-5.0)
    assert not certify_rest(plan, plan.sample(0.0), 0.0, LIMITS, all_free()).valid
