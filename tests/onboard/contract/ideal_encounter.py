"""The paper's idealisation of an encounter."""

from __future__ import annotations

from onboard.contract.agility import AccelerationLimits
from onboard.contract.region import Encounter


def ideal_encounter(
    limits: AccelerationLimits, speed_mps: float, size_m: tuple[float, float]
) -> Encounter[float]:
    """Return the encounter of a point mass that reacts at once, without errors."""
    return Encounter(
        brake_mps2=limits.brake_mps2,
        forward_mps2=limits.forward_mps2,
        left_mps2=limits.left_mps2,
        right_mps2=limits.right_mps2,
        speed_mps=speed_mps,
        lateral_speed_mps=0.0,
        size_along_m=size_m[0],
        size_across_m=size_m[1],
        attitude_lag_s=0.0,
        reaction_time_s=0.0,
        run_on_m=0.0,
        coast_time_s=0.0,
        coast_drift_m=0.0,
    )
