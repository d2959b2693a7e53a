"""Oracles about the reference: tracking, limits, continuity, and the induction's conditions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from gcs_tools.campaign.oracles.evidence import ROUND_OFF, Evidence, given, in_leg
from gcs_tools.campaign.oracles.plans import BORDER_M
from onboard.contract.agility import GRAVITY_MPS2
from onboard.guidance.phases import FLYING_PHASES

ENTRY_LATERAL_MPS: Final = 1e-3


def tracked_reference(evidence: Evidence) -> Iterator[str]:
    """The true path of an undisturbed flight stays within E_tr of the reference."""
    limit_m = evidence.case.scenario.contract.vehicle.tracking_error_m
    if not evidence.undisturbed:
        return
    worst_m = evidence.true_tracking_error_m
    if worst_m > limit_m:
        yield f"flown {worst_m:.3f} m beside the reference, {limit_m:.3f} m declared"


def setpoints_in_limits(evidence: Evidence) -> Iterator[str]:
    """Setpoints stay in the inner box of erratum 7, with the climb of erratum 8."""
    vehicle = evidence.case.scenario.contract.vehicle
    tan_pitch = math.tan(math.radians(vehicle.pitch_max_deg))
    tan_roll = math.tan(math.radians(vehicle.roll_max_deg))
    thrust_mps2 = vehicle.thrust_to_weight * GRAVITY_MPS2
    for state in evidence.states:
        asked = state.reference_acceleration_ned_mps2
        if asked is None or state.phase not in FLYING_PHASES:
            continue
        along_mps2, across_mps2 = in_leg(asked, given(state.leg_heading_rad))
        lift_mps2 = GRAVITY_MPS2 - asked[2]
        if (
            abs(along_mps2) > tan_pitch * lift_mps2 + ROUND_OFF
            or abs(across_mps2) > tan_roll * lift_mps2 + ROUND_OFF
            or math.hypot(along_mps2, across_mps2, lift_mps2) > thrust_mps2 + ROUND_OFF
        ):
            yield (
                f"setpoint asks for {along_mps2:.3f} m/s² along and {across_mps2:.3f} m/s² across, "
                f"in {state.phase}"
            )


def continuous_reference(evidence: Evidence) -> Iterator[str]:
    """From tick to tick, the reference moves no farther than its velocity allows."""
    for before, after in pairwise(evidence.states):
        here_m, there_m = before.reference_position_ned_m, after.reference_position_ned_m
        if (
            {before.phase, after.phase} <= FLYING_PHASES
            and here_m is not None
            and there_m is not None
        ):
            speeds_mps = (
                math.hypot(*given(state.reference_velocity_ned_mps)) for state in (before, after)
            )
            moved_m, elapsed_s = math.dist(here_m, there_m), after.time_s - before.time_s
            # Plus a generous bound on the change of speed within the tick.
            if moved_m > max(speeds_mps) * elapsed_s + GRAVITY_MPS2 * elapsed_s**2 + ROUND_OFF:
                yield f"the reference jumps by {moved_m:.3f} m in {elapsed_s:.2f} s"


def entry_condition(evidence: Evidence) -> Iterator[str]:
    """An avoidance begins at most at V_cruise along and V_recentring across (pre-condition)."""
    vehicle = evidence.case.scenario.contract.vehicle
    fastest_mps = vehicle.cruise_speed_mps
    aside_mps = vehicle.recentring_speed_mps + ENTRY_LATERAL_MPS
    for before, after in pairwise(evidence.states):
        if (before.phase, after.phase) == ("cruise", "avoid"):
            velocity_mps = given(before.reference_velocity_ned_mps)
            along_mps, across_mps = in_leg(velocity_mps, given(before.leg_heading_rad))
            if abs(across_mps) > aside_mps or not -1e-6 <= along_mps <= fastest_mps + 1e-6:
                yield f"avoidance entered at {along_mps:.3f} m/s along, {across_mps:.3f} m/s across"


def exit_condition(evidence: Evidence) -> Iterator[str]:
    """An avoidance ends outside the region and without lateral speed (post-condition)."""
    plan, plans = None, iter(evidence.flight.plans)
    upcoming = next(plans, None)
    for before, after in pairwise(evidence.states):
        while upcoming is not None and upcoming.time_s <= before.time_s:
            plan, upcoming = upcoming, next(plans, None)
        if (before.phase, after.phase) != ("avoid", "cruise") or plan is None:
            continue
        heading_rad = given(before.leg_heading_rad)
        _, across_mps = in_leg(given(after.reference_velocity_ned_mps), heading_rad)
        ahead_m, _ = in_leg(given(after.reference_position_ned_m), heading_rad)
        border_m = max(in_leg(corner, heading_rad)[0] for corner in plan.region_ned_m)
        if abs(across_mps) > ENTRY_LATERAL_MPS or ahead_m < border_m - BORDER_M:
            yield (
                f"avoidance left {border_m - ahead_m:.3f} m before the border of the region, "
                f"at {across_mps:.3f} m/s across"
            )
