"""Oracles about avoidance plans: certified, in their region, begun in time and not expired."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from gcs_tools.campaign.oracles.evidence import ROUND_OFF, Evidence, in_leg
from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.geometry.frames import FloatArray

# The service's own tolerance at the border of a region.
BORDER_M: Final = 1e-3
# Step of the worst case's integration, and the error that it makes at 10 m/s.
_STEP_S: Final = 1e-3
_ROOM_TOLERANCE_M: Final = 0.01


def certified_plans(evidence: Evidence) -> Iterator[str]:
    """Every plan that is flown has a valid certificate."""
    for plan in evidence.flight.plans:
        if not plan.certificate.valid:
            yield f"plan {plan.kind} round {plan.obstacle} flown without a valid certificate"


def plan_not_expired(evidence: Evidence) -> Iterator[str]:
    """Setpoints during an avoidance belong to a plan that has not ended.

    Flights with a dead or stalled service are left out: it sends nothing, whatever its last state.
    """
    if any(fault.kind in ("daemon_dead", "tick_stall") for fault in evidence.case.scenario.faults):
        return
    plans = iter(evidence.flight.plans)
    plan, upcoming = None, next(plans, None)
    for state in evidence.states:
        while upcoming is not None and upcoming.time_s <= state.time_s + ROUND_OFF:
            plan, upcoming = upcoming, next(plans, None)
        if state.phase != "avoid":
            continue
        if plan is None:
            yield "avoidance without a plan"
        elif plan.end_s is not None and state.time_s > plan.end_s + TICK_S + ROUND_OFF:
            yield f"setpoint sent {state.time_s - plan.end_s:.2f} s after its plan expired"


def plans_in_region(evidence: Evidence) -> Iterator[str]:
    """An avoidance plan never leaves the region of its obstacle (the paper's G_roi)."""
    for plan in evidence.flight.plans:
        if plan.kind == "brake":
            continue
        outside_m = _outside_m(np.array(plan.path_ned_m)[:, :2], np.array(plan.region_ned_m))
        if outside_m > BORDER_M:
            yield f"plan {plan.kind} leaves its region by {outside_m:.3f} m"


def _outside_m(points_ned_m: FloatArray, corners_ned_m: FloatArray) -> float:
    """Return how far the farthest of points (N, 2) is outside a rectangle.

    Args:
        points_ned_m: the points.
        corners_ned_m: of the rectangle, in order, (4, 2).
    """
    origin_m = corners_ned_m[0]
    worst_m = 0.0
    for corner_m in (corners_ned_m[1], corners_ned_m[3]):
        side_m = float(np.linalg.norm(corner_m - origin_m))
        along_m = (points_ned_m - origin_m) @ ((corner_m - origin_m) / side_m)
        worst_m = max(worst_m, float(-along_m.min()), float(along_m.max()) - side_m)
    return worst_m


def entered_in_time(evidence: Evidence) -> Iterator[str]:
    """A region begins where stopping or swerving clear is still possible, by integration.

    Catches a wrong formula for the collision set, which the margins for errors that did not occur
    may hide in the flight itself.
    """
    contract, heading_rad = evidence.case.scenario.contract, _heading_rad(evidence)
    if not evidence.undisturbed:
        return
    for plan in evidence.flight.plans:
        corners_m = [in_leg(corner, heading_rad) for corner in plan.keep_out_ned_m]
        face_m = min(ahead_m for ahead_m, _ in corners_m)
        front_m = min(in_leg(corner, heading_rad)[0] for corner in plan.region_ned_m)
        width_m = max(aside_m for _, aside_m in corners_m) - min(y_m for _, y_m in corners_m)
        required_m = _room_required_m(contract, width_m)
        if face_m - front_m < required_m - _ROOM_TOLERANCE_M:
            yield (
                f"avoidance begins {face_m - front_m:.3f} m before the obstacle, "
                f"where the worst case takes {required_m:.3f} m"
            )


def _room_required_m(contract: Contract, width_m: float) -> float:
    """Return the distance flown, braking and swerving at the limits, until clear or at a stop.

    Passive safety requires more; this is the minimum without it.
    """
    vehicle = contract.vehicle
    brake_mps2 = GRAVITY_MPS2 * math.tan(math.radians(vehicle.pitch_max_deg))
    swerve_mps2 = GRAVITY_MPS2 * math.tan(math.radians(vehicle.roll_max_deg))
    ahead_mps, aside_mps = vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0], 0.0
    ahead_m = ahead_mps * (vehicle.reaction_time_s + vehicle.attitude_lag_s)
    aside_m = 0.0
    while ahead_mps > 0.0 and aside_m < width_m / 2.0:
        ahead_mps -= brake_mps2 * _STEP_S
        aside_mps += swerve_mps2 * _STEP_S
        ahead_m += ahead_mps * _STEP_S
        aside_m += aside_mps * _STEP_S
    return ahead_m


def _heading_rad(evidence: Evidence) -> float:
    """Return the direction of the first leg; generated missions have no other."""
    mission = evidence.case.scenario.mission
    north_m, east_m = mission.start_ned_m
    end_north_m, end_east_m = mission.legs[0].end_ned_m
    return math.atan2(end_east_m - east_m, end_north_m - north_m)
