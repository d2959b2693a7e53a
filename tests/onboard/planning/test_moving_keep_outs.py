"""Keep-outs that depend on the time are certified exactly, as boxes are."""

from __future__ import annotations

import dataclasses
import math
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.geometry.box import Box, Faces
from onboard.geometry.keep_out import KeepOut, MovingBox
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import State, Trajectory
from onboard.planning.certifier import Certificate, certify_avoidance, certify_clear
from onboard.planning.closed_form import cruise
from onboard.planning.planner import NoPlan, Plan, Planner
from onboard.planning.problem import AvoidanceProblem, Envelope
from tests.onboard.planning.avoidance_cases import Variety, draw

# Everything may be flown: only the keep-outs decide.
FREE = Envelope(AccelerationLimits(9.0, 9.0, 9.0, 9.0), 60.0, (99.0,) * 3, 99.0)
STRAIGHT = cruise(State((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), 50.0, FREE, 2.0).coasting_for(9.0)

SEGMENTS = st.lists(
    st.builds(Segment, st.floats(0.1, 2.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    min_size=1,
    max_size=4,
).map(tuple)
PROFILES = st.builds(Profile, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), SEGMENTS)
TRAJECTORIES = st.builds(
    Trajectory.from_profiles, st.floats(0.0, 1e3), PROFILES, PROFILES, st.just(Profile(0.0, 0.0))
)


@dataclasses.dataclass(frozen=True)
class GrowingBox:
    """What the protocol is for besides: every face moves outwards at a speed, from a time on."""

    box: Box
    reference_s: float
    speed_mps: float

    def box_at(self, time_s: float) -> Box:
        return self.box.inflated(self.speed_mps * (time_s - self.reference_s))

    def swept(self, _begin_s: float, end_s: float) -> Box:
        return self.box_at(end_s)

    def faces_from(self, time_s: float) -> Faces:
        box, v = self.box_at(time_s), self.speed_mps
        return Faces((box.x_min_m, -v), (box.x_max_m, v), (box.y_min_m, -v), (box.y_max_m, v))


@dataclasses.dataclass(frozen=True)
class BrakingBox:
    """Faces of the second degree: along x it slows down."""

    box: Box
    reference_s: float
    speed_mps: float
    brake_mps2: float

    def _state(self, time_s: float) -> tuple[float, float]:
        t = time_s - self.reference_s
        return t * (
            self.speed_mps - self.brake_mps2 * t / 2.0
        ), self.speed_mps - self.brake_mps2 * t

    def box_at(self, time_s: float) -> Box:
        return self.box.shifted_by(self._state(time_s)[0], 0.0)

    def swept(self, begin_s: float, end_s: float) -> Box:
        turning_s = self.reference_s + self.speed_mps / self.brake_mps2
        middle_s = min(max(turning_s, begin_s), end_s)
        return self.box_at(begin_s).enclosing(self.box_at(end_s)).enclosing(self.box_at(middle_s))

    def faces_from(self, time_s: float) -> Faces:
        box, (_, v) = self.box_at(time_s), self._state(time_s)
        rates = (v, -self.brake_mps2 / 2.0)
        return Faces((box.x_min_m, *rates), (box.x_max_m, *rates), (box.y_min_m,), (box.y_max_m,))


def clear(trajectory: Trajectory, *keep_outs: KeepOut) -> Certificate:
    """The certificate, without what has nothing to do with keep-outs."""
    start = trajectory.sample(trajectory.start_s)
    certificate = certify_clear(trajectory, start, trajectory.start_s, FREE, keep_outs)
    entered = tuple(text for text in certificate.failures if text.startswith("inside"))
    return Certificate(entered)


def deepest_m(trajectory: Trajectory, keep_out: KeepOut, samples: int = 1200) -> float:
    """The slow oracle: depth inside at many instants, negative outside."""
    times_s = np.linspace(trajectory.start_s, trajectory.end_s, samples)
    knots_s = np.array(trajectory.knots_s)
    piece = np.searchsorted(knots_s[1:-1], times_s, side="right")
    t = (times_s - knots_s[piece])[:, None]
    p, v, a, j = (array[piece, :2] for array in trajectory.motion)
    x_m, y_m = (p + t * (v + t * (a / 2.0 + t * j / 6.0))).T
    faces_m = np.array(
        [tuple(vars(keep_out.box_at(time_s)).values()) for time_s in times_s.tolist()]
    )
    x_min_m, x_max_m, y_min_m, y_max_m = faces_m.T
    depths_m = np.minimum.reduce((x_m - x_min_m, x_max_m - x_m, y_m - y_min_m, y_max_m - y_m))
    return float(depths_m.max())


def agrees(trajectory: Trajectory, keep_out: KeepOut) -> None:
    deepest = deepest_m(trajectory, keep_out)
    valid = clear(trajectory, keep_out).valid
    if deepest > 2e-6:
        assert not valid
    # Between samples the relative position moves on by centimetres; a deeper dip is seen.
    elif not valid:
        assert deepest > -0.25


PLACES = st.builds(
    lambda x_m, y_m, size_m: Box(x_m, x_m + size_m, y_m, y_m + size_m / 2.0),
    st.floats(-6.0, 6.0),
    st.floats(-6.0, 6.0),
    st.floats(0.05, 3.0),
)
SPEEDS_MPS = st.floats(-5.0, 5.0)


@given(TRAJECTORIES, PLACES, SPEEDS_MPS, SPEEDS_MPS, st.floats(-3.0, 8.0))
@settings(max_examples=100)
def test_moving_boxes_agree_with_dense_sampling(
    trajectory: Trajectory, box: Box, x_mps: float, y_mps: float, after_s: float
) -> None:
    agrees(trajectory, MovingBox(box, trajectory.start_s + after_s, (x_mps, y_mps)))


@given(TRAJECTORIES, PLACES, st.floats(0.0, 2.0))
@settings(max_examples=40)
def test_growing_boxes_agree_with_dense_sampling(
    trajectory: Trajectory, box: Box, speed_mps: float
) -> None:
    agrees(trajectory, GrowingBox(box, trajectory.start_s, speed_mps))


@given(TRAJECTORIES, PLACES, st.floats(0.1, 6.0), st.floats(0.2, 4.0))
@settings(max_examples=40)
def test_braking_boxes_agree_with_dense_sampling(
    trajectory: Trajectory, box: Box, speed_mps: float, brake_mps2: float
) -> None:
    agrees(trajectory, BrakingBox(box, trajectory.start_s, speed_mps, brake_mps2))


@given(TRAJECTORIES, PLACES, st.floats(0.0, 1e3))
def test_a_box_that_stands_still_has_the_certificate_of_a_box(
    trajectory: Trajectory, box: Box, reference_s: float
) -> None:
    resting = MovingBox(box, reference_s, (0.0, 0.0))
    assert clear(trajectory, resting) == clear(trajectory, box)


@given(TRAJECTORIES, PLACES, SPEEDS_MPS, SPEEDS_MPS)
@settings(max_examples=40)
def test_only_the_relative_motion_counts(
    trajectory: Trajectory, box: Box, x_mps: float, y_mps: float
) -> None:
    """Seen from the mover, the vehicle moves and the box stands."""
    mover = MovingBox(box, trajectory.start_s, (x_mps, y_mps))
    assume(not 0.0 <= abs(deepest_m(trajectory, mover, 400)) < 1e-4)
    elapsed_s = np.array(trajectory.knots_s[:-1]) - trajectory.start_s
    velocity = np.array((x_mps, y_mps, 0.0))
    seen = dataclasses.replace(
        trajectory,
        position_leg_m=trajectory.position_leg_m - elapsed_s[:, None] * velocity,
        velocity_leg_mps=trajectory.velocity_leg_mps - velocity,
    )
    assert clear(trajectory, mover).valid == clear(seen, box).valid


def test_crossing_in_front_in_time_or_too_late() -> None:
    """At 2 m/s the vehicle is within x = 10 to 11 m from 5 to 5.5 s; the mover needs 0.5 s to pass.

    It is 1 m wide and long, and comes from the left at 2 m/s: it is on the line for y between
    -1 m and 0 of its front, that is for half a second.
    """
    for early_s, valid in ((0.6, True), (0.4, False), (0.0, False), (-0.4, False), (-1.2, True)):
        # Its near face reaches the line at 5 s, less how early it is.
        box = Box(10.0, 11.0, -1.0, 0.0)
        mover = MovingBox(box, STRAIGHT.start_s + 5.0 - early_s, (0.0, 2.0))
        assert clear(STRAIGHT, mover).valid == valid, early_s


def test_an_entry_is_reported_with_its_time_and_depth() -> None:
    """Head-on at 2 m/s each from 20 m: they meet at 5 s; through each other 0.25 s later."""
    mover = MovingBox(Box(20.0, 21.0, -0.3, 0.2), STRAIGHT.start_s, (-2.0, 0.0))
    (failure,) = clear(STRAIGHT, mover).failures
    assert failure == "inside the keep-out box 0 by at least 0.2 m at 55.125 s"


def test_a_mover_that_leaves_in_time_is_no_obstacle() -> None:
    """A box on the line ahead, that a vehicle of the same speed never reaches."""
    on_the_line = Box(3.0, 4.0, -1.0, 1.0)
    assert not clear(STRAIGHT, on_the_line).valid
    assert clear(STRAIGHT, MovingBox(on_the_line, STRAIGHT.start_s, (2.0, 0.0))).valid
    slower = MovingBox(on_the_line, STRAIGHT.start_s, (1.6, 0.0))
    assert not clear(STRAIGHT, slower).valid


def test_a_mover_from_behind_is_found() -> None:
    behind = MovingBox(Box(-6.0, -5.0, -0.5, 0.5), STRAIGHT.start_s, (3.0, 0.0))
    (failure,) = clear(STRAIGHT, behind).failures
    assert "by at least" in failure
    time_s = float(failure.split(" at ")[-1].removesuffix(" s"))
    assert 55.0 < time_s < 56.0 + 1e-3


def test_touching_along_the_way_is_not_entering() -> None:
    beside = MovingBox(Box(-1.0, 1.0, 0.0, 1.0), STRAIGHT.start_s, (2.0, 0.0))
    assert clear(STRAIGHT, beside).valid
    nearer = MovingBox(Box(-1.0, 1.0, -1e-4, 1.0), STRAIGHT.start_s, (2.0, 0.0))
    assert not clear(STRAIGHT, nearer).valid


def test_a_pebble_at_great_speed_between_two_knots_is_found() -> None:
    pebble = Box(10.0, 10.001, -60.0, -59.999)
    # Across the line within 50 microseconds, when the vehicle is at x = 10 m and half a pebble.
    exactly_s = STRAIGHT.start_s + 5.0 + 0.00025
    mover = MovingBox(pebble, exactly_s - 59.9995 / 20.0, (0.0, 20.0))
    assert not clear(STRAIGHT, mover).valid
    assert clear(STRAIGHT, dataclasses.replace(mover, reference_s=exactly_s - 3.01)).valid


def problem_with(keep_outs: tuple[KeepOut, ...]) -> AvoidanceProblem:
    problem = draw(Random(11), Variety(drift=False))
    return dataclasses.replace(problem, further_keep_outs=keep_outs)


def planned(problem: AvoidanceProblem) -> Plan:
    plan = Planner().plan(problem)
    assert isinstance(plan, Plan), plan
    return plan


def beside(problem: AvoidanceProblem, side: str) -> Box:
    """The whole lane on one side of the obstacle."""
    region, face = problem.region, problem.region.keep_out
    if side == "right":
        return Box(face.x_min_m, face.x_max_m, face.y_max_m - 0.1, region.lane_right_m + 1.0)
    return Box(face.x_min_m, face.x_max_m, region.lane_left_m - 1.0, face.y_min_m + 0.1)


def test_a_plan_is_certified_against_further_keep_outs() -> None:
    problem = problem_with(())
    plan = planned(problem)
    assert plan.side is not None
    blocked = problem_with((beside(problem, plan.side),))
    failures = certify_avoidance(plan.trajectory, blocked).failures
    assert [text.split(" by ")[0] for text in failures] == ["inside the further keep-out 0"]
    gone = problem_with((MovingBox(beside(problem, plan.side), problem.start_s, (0.0, 1e3)),))
    assert certify_avoidance(plan.trajectory, gone).valid


def test_the_planner_takes_the_side_that_is_free() -> None:
    problem = problem_with(())
    first = planned(problem)
    assert first.side is not None
    blocked = problem_with((beside(problem, first.side),))
    other = planned(blocked)
    assert other.side not in {None, first.side}
    assert certify_avoidance(other.trajectory, blocked).valid


@pytest.mark.parametrize(("back_m", "kind"), [(0.0, None), (5.0, "brake")])
def test_where_both_sides_are_taken_braking_is_left(back_m: float, kind: str | None) -> None:
    """Here the region begins too near to stop in front of the obstacle; 5 m before it, it can."""
    problem = draw(Random(11), Variety(drift=False))
    x_m, y_m, z_m = problem.start.position_leg_m
    start = problem.start._replace(position_leg_m=(x_m - back_m, y_m, z_m))
    sides = (beside(problem, "left"), beside(problem, "right"))
    plan = Planner().plan(dataclasses.replace(problem, start=start, further_keep_outs=sides))
    if isinstance(plan, Plan):
        assert plan.kind == kind
    else:
        assert kind is None
        for number, side in enumerate(("left", "right")):
            refused = f"vertex, {side}: inside the further keep-out {number}"
            assert any(reason.startswith(refused) for reason in plan.reasons)


def test_a_mover_that_comes_at_the_stopped_vehicle_leaves_no_plan() -> None:
    problem = draw(Random(11), Variety(drift=False))
    x_m, y_m, _ = problem.start.position_leg_m
    wall = Box(x_m + 0.5, x_m + 40.0, y_m - 200.0, y_m + 200.0)
    mover = MovingBox(wall, problem.start_s, (-problem.start.velocity_leg_mps[0], 0.0))
    plan = Planner().plan(dataclasses.replace(problem, further_keep_outs=(mover,)))
    assert isinstance(plan, NoPlan)
    assert plan.reasons[-1].startswith("brake: ")
    assert "inside the keep-out box 1" in plan.reasons[-1]


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (1.0, -2.0)])
def test_round_off_of_a_late_clock_does_not_matter(velocity: tuple[float, float]) -> None:
    """A flight computer's clock may count from 1970."""
    late = dataclasses.replace(STRAIGHT, start_s=1.7e9)
    box = Box(10.0, 11.0, -1.0, 1.0)
    early_mover = MovingBox(box, STRAIGHT.start_s + 5.0, velocity)
    late_mover = MovingBox(box, 1.7e9 + 5.0, velocity)
    assert clear(STRAIGHT, early_mover).valid == clear(late, late_mover).valid
    assert not math.isnan(deepest_m(late, late_mover, 10))
