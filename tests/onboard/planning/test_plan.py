"""What a planner returns, and how it says why a plan was rejected."""

from __future__ import annotations

import dataclasses
import math
from random import Random

import pytest

from onboard.geometry.box import Box
from onboard.planning.certifier import Certificate, certify_avoidance
from onboard.planning.plan import NoPlan, Plan, reason
from onboard.planning.planner import Planner
from onboard.planning.problem import AvoidanceProblem
from tests.onboard.planning.avoidance_cases import Variety, draw

PLANNER = Planner()


def planned(problem: AvoidanceProblem, current: Plan | None = None) -> Plan:
    plan = PLANNER.plan(problem, current)
    assert isinstance(plan, Plan), plan
    return plan


def test_a_reason_lists_every_failure_of_the_attempt() -> None:
    certificate = Certificate(("jerk limit on x exceeded by 1 m/s³", "left of the lane by 0.2 m"))
    assert not certificate.valid
    said = reason("qp, left", certificate)
    assert said == "qp, left: jerk limit on x exceeded by 1 m/s³, left of the lane by 0.2 m"


def test_a_certificate_without_failures_is_valid() -> None:
    assert Certificate(()).valid


def test_a_plan_of_each_kind_has_what_belongs_to_it() -> None:
    qp = planned(draw(Random(3), Variety()))
    assert qp.kind == "qp"
    assert qp.side in {"left", "right"}
    assert qp.crossing_s is not None
    assert math.isfinite(qp.cost)
    # A wall across both lanes, with room to stop: there is nothing to do but brake.
    problem = draw(Random(3), Variety(drift=False))
    x_m, y_m, z_m = problem.start.position_leg_m
    start = problem.start._replace(position_leg_m=(x_m - 20.0, y_m, z_m))
    face = problem.region.keep_out
    wall = Box(face.x_min_m, face.x_max_m, -100.0, 100.0)
    brake = planned(dataclasses.replace(problem, start=start, further_keep_outs=(wall,)))
    assert brake.kind == "brake"
    assert brake.side is None
    assert brake.crossing_s is None
    assert brake.cost == math.inf
    assert brake.certificate.valid


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_what_remains_of_a_plan_certifies_and_is_not_given_up_for_less(share: float) -> None:
    problem = draw(Random(7), Variety())
    plan = planned(problem)
    now_s = plan.trajectory.start_s + share * (plan.trajectory.end_s - plan.trajectory.start_s)
    middle = dataclasses.replace(problem, start=plan.trajectory.sample(now_s), start_s=now_s)
    following = planned(middle, plan)
    assert following.trajectory.start_s == now_s
    assert certify_avoidance(following.trajectory, middle).valid
    rest = plan.trajectory.from_time(now_s)
    assert certify_avoidance(rest, middle).valid


def test_a_plan_that_has_ended_is_not_continued() -> None:
    problem = draw(Random(7), Variety())
    plan = planned(problem)
    later = dataclasses.replace(problem, start_s=plan.trajectory.end_s + 1.0)
    following = planned(later, plan)
    assert following.trajectory.start_s == later.start_s
    fresh = planned(later)
    assert following.trajectory.jerk_leg_mps3.tobytes() == fresh.trajectory.jerk_leg_mps3.tobytes()


def test_no_plan_says_why_for_every_attempt() -> None:
    problem = draw(Random(9), Variety(drift=False))
    x_m = problem.region.keep_out.x_min_m - 0.05
    start = problem.start._replace(
        position_leg_m=(x_m, 0.0, 0.0),
        velocity_leg_mps=(problem.envelope.speed_max_mps, 0.0, 0.0),
    )
    found = PLANNER.plan(dataclasses.replace(problem, start=start))
    assert isinstance(found, NoPlan)
    attempts = [text.split(":")[0] for text in found.reasons]
    assert {"vertex, left", "vertex, right", "brake"} <= set(attempts)
    assert attempts[-1] == "brake"
