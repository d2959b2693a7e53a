"""Plans the avoidance of one obstacle: Eq. 17 as QPs, else the closed form, else braking.

Every plan that it returns has passed the certifier.  Deterministic: the same problem gives the same
plan, bit for bit, whatever was planned before.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Final

from onboard.motion.trajectory import X, Y
from onboard.planning.certifier import certify_avoidance, certify_clear
from onboard.planning.closed_form import brake_to_hover, vertex_manoeuvre
from onboard.planning.plan import NoPlan, Plan, reason
from onboard.planning.problem import SIDES, cost
from onboard.planning.qp.search import QpPlanner

if TYPE_CHECKING:
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.problem import AvoidanceProblem
    from onboard.planning.qp.solver import QpBackend

__all__ = ["NoPlan", "Plan", "Planner"]

# No avoidance is worth more delay behind a cruise at full speed: where it takes longer, the vehicle
# stops instead.
DELAY_MAX_S: Final = 60.0


class Planner:
    """Plans avoidances; keeps no state from plan to plan but what is the same for all of them.

    Args:
        by_qp: what finds plans by QPs; by default a `QpPlanner` with the backend.
        qp_backend: name of the QP solver.
    """

    def __init__(self, by_qp: QpPlanner | None = None, *, qp_backend: QpBackend = "osqp") -> None:
        self._by_qp = by_qp or QpPlanner(qp_backend)

    def plan(self, problem: AvoidanceProblem, current: Plan | None = None) -> Plan | NoPlan:
        """Return the first certified plan: the cheapest QP, the closed form, or braking.

        Args:
            problem: what to avoid, and from where.
            current: the plan being flown, when ``problem`` starts in the middle of it; what
                remains of it is kept where it certifies and nothing cheaper is found.
        """
        reasons: list[str] = []
        incumbent = _plan_to_continue(problem, current, reasons)
        plan = self._by_qp.plan(problem, current, incumbent, reasons)
        if plan is not None and plan is not incumbent:
            plan = None if _takes_too_long("qp", plan.trajectory, problem, reasons) else plan
        if plan is None:
            plan = _plan_by_formula(problem, reasons)
        if plan is None:
            plan = _plan_to_brake(problem, reasons)
        return NoPlan(tuple(reasons)) if plan is None else plan


def _plan_to_continue(
    problem: AvoidanceProblem, current: Plan | None, reasons: list[str]
) -> Plan | None:
    """What remains of the plan being flown, if it does for the new problem too."""
    if current is None or current.kind == "brake" or problem.start_s >= current.trajectory.end_s:
        return None
    trajectory = current.trajectory.from_time(problem.start_s)
    certificate = certify_avoidance(trajectory, problem)
    if certificate.valid:
        return dataclasses.replace(
            current,
            trajectory=trajectory,
            cost=cost(trajectory, problem),
            certificate=certificate,
        )
    reasons.append(reason("the current plan", certificate))
    return None


def _plan_by_formula(problem: AvoidanceProblem, reasons: list[str]) -> Plan | None:
    """The closed form on the nearer side, else on the other."""
    start, keep_out = problem.start.axis(Y), problem.region.keep_out
    nearer_is_left = 2.0 * start.position_m < keep_out.y_min_m + keep_out.y_max_m
    for side in SIDES if nearer_is_left else SIDES[::-1]:
        trajectory = vertex_manoeuvre(problem, side)
        if trajectory is None:
            reasons.append(f"vertex, {side}: no manoeuvre fits lane, front face and exit speed")
            continue
        if _takes_too_long(f"vertex, {side}", trajectory, problem, reasons):
            continue
        certificate = certify_avoidance(trajectory, problem)
        if certificate.valid:
            return Plan("vertex", trajectory, side, cost(trajectory, problem), certificate)
        reasons.append(reason(f"vertex, {side}", certificate))
    return None


def _takes_too_long(
    what: str, trajectory: Trajectory, problem: AvoidanceProblem, reasons: list[str]
) -> bool:
    distance_m = problem.region.x_pob_m - problem.start.position_leg_m[X]
    cruising_s = distance_m / problem.envelope.speed_max_mps
    late_s = trajectory.end_s - trajectory.start_s - cruising_s
    if late_s <= DELAY_MAX_S:
        return False
    reasons.append(f"{what}: arrives {late_s:.3g} s late (limit {DELAY_MAX_S:g} s)")
    return True


def _plan_to_brake(problem: AvoidanceProblem, reasons: list[str]) -> Plan | None:
    """Brake to a hover short of the obstacle."""
    trajectory = brake_to_hover(problem.start, problem.start_s, problem.envelope)
    keep_outs = (problem.region.keep_out, *problem.further_keep_outs)
    certificate = certify_clear(
        trajectory, problem.start, problem.start_s, problem.envelope, keep_outs
    )
    if certificate.valid:
        return Plan("brake", trajectory, None, math.inf, certificate)
    reasons.append(reason("brake", certificate))
    return None
