"""What each clause of both certifiers measures, by hand or by dense sampling; quick."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.contract.run_on import NO_RUN_ON
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.geometry.free_grid import FreeGrid
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import State, Trajectory
from onboard.planning import certifier, rest_certifier
from onboard.planning.certifier import certify_avoidance, certify_clear
from onboard.planning.closed_form import vertex_manoeuvre
from onboard.planning.corridor.horizon import PIECES, Horizon
from onboard.planning.problem import AvoidanceProblem, Envelope
from onboard.planning.rest_certifier import certify_rest
from tests.onboard.planning.avoidance_cases import Variety, draw
from tests.onboard.planning.test_rest_certifier import (
    LIMITS,
    MAPS,
    SIDE,
    Case,
    all_free,
    standing,
    swaying,
)

WEAK = AccelerationLimits(0.9, 0.8, 0.7, 0.6)
FREE = Envelope(AccelerationLimits(*[90.0] * 4), 600.0, (math.inf,) * 3, 99.0)


def certified() -> tuple[AvoidanceProblem, Trajectory]:
    """A problem with a limited jerk, and a plan that certifies."""
    for seed in range(40):
        problem = draw(Random(seed), Variety(passive_safety=True))
        trajectory = vertex_manoeuvre(problem, "right")
        if trajectory is None or not problem.envelope.jerk_is_limited:
            continue
        if certify_avoidance(trajectory, problem).valid:
            return problem, trajectory
    pytest.fail("the closed form should exist")


PROBLEM, PLAN = certified()


def refused(problem: AvoidanceProblem, plan: Trajectory = PLAN) -> tuple[str, ...]:
    return certify_avoidance(plan, problem).failures


def wandering(seed: int, pieces: int = 4) -> Trajectory:
    """Pieces of random jerk that join."""
    rng = np.random.default_rng(seed)
    state, rows = rng.uniform(-1.0, 1.0, (3, 3)), []
    durations_s = rng.uniform(0.3, 1.2, pieces)
    for t in durations_s:
        jerk = rng.uniform(-4.0, 4.0, 3)
        rows.append((*state, jerk))
        p, v, a = state
        state = np.array(
            (
                p + v * t + a * t**2 / 2.0 + jerk * t**3 / 6.0,
                v + a * t + jerk * t**2 / 2.0,
                a + jerk * t,
            )
        )
    motion = [np.array([row[order] for row in rows]) for order in range(4)]
    return Trajectory(10.0, durations_s, *motion)


def moved(state: State, order: int, by: float) -> State:
    """A state whose position (0), velocity or acceleration (2) differs on y."""
    vectors = [*state[:3]]
    x, y, z = vectors[order]
    vectors[order] = (x, y + by, z)
    return State(*vectors)


# --- avoidances


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("by", [-1e-3, 1e-3])
def test_a_start_that_jumps_is_named_with_its_amount(order: int, by: float) -> None:
    quantity, unit = (("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s²"))[order]
    (text,) = refused(replace(PROBLEM, start=moved(PROBLEM.start, order, by)))
    assert text == f"start: {quantity} jumps by 0.001 {unit}"
    assert not refused(replace(PROBLEM, start=moved(PROBLEM.start, order, by * 1e-4)))


def test_a_start_at_another_time_is_named() -> None:
    for late_s in (-1e-3, 1e-3):
        late = replace(PROBLEM, start_s=PROBLEM.start_s + late_s)
        assert refused(late) == ("start: late or early by 0.001 s",)


def test_every_part_of_the_exit_is_named_with_its_amount() -> None:
    end = f"at {PLAN.end_s:.3f} s"
    for sign in (-1.0, 1.0):
        room = PROBLEM.region.manoeuvre
        farther = replace(room, x_max_m=room.x_max_m + sign * 0.01)
        away = replace(PROBLEM, region=replace(PROBLEM.region, manoeuvre=farther))
        assert f"exit: away from the post-obstacle border by 0.01 m {end}" in refused(away)
        fast = replace(PROBLEM.envelope, speed_max_mps=PROBLEM.envelope.speed_max_mps + 1.0)
        speed_mps = PROBLEM.exit_speed_mps + sign * 0.1
        other = replace(PROBLEM, envelope=fast, exit_speed_mps=speed_mps)
        assert refused(other) == (f"exit: speed differs by 0.1 m/s {end}",)
        for axis, name in ((1, "lateral"), (2, "vertical")):
            velocity = PLAN.velocity_leg_mps.copy()
            velocity[-1, axis] += sign * 0.1
            turned = replace(PLAN, velocity_leg_mps=velocity)
            assert f"exit: {name} speed by 0.1 m/s {end}" in refused(PROBLEM, turned)
        for axis in range(3):
            acceleration = PLAN.acceleration_leg_mps2.copy()
            acceleration[-1, axis] += sign * 0.1
            pushed = replace(PLAN, acceleration_leg_mps2=acceleration)
            assert f"exit: still accelerating by 0.1 m/s² {end}" in refused(PROBLEM, pushed)


def test_the_jerk_is_named_with_its_axis_and_time() -> None:
    for axis, name in enumerate("xyz"):
        row = np.abs(PLAN.jerk_leg_mps3[:, axis])
        if row.max() < 0.1:
            continue
        x, y, z = (
            float(row.max()) - 0.01 if each == axis else limit
            for each, limit in enumerate(PROBLEM.envelope.jerk_max_mps3)
        )
        envelope = replace(PROBLEM.envelope, jerk_max_mps3=(x, y, z))
        time_s = PLAN.knots_s[int(np.argmax(row))]
        text = f"jerk limit on {name} exceeded by 0.01 m/s³ at {time_s:.3f} s"
        assert refused(replace(PROBLEM, envelope=envelope)) == (text,)


@pytest.mark.parametrize("z_mps2", [0.0, -1.5, 2.0])
@pytest.mark.parametrize(
    ("name", "axis", "sign", "limit_mps2"),
    [
        ("braking limit", 0, -1.0, 0.9),
        ("forward acceleration limit", 0, 1.0, 0.8),
        ("leftward acceleration limit", 1, -1.0, 0.7),
        ("rightward acceleration limit", 1, 1.0, 0.6),
    ],
)
def test_what_tilt_and_wind_leave_by_hand(
    name: str, axis: int, sign: float, limit_mps2: float, z_mps2: float
) -> None:
    """Tilt gives in proportion to the lift; the wind takes its trim at any lift."""
    envelope = Envelope(WEAK, 40.0, (math.inf,) * 3, 9.0, 0.3)
    allowed_mps2 = (limit_mps2 + 0.3) * (1.0 - z_mps2 / GRAVITY_MPS2) - 0.3
    for more_mps2 in (-1e-3, 0.1):
        pushes: list[tuple[Segment, ...]] = [(), ()]
        pushes[axis] = (Segment(0.5, sign * (allowed_mps2 + more_mps2)),)
        plan = Trajectory.from_profiles(
            0.0,
            Profile(0.0, 2.0, pushes[0]),
            Profile(0.0, 0.0, pushes[1]),
            Profile(0.0, 0.0, (Segment(0.5, z_mps2),)),
        )
        failures = certify_clear(plan, plan.sample(0.0), 0.0, envelope).failures
        expected = (f"{name} exceeded by 0.1 m/s² at 0.000 s",) if more_mps2 > 0.0 else ()
        assert failures == expected


def test_speed_along_the_leg_is_between_rest_and_the_limit() -> None:
    def failures(speed_mps: float) -> tuple[str, ...]:
        plan = Trajectory.from_profiles(
            0.0, Profile(0.0, speed_mps, (Segment(1.0, 0.0),)), Profile(0.0, 0.0), Profile(0.0, 0.0)
        )
        return certify_clear(plan, plan.sample(0.0), 0.0, replace(FREE, speed_max_mps=2.0)).failures

    assert failures(0.0) == failures(2.0) == ()
    assert failures(-0.1) == ("reverses along the leg by 0.1 m/s",)
    assert failures(2.1) == ("speed limit exceeded by 0.1 m/s",)


def test_the_band_of_heights_reaches_from_the_climb_to_the_lower_of_start_and_cruise() -> None:
    low_m, high_m = PLAN.position_range_m(2)
    start_m = PROBLEM.start.position_leg_m[2]
    assert high_m == pytest.approx(max(start_m, PROBLEM.cruise_z_m), abs=1e-6)
    deeper = PLAN.position_leg_m.copy()
    deeper[:, 2] += 0.5
    assert any(
        text.startswith("below the height band by 0.5 m")
        for text in refused(PROBLEM, replace(PLAN, position_leg_m=deeper))
    )
    higher = PLAN.position_leg_m.copy()
    room_m = low_m - min(start_m, PROBLEM.cruise_z_m - PROBLEM.climb_m)
    higher[:, 2] -= room_m + 0.5
    assert any(
        text.startswith("above the height band by 0.5 m")
        for text in refused(PROBLEM, replace(PLAN, position_leg_m=higher))
    )


def sampled_reach(plan: Trajectory, sign: float, coast_s: float, brake_mps2: float) -> FloatArray:
    """Rows of time and reach, densely."""
    times_s = np.linspace(plan.start_s, plan.end_s, 4001)
    states = [plan.sample(float(time_s)) for time_s in times_s]
    y_m = sign * np.array([state.position_leg_m[1] for state in states])
    v_mps = sign * np.array([state.velocity_leg_mps[1] for state in states])
    reach_m = y_m + v_mps * coast_s + v_mps**2 / (2.0 * brake_mps2)
    return np.column_stack((times_s, np.where(v_mps >= 0.0, reach_m, -math.inf)))


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("coast_s", "brake_mps2"), [(0.4, 1.5), (1.5, 6.0)])
def test_the_reach_of_a_coast_is_the_sampled_one(
    seed: int, sign: float, coast_s: float, brake_mps2: float
) -> None:
    plan = wandering(seed)
    rows = sampled_reach(plan, sign, coast_s, brake_mps2)
    worst = int(np.argmax(rows[:, 1]))
    limits = sign, coast_s, brake_mps2
    reach_m, time_s = certifier._coast_reach(plan, *limits, -math.inf)
    assert reach_m == pytest.approx(rows[worst, 1], abs=3e-3)
    assert reach_m >= rows[worst, 1] - 1e-9
    assert time_s == pytest.approx(rows[worst, 0], abs=0.05)
    # No piece that reaches it is passed over, and none that does not counts.
    assert certifier._coast_reach(plan, *limits, reach_m - 1e-9) == (reach_m, time_s)
    passed_m, _ = certifier._coast_reach(plan, *limits, reach_m + 100.0)
    assert passed_m == -math.inf


@pytest.mark.parametrize(("brake_mps2", "farthest_m"), [(2.0, 3.0), (0.5, 6.0)])
def test_a_coast_from_the_fastest_end_of_a_piece_counts(
    brake_mps2: float, farthest_m: float
) -> None:
    """Speeding up all the time: the last instant reaches farthest, 1 + 2 x 0.5 + 4/2b m."""
    plan = Trajectory.from_profiles(
        0.0, Profile(0.0, 1.0), Profile(0.0, 0.0, (Segment(1.0, 2.0),)), Profile(0.0, 0.0)
    )
    reach_m, time_s = certifier._coast_reach(plan, 1.0, 0.5, brake_mps2, farthest_m - 0.01)
    assert reach_m == pytest.approx(farthest_m)
    assert time_s == 1.0


def test_a_coast_may_go_to_the_faces_of_the_region_on_both_sides() -> None:
    w, room = PROBLEM.envelope.limits, PROBLEM.region.manoeuvre
    for sign, brake_mps2, face in ((1.0, w.left_mps2, "y_max_m"), (-1.0, w.right_mps2, "y_min_m")):
        rows = sampled_reach(PLAN, sign, PROBLEM.coast_time_s, brake_mps2)
        farthest_m, name = sign * rows[:, 1].max(), "right" if sign > 0.0 else "left"
        for inset_m, found in ((0.01, True), (-0.01, False)):
            tight = replace(room, **{face: farthest_m - sign * inset_m})
            problem = replace(PROBLEM, region=replace(PROBLEM.region, manoeuvre=tight))
            texts = [text for text in refused(problem) if "coasting" in text]
            assert [text.partition(" by ")[0] for text in texts] == (
                [f"coasting leaves the region to the {name}"] if found else []
            )
            # Without passive safety no coast is asked about.
            still = replace(problem, coast_time_s=0.0)
            assert not [text for text in refused(still) if "coasting" in text]


@pytest.mark.parametrize(("axis", "sign"), [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)])
def test_a_path_along_a_face_is_clear_and_one_inside_it_is_not(axis: int, sign: float) -> None:
    """Straight along each face of a box, with a turn of 90° for two of them."""
    box, faces = Box(1.0, 3.0, -1.0, 1.0), ((1.0, 3.0), (-1.0, 1.0))
    for inside_m, clear in ((-1e-3, True), (5e-7, True), (1e-3, False)):
        beside_m = faces[axis][0 if sign > 0.0 else 1] + sign * inside_m
        along = Profile(0.0 if axis == 1 else -2.0, 1.0, (Segment(4.0, 0.0),))
        across = Profile(beside_m, 0.0)
        x, y = (along, across) if axis == 1 else (across, along)
        plan = Trajectory.from_profiles(0.0, x, y, Profile(0.0, 0.0))
        failures = certify_clear(plan, plan.sample(0.0), 0.0, FREE, [box]).failures
        assert (not failures) is clear
        if not clear:
            assert failures == ("inside the keep-out box 0 by at least 0.000999 m at 2.000 s",)


# --- ways to rest


def test_velocity_and_motion_points_are_of_the_same_curves() -> None:
    plan = wandering(7)
    velocity, motion = rest_certifier.velocity_points_mps(plan), rest_certifier.motion_points(plan)
    for piece, (begin_s, duration_s) in enumerate(
        zip(plan.knots_s[:-1], plan.durations_s.tolist(), strict=True)
    ):
        for share in (0.0, 0.3, 0.8):
            state = plan.sample(begin_s + share * duration_s + 1e-12)
            quadratic = [(1 - share) ** 2, 2 * share * (1 - share), share**2]
            assert quadratic @ velocity[piece] == pytest.approx(state.velocity_leg_mps, abs=1e-9)
            for order, vector in enumerate(state[:3]):
                found = cubic_weights(share) @ motion[order, piece]
                assert found == pytest.approx(vector[:2], abs=1e-9)


def cubic_weights(share: float) -> FloatArray:
    rest = 1.0 - share
    return np.array((rest**3, 3 * rest**2 * share, 3 * rest * share**2, share**3))


def test_halves_are_of_the_same_curves() -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 2, 4, 2))
    halves = rest_certifier.halves(points)
    assert halves.shape == (3, 4, 4, 2)
    for piece in range(2):
        for share in (0.0, 0.25, 0.9, 1.0):
            for half in (0, 1):
                found = np.tensordot(cubic_weights(share), halves[:, 2 * piece + half], (0, 1))
                whole = cubic_weights((share + half) / 2.0)
                expected = np.tensordot(whole, points[:, piece], (0, 1))
                assert found == pytest.approx(expected, abs=1e-12)


def rest_failures(plan: Trajectory, start: State | None = None) -> tuple[str, ...]:
    begins = plan.sample(plan.start_s) if start is None else start
    return certify_rest(plan, begins, plan.start_s, LIMITS, all_free()).failures


def test_a_way_to_rest_that_begins_late_or_elsewhere_is_named() -> None:
    plan, start = standing()
    for late_s in (0.01, -0.01):
        (text,) = certify_rest(plan, start, -late_s, LIMITS, all_free()).failures
        assert text == f"start: {late_s:+.3g} s late"
    assert certify_rest(plan, start, 1e-7, LIMITS, all_free()).valid
    for order, (name, unit) in enumerate(
        (("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s²"))
    ):
        for by in (-0.01, 0.01):
            text = f"start: {name} jumps by 0.01 {unit}"
            assert rest_failures(plan, moved(start, order, by)) == (text,)
    # Where the jerk has no limit, the acceleration may jump; nothing else may.
    jumping = replace(LIMITS, jerk_max_mps3=math.inf)
    pulled = State(start.position_leg_m, start.velocity_leg_mps, (0.01, 0.0, 0.0))
    assert certify_rest(plan, pulled, 0.0, jumping, all_free()).valid
    pushed = State(start.position_leg_m, (0.01, 0.0, 0.0), start.acceleration_leg_mps2)
    assert not certify_rest(plan, pushed, 0.0, jumping, all_free()).valid


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_gap_between_pieces_of_a_way_to_rest_is_named(order: int) -> None:
    plan = swaying().trajectory(-5.0)
    name = ("position", "velocity", "acceleration")[order]
    key = ("position_leg_m", "velocity_leg_mps", "acceleration_leg_mps2")[order]
    array = getattr(plan, key).copy()
    array[3, 0] += 0.01
    broken = dataclasses.replace(plan, **{key: array})
    assert f"{name} jumps by 0.01 between two pieces" in rest_failures(broken)
    free = certify_rest(
        broken, broken.sample(0.0), 0.0, replace(LIMITS, jerk_max_mps3=math.inf), all_free()
    ).failures
    assert any(text.startswith(f"{name} jumps") for text in free) is (order < 2)


def test_what_a_way_to_rest_asks_for_is_named_with_its_excess() -> None:
    """Two limits of each kind: just enough, and 0.01 less."""
    plan = swaying().trajectory(-5.0)
    acceleration = np.concatenate((plan.acceleration_leg_mps2, plan.ends[2]))[:, :2]
    jerk = np.abs(plan.jerk_leg_mps3[:, :2]).max(axis=0)
    fine_s = np.linspace(plan.start_s, plan.end_s, 2000)[:-1]
    speeds = [math.hypot(*plan.sample(float(t)).velocity_leg_mps[:2]) for t in fine_s]
    sides = (*zip(-acceleration.min(axis=0), acceleration.max(axis=0), strict=True),)
    for number, name in enumerate(("braking", "forward", "leftward", "rightward")):
        peak = float(sides[number // 2][number % 2])
        assert excess_of(plan, name, acceleration_max_mps2=one_of_four(number, peak)) is None
        tight = one_of_four(number, peak - 0.01)
        assert excess_of(plan, name, acceleration_max_mps2=tight) == "0.01"
    disc = float(np.hypot(*acceleration.T).max())
    assert excess_of(plan, "tilt", acceleration_disc_mps2=disc) is None
    assert excess_of(plan, "tilt", acceleration_disc_mps2=disc - 0.01) == "0.01"
    assert excess_of(plan, "jerk", jerk_max_mps3=jerk[0] - 0.01, jerk_y_max_mps3=99.0) == "0.01"
    assert excess_of(plan, "jerk", jerk_max_mps3=99.0, jerk_y_max_mps3=jerk[1] - 0.01) == "0.01"
    assert excess_of(plan, "jerk", jerk_max_mps3=jerk[0], jerk_y_max_mps3=jerk[1]) is None
    # The hull of the speeds' control points holds them, with a little room.
    assert excess_of(plan, "speed", speed_max_mps=max(speeds) - 1e-3) is not None
    assert excess_of(plan, "speed", speed_max_mps=1.2 * max(speeds)) is None


def one_of_four(number: int, value: float) -> tuple[float, float, float, float]:
    four = [30.0] * 4
    four[number] = value
    return four[0], four[1], four[2], four[3]


def excess_of(plan: Trajectory, name: str, **changes: object) -> str | None:
    limits = replace(LIMITS, **changes)  # type: ignore[arg-type]  # of one limit
    failures = certify_rest(plan, plan.sample(plan.start_s), plan.start_s, limits, all_free())
    found = [text for text in failures.failures if text.startswith(name)]
    return found[0].partition(" by ")[2].partition(" ")[0] if found else None


def test_a_height_that_changes_and_an_end_that_moves_are_named() -> None:
    plan = swaying().trajectory(-5.0)
    for sign in (-1.0, 1.0):
        position = plan.position_leg_m.copy()
        position[-1, 2] += sign * 0.01
        assert "height changes by 0.01 m" in rest_failures(replace(plan, position_leg_m=position))
        for key, text in (
            ("velocity_leg_mps", "ends at 0.01 m/s and"),
            ("acceleration_leg_mps2", "m/s and 0.01 m/s², not at rest"),
        ):
            array = getattr(plan, key).copy()
            array[-1, 1] += sign * 0.01
            failures = rest_failures(dataclasses.replace(plan, **{key: array}))
            assert any(text in failure for failure in failures)


def with_unknown(*cells: tuple[int, int]) -> FreeGrid:
    """A grid in which some cells are unknown, counted from the origin."""
    unknown = np.zeros((SIDE, SIDE), bool)
    for i, j in cells:
        unknown[SIDE // 2 + i, SIDE // 2 + j] = True
    return Case(swaying(), unknown, NO_RUN_ON, 0.5).grid


@pytest.mark.parametrize("cell", [(5, 0), (-6, 0), (0, 5), (0, -6)])
def test_the_body_ends_two_millimetres_beyond_its_radius_on_every_side(
    cell: tuple[int, int],
) -> None:
    """At a place off the origin: a cell whose near face is 0.5 m from it."""
    plan = Horizon.at_rest(0.0, 2.0, -3.0).trajectory(-5.0)
    grid = with_unknown((20 + cell[0], -30 + cell[1]))
    for radius_m, free in ((0.4975, True), (0.4985, False)):
        limits = replace(LIMITS, body_radius_m=radius_m)
        assert certify_rest(plan, plan.sample(0.0), 0.0, limits, grid).valid is free
    disc = replace(all_unknown(), free_disc=(2.0, -3.0, 0.5))
    for radius_m, free in ((0.4975, True), (0.4985, False)):
        limits = replace(LIMITS, body_radius_m=radius_m)
        assert certify_rest(plan, plan.sample(0.0), 0.0, limits, disc).valid is free


def all_unknown() -> FreeGrid:
    return Case(swaying(), np.ones((SIDE, SIDE), bool), NO_RUN_ON, 0.5).grid


def test_a_way_past_a_corner_is_split_until_it_fits() -> None:
    """Along a diagonal, 0.4 m a piece on each axis: 2 cm after four halvings, 7 cm after two."""
    start = np.zeros((3, 2))
    start[1] = 2.0
    jerk = np.zeros((PIECES, 2))
    for axis in (0, 1):
        jerk[:, axis] = MAPS.ending_at_rest(start[:, axis], jerk[:, axis])
    grid = with_unknown((0, 0))
    for slack_m, free in ((0.035, True), (-0.003, False)):
        start[0] = (-0.55, -0.45 + math.sqrt(2.0) * (0.052 + slack_m))
        plan = Horizon.integrated(0.0, start, jerk).trajectory(-5.0)
        limits = replace(LIMITS, body_radius_m=0.05)
        certificate = certify_rest(plan, plan.sample(0.0), 0.0, limits, grid)
        assert certificate.valid is free, certificate.failures


def test_the_first_piece_that_leaves_the_free_space_is_named() -> None:
    plan = swaying().trajectory(-5.0)
    (failure,) = certify_rest(plan, plan.sample(0.0), 0.0, LIMITS, all_unknown()).failures
    assert failure == "leaves the seen-free space in the piece from 0.000 s"
    x_m, y_m, _ = plan.final.position_leg_m
    touched = with_unknown((math.floor((x_m + LIMITS.body_radius_m) / 0.1), math.floor(y_m / 0.1)))
    (failure,) = certify_rest(plan, plan.sample(0.0), 0.0, LIMITS, touched).failures
    assert float(failure.rpartition(" from ")[2].rstrip(" s")) > 0.5


@dataclasses.dataclass
class Asked:
    """A grid that remembers which rectangles it was asked about."""

    free_disc: None = None
    rectangles: list[FloatArray] = dataclasses.field(default_factory=list)

    def are_free_between(self, low_m: FloatArray, high_m: FloatArray) -> FloatArray:
        self.rectangles.append(np.stack((low_m[0], high_m[0], low_m[1], high_m[1])))
        return np.zeros(low_m.shape[1:], bool)


def test_the_boxes_asked_about_hold_every_point_of_the_run_and_the_body() -> None:
    points = np.random.default_rng(12).uniform(-1.0, 1.0, (3, 5, 4, 2))
    gains, asked = ((0.0, 0.0), (0.6, 0.0), (0.9, 0.3)), Asked()
    rest_certifier._are_free(points, (gains,), 0.25, asked)  # type: ignore[arg-type]  # one call of it
    square, covering = asked.rectangles
    square = square[:, 0]  # of one strip
    for piece in range(5):
        p, v, a = points[:, piece]
        run = np.concatenate([p + kappa * v + c * a for kappa, c in gains])
        low, high = run.min(axis=0), run.max(axis=0)
        expected = (low[0] - 0.25, high[0] + 0.25, low[1] - 0.25, high[1] + 0.25)
        assert square[:, piece] == pytest.approx(expected)
        # Rectangles around the same box, which cover its corners grown by a disc.
        for turn in np.linspace(0.0, math.pi / 2.0, 91):
            x_m, y_m = 0.25 * math.cos(turn) - 1e-9, 0.25 * math.sin(turn) - 1e-9
            x0_m, x1_m, y0_m, y1_m = covering[:, :, piece]
            holds = (x1_m >= high[0] + x_m) & (y1_m >= high[1] + y_m)
            holds &= (x0_m <= low[0] - x_m) & (y0_m <= low[1] - y_m)
            assert holds.any()
        assert covering[1, :, piece].max() == pytest.approx(high[0] + 0.25)
        assert np.hypot(x1_m - high[0], y1_m - high[1]).max() < 1.1 * 0.25
        assert np.hypot(low[0] - x0_m, low[1] - y0_m).max() < 1.1 * 0.25


def test_a_start_under_way_may_accelerate_and_is_continued() -> None:
    """With an acceleration at its start, which the plan has to continue, not to undo."""
    when_s = PLAN.start_s + PLAN.durations_s[0] / 2.0
    rest = PLAN.from_time(when_s)
    start = rest.sample(when_s)
    assert abs(start.acceleration_leg_mps2[0]) + abs(start.acceleration_leg_mps2[1]) > 0.1
    failures = refused(replace(PROBLEM, start=start, start_s=when_s), rest)
    assert not [each for each in failures if each.startswith("start")]


def test_a_coast_from_the_middle_of_a_piece_counts() -> None:
    """At rest at both ends and fastest between: v = 4 t (1 - t) m/s, at t = 0.5 from 1/3 m."""
    zero = np.zeros((1, 3))
    start_mps2, jerk_mps3 = zero.copy(), zero.copy()
    start_mps2[0, 1], jerk_mps3[0, 1] = 4.0, -8.0
    plan = Trajectory(0.0, np.array((1.0,)), zero, zero, start_mps2, jerk_mps3)
    reach_m, _ = certifier._coast_reach(plan, 1.0, 1.0, 2.0, 1.0)
    assert reach_m >= 1.0 / 3.0 + 1.0 + 0.25


@pytest.mark.parametrize(("low", "high"), [((0.0, -0.1), (0.9, 0.1)), ((-0.9, -0.1), (0.0, 0.1))])
def test_a_box_lies_in_the_disc_only_with_its_farthest_corner(
    low: tuple[float, float], high: tuple[float, float]
) -> None:
    grid = replace(all_unknown(), free_disc=(0.0, 0.0, 1.0))
    corners = np.array([low]).T, np.array([high]).T
    assert rest_certifier._discs_are_free(*corners, 0.09, grid).tolist() == [True]
    assert rest_certifier._discs_are_free(*corners, 0.1, grid).tolist() == [False]
