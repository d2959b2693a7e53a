"""Ways to rest from a plan: braking at once, gently, along the leg, and after all of the plan."""

from __future__ import annotations

import math

import numpy as np
import pytest

from onboard.contract.agility import AccelerationLimits
from onboard.guidance.dense.tails import ways_to_rest
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import Trajectory
from onboard.planning.problem import Envelope

ENVELOPE = Envelope(AccelerationLimits(2.0, 3.0, 0.8, 1.5), 40.0, (math.inf,) * 3, 9.0)
STILL = Profile(0.0, 0.0)


def planned(speed_mps: float = 2.0, aside: tuple[Segment, ...] = ()) -> Trajectory:
    """Four seconds at a speed along the leg, from 10 s on."""
    along = Profile(0.0, speed_mps, (Segment(4.0, 0.0),))
    return Trajectory.from_profiles(10.0, along, Profile(0.0, 0.0, aside), STILL)


def tails(plan: Trajectory, switch_s: float = 11.0) -> list[Trajectory]:
    return list(ways_to_rest(plan.until(switch_s), plan, ENVELOPE))


def speeds_mps(trajectory: Trajectory, time_s: float) -> tuple[float, float]:
    return trajectory.sample(time_s).velocity_leg_mps[:2]


def test_every_way_begins_as_intended_and_ends_at_rest() -> None:
    aside = (Segment(1.0, 0.4), Segment(1.0, -0.4), Segment(1.0, 0.0))
    plan = planned(aside=aside)
    ways = tails(plan)
    assert len(ways) == 4
    for way in ways:
        assert way.start_s == 10.0
        for time_s in (10.0, 10.4, 10.99):
            assert way.sample(time_s) == plan.sample(time_s)
        assert np.abs(way.final.velocity_leg_mps).max() == pytest.approx(0.0, abs=1e-9)
        gaps = [end[:-1] - start[1:] for end, start in zip(way.ends, way.motion, strict=False)]
        assert max(np.abs(gap).max() for gap in gaps[:2]) < 1e-9


@pytest.mark.parametrize(
    ("axis", "speed_mps", "limit_mps2"),
    [(0, 2.0, -2.0), (0, -2.0, 1.5), (1, 0.5, -0.8), (1, -0.5, 1.5)],
)
def test_braking_is_as_hard_as_the_envelope_allows_or_two_fifths_of_that(
    axis: int, speed_mps: float, limit_mps2: float
) -> None:
    """Forward it takes half of what the envelope allows, as a cruise does."""
    speeds = [0.0, 0.0]
    speeds[axis] = speed_mps
    along, across = (Profile(0.0, speed, (Segment(4.0, 0.0),)) for speed in speeds)
    plan = Trajectory.from_profiles(10.0, along, across, STILL)
    hard, gentle, *_, whole = tails(plan)
    for way, share, begins_s in ((hard, 1.0, 11.0), (gentle, 0.4, 11.0), (whole, 1.0, 14.0)):
        pull_mps2 = way.acceleration_leg_mps2[:, axis]
        assert pull_mps2[np.abs(pull_mps2).argmax()] == pytest.approx(share * limit_mps2)
        ends_s = begins_s - speed_mps / (share * limit_mps2)
        assert abs(way.sample(ends_s - 0.01).velocity_leg_mps[axis]) > 1e-3
        assert way.sample(ends_s + 1e-6).velocity_leg_mps[axis] == pytest.approx(0.0, abs=1e-5)
    assert whole.sample(13.9) == plan.sample(13.9)


def test_one_way_brakes_along_the_leg_and_moves_aside_as_planned() -> None:
    aside = (Segment(1.0, 0.4), Segment(1.5, -0.4, 0.2), Segment(1.5, -0.1, 0.1))
    plan = planned(aside=aside)
    hard, _, along, _ = tails(plan)
    for time_s in np.linspace(11.0, 13.99, 40).tolist():
        x_mps, y_mps = speeds_mps(along, time_s)
        assert x_mps == pytest.approx(speeds_mps(hard, time_s)[0], abs=1e-9)
        assert y_mps == pytest.approx(speeds_mps(plan, time_s)[1], abs=1e-9)
        x_m, y_m, _ = along.sample(time_s).position_leg_m
        assert x_m == pytest.approx(hard.sample(time_s).position_leg_m[0], abs=1e-9)
        assert y_m == pytest.approx(plan.sample(time_s).position_leg_m[1], abs=1e-9)
    # Where both have a knot at the same time there is one.
    assert along.durations_s.min() > 1e-6


def test_a_plan_without_a_lateral_part_and_one_that_ends_at_rest_need_no_more() -> None:
    assert len(tails(planned(aside=(Segment(0.001, 0.9),)))) == 3
    assert len(tails(planned(aside=(Segment(0.002, 0.9),)))) == 4
    stopping = Trajectory.from_profiles(
        10.0, Profile(0.0, 2.0, (Segment(1.5, 0.0), Segment(2.0, -1.0))), STILL, STILL
    )
    *_, whole = tails(stopping)
    assert whole.end_s == stopping.end_s
    # Nothing is planned beyond the switch.
    assert len(tails(planned(), 14.0)) == 2
    assert len(tails(planned(), 15.0)) == 2
