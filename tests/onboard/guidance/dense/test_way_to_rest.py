"""A plan replaces the one that is held only if it is certified, in time, and based on it."""

import math

import numpy as np
import pytest

from onboard.contract.run_on import NO_RUN_ON
from onboard.geometry.free_grid import FreeGrid
from onboard.guidance.dense.way_to_rest import WayToRest, largest_margin_m, moves
from onboard.guidance.reference import Reference
from onboard.motion.trajectory import State, Trajectory
from onboard.perception.seen_free import SeenFree
from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon
from onboard.planning.rest_certifier import RestLimits

LIMITS = RestLimits(0.5, 2.8, (2.6,) * 4, math.inf, 10.0, NO_RUN_ON)


@pytest.fixture
def grid() -> FreeGrid:
    seen = SeenFree()
    seen.confirm(0.0, 0.0, 6.0)
    return seen.grid()


@pytest.fixture
def way() -> WayToRest:
    way = WayToRest(Reference())
    way.begin(0.0, (0.0, 0.0, -0.5))
    return way


def forward(flown: Horizon, jerk_mps3: float = 1.0) -> Horizon:
    """Return a plan from the next node that moves ahead and comes to rest."""
    jerk = np.zeros((PIECES, 2))
    jerk[:16, 0] = np.repeat((jerk_mps3, -jerk_mps3, -jerk_mps3, jerk_mps3), 4)
    base = flown.next_node()
    return Horizon.integrated(base.start_s, base.start, jerk)


def adopted(way: WayToRest, grid: FreeGrid, now_s: float = 0.1) -> bool:
    assert way.flown is not None
    certificate = way.adopt(forward(way.flown), way.version, now_s, LIMITS, grid)
    return certificate is not None and certificate.valid


def test_a_certified_plan_takes_over_at_its_first_node(way: WayToRest, grid: FreeGrid) -> None:
    assert adopted(way, grid)
    assert way.decided
    assert not way.still
    assert not way.pass_nodes(0.19)
    assert way.pass_nodes(0.2)
    assert way.flown is not None
    assert moves(way.flown)
    assert not way.decided


@pytest.mark.parametrize("now_s", [0.0, 0.1, PIECE_S])
def test_the_reference_is_continuous_where_it_takes_over(
    way: WayToRest, grid: FreeGrid, now_s: float
) -> None:
    assert adopted(way, grid, now_s)
    reference = way._reference
    before, after = reference.sample(PIECE_S - 1e-9), reference.sample(PIECE_S + 1e-9)
    assert before is not None
    assert after is not None
    for one, other in zip(before, after, strict=True):
        assert one == pytest.approx(other, abs=1e-6)


def test_a_plan_that_is_late_is_dropped(way: WayToRest, grid: FreeGrid) -> None:
    assert way.flown is not None
    plan = forward(way.flown)
    assert way.adopt(plan, way.version, plan.start_s + 1e-6, LIMITS, grid) is None
    assert way.still


def test_a_plan_from_another_plan_than_the_one_flown_is_dropped(
    way: WayToRest, grid: FreeGrid
) -> None:
    assert way.flown is not None
    plan, version = forward(way.flown), way.version
    way.pass_nodes(PIECE_S)
    assert way.adopt(plan, version, PIECE_S, LIMITS, grid) is None


def test_a_plan_into_unseen_space_is_not_flown(way: WayToRest) -> None:
    seen = SeenFree()
    seen.confirm(0.0, 0.0, 1.0)
    assert not adopted(way, seen.grid())
    assert way.still


def test_without_a_new_plan_the_one_that_is_held_goes_on_to_rest(
    way: WayToRest, grid: FreeGrid
) -> None:
    assert adopted(way, grid)
    held = way._reference.upcoming
    assert held is not None
    for tick in range(1, 1000):
        way.pass_nodes(0.02 * tick)
    assert way.still
    state = way._reference.sample(20.0)
    assert state is not None
    assert state.position_leg_m == pytest.approx(held.final.position_leg_m)
    assert way._reference.current is not None
    assert way._reference.current.end_s > 20.0  # it rests, rather than coast on
    # For hours: the reference does not coast on by what round-off has left of its speed.
    later = way._reference.sample(36000.0)
    assert later is not None
    assert later.position_leg_m == pytest.approx(state.position_leg_m, abs=1e-9)


def test_the_margin_says_by_how_much_the_body_could_be_larger(way: WayToRest) -> None:
    seen = SeenFree()
    seen.confirm(0.0, 0.0, 1.05)
    way.recheck(LIMITS, seen.grid())
    assert (way.certified, way.margin_m) == (True, 0.2)
    way.recheck(LIMITS, SeenFree().grid())
    assert (way.certified, way.margin_m) == (False, None)


def test_a_shift_moves_all_that_is_held(way: WayToRest, grid: FreeGrid) -> None:
    assert adopted(way, grid)
    version = way.version
    way._reference.shift((1.0, 2.0, 0.3))
    way.shift((1.0, 2.0, 0.3))
    assert way.version != version, "work on the plan of before is dropped"
    way.pass_nodes(PIECE_S)
    assert way.flown is not None
    assert way.flown.start[0].tolist() == [1.0, 2.0]
    assert way.height_m == pytest.approx(-0.2)
    state = way._reference.sample(PIECE_S)
    assert state is not None
    assert state.position_leg_m == pytest.approx((1.0, 2.0, -0.2))


def test_after_the_end_nothing_is_held(way: WayToRest, grid: FreeGrid) -> None:
    way.end()
    way.recheck(LIMITS, grid)
    assert (way.flown, way.certified, way.still) == (None, None, False)
    assert not way.pass_nodes(10.0)


# ------------------------------------------------------------------ a trajectory of another kind


def braking(now_s: float, speed_mps: float = 1.2) -> Trajectory:
    """Return a trajectory from where the vehicle is to rest, 1 s long and not in nodes."""
    start = State((0.0, 0.0, -0.5), (speed_mps, 0.0, 0.0))
    accelerations = np.zeros((3, 3))
    accelerations[1, 0] = -2.0 * speed_mps
    return Trajectory.from_accelerations(now_s, start, np.array((0.5, 0.5)), accelerations)


def test_a_trajectory_is_followed_to_its_rest_and_nodes_go_on_there(
    way: WayToRest, grid: FreeGrid
) -> None:
    way.follow(braking(0.0), 0.0)
    assert way._reference.upcoming is None  # it is flown at once
    assert not way.still
    way.recheck(LIMITS, grid)
    assert way.certified is True
    assert not way.pass_nodes(0.5)
    assert not way.still
    reference = way._reference.sample(0.5)
    assert reference is not None
    assert reference.velocity_leg_mps[0] == pytest.approx(0.6)
    assert not way.pass_nodes(1.1)
    assert way.ended
    assert way.flown is not None
    assert way.flown.nodes[0, 0] == pytest.approx((0.6, 0.0))
    assert way.pass_nodes(1.3)
    assert adopted(way, grid, 1.35)
    assert way.pass_nodes(1.5)
    ahead = way._reference.sample(1.6)
    assert ahead is not None
    assert ahead.position_leg_m[0] > 0.6


def test_what_is_followed_is_rechecked_on_the_way_and_not_only_where_it_ends(
    way: WayToRest,
) -> None:
    seen = SeenFree()
    seen.confirm(0.6, 0.0, 0.8)
    way.follow(braking(0.0), 0.0)
    way.recheck(LIMITS, seen.grid())
    assert way.certified is False


def test_a_trajectory_that_starts_later_takes_over_then_and_moves_with_the_estimate(
    way: WayToRest,
) -> None:
    way.follow(braking(0.01), 0.0)
    still = way._reference.sample(0.0)
    assert still is not None
    assert still.velocity_leg_mps == (0.0, 0.0, 0.0)
    way.pass_nodes(0.02)
    way._reference.shift((0.0, 2.0, 0.0))
    way.shift((0.0, 2.0, 0.0))
    way.pass_nodes(1.02)
    assert way.flown is not None
    assert way.flown.nodes[0, 0] == pytest.approx((0.6, 2.0))
    resting = way._reference.sample(1.5)
    assert resting is not None
    assert resting.position_leg_m[:2] == pytest.approx((0.6, 2.0))


@pytest.mark.parametrize(
    ("greatest_m", "margin_m"),
    [(0.0, 0.0), (0.05, 0.05), (0.1, 0.1), (0.19, 0.1), (0.2, 0.2), (0.3, 0.2), (0.4, 0.4)],
)
def test_the_largest_margin_is_found_by_few_certificates(
    greatest_m: float, margin_m: float
) -> None:
    asked_m: list[float] = []

    def certifies(more_m: float) -> bool:
        asked_m.append(more_m)
        return more_m <= greatest_m

    assert largest_margin_m(certifies) == margin_m
    assert len(asked_m) <= 3


@pytest.mark.parametrize("velocity_mps", [(0.03, 0.0), (0.0, -0.03)])
def test_what_still_creeps_has_not_ended(way: WayToRest, velocity_mps: tuple[float, float]) -> None:
    assert way.flown is not None
    nodes = way.flown.nodes.copy()
    nodes[0, 1] = velocity_mps
    way.flown = Horizon(way.flown.start_s, nodes, way.flown.jerk_mps3)
    assert way.still
    assert not way.ended
    nodes[0, 1] = np.multiply(velocity_mps, 0.3)
    assert way.ended
