"""The Region of Influence of stopping in front of an obstacle and sidestepping it.

THEORY.md, "Stop and sidestep", has the proofs.  The vehicle brakes to rest before the inflated
face, looks, moves beside it and goes on.  Nothing but its reference enters: the tracking error is
part of the inflation.  The same formulas run on floats and on arrays.

====  =============================================================================
V b   greatest speed along the leg, braking limit
w d   lateral speed of a drift back to the leg line, least lateral limit
T τ   attitude lag and reaction time
κ     run per speed after a loss of the setpoint stream; 0 without passive safety
F     front: from the inflated face to where stopping has to begin
o     overhang: room beside the inflated face
====  =============================================================================
"""

from __future__ import annotations

from typing import Final

from onboard.contract.arithmetic import Arithmetic
from onboard.contract.region import Dimensions, Encounter
from onboard.geometry.frames import Q

# Between a place at rest and the inflated face: the diagonal of a cell of the space seen free, in
# which the vehicle may move, and a little for round-off.
PLANNING_ROOM_M: Final = 0.15
# Least overhang: it moves along a line that far beside the inflated face.
OVERHANG_M: Final = 2.0 * PLANNING_ROOM_M
# With passive safety it runs on beside the face as well, the farther, the faster it sidesteps.
PASSIVE_OVERHANG_M: Final = 0.5


def run_on_ahead_m(speed_mps: Q, brake_mps2: Q, slope_s: Q, ops: Arithmetic[Q]) -> Q:
    """Return the largest of braking way and run at any speed on the way to rest, less braking.

    The maximum over 0 <= v <= V of (V² - v²)/2b + κ v, less V²/2b.
    """
    braking_m = speed_mps * speed_mps / (2.0 * brake_mps2)
    fastest_m = slope_s * speed_mps - braking_m
    slower_m = slope_s * slope_s * brake_mps2 / 2.0
    return ops.where(speed_mps <= slope_s * brake_mps2, fastest_m, slower_m)


def stop_dimensions(
    e: Encounter[Q], slope_s: Q, *, passive_safety: bool, ops: Arithmetic[Q]
) -> Dimensions[Q]:
    """Return the size of the region of stopping and sidestepping.

    Args:
        e: what is met, by the reference alone: V, and w of a drift; run-on as `run_on_ahead_m`.
        slope_s: κ.
        passive_safety: whether the vehicle may run on at any time.
        ops: for floats or arrays.
    """
    stopping_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2)
    late_m = e.speed_mps * (e.reaction_time_s + e.attitude_lag_s)
    least_m = PASSIVE_OVERHANG_M if passive_safety else OVERHANG_M
    w = e.lateral_speed_mps
    # A drift ends that far beyond where its end begins, and so far beside a face it may begin.
    left_m, right_m = (
        w * (e.attitude_lag_s + slope_s) + w * w / (2.0 * limit_mps2)
        for limit_mps2 in (e.left_mps2, e.right_mps2)
    )
    outwards_m = ops.maximum(left_m, right_m)
    overhang_m = ops.maximum(outwards_m, outwards_m * 0.0 + least_m) + outwards_m
    nothing = e.speed_mps * 0.0
    return Dimensions(
        flat=stopping_m >= 0.0,
        collision_set_depth_m=stopping_m,
        front_m=e.run_on_m + stopping_m + late_m + PLANNING_ROOM_M,
        overhang_left_m=overhang_m,
        overhang_right_m=overhang_m,
        coast_left_m=nothing,
        coast_right_m=nothing,
        drift_left_m=left_m,
        drift_right_m=right_m,
        recovery_m=e.size_along_m,
        pob_depth_m=e.size_along_m,
        avoidance_time_s=e.speed_mps / e.brake_mps2,
    )
