"""Random pre-conditions that a compliant contract allows, for tests and benchmark alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random

from onboard.contract.agility import GRAVITY_MPS2, AccelerationLimits
from onboard.contract.region import Encounter, RegionOfInfluence
from onboard.geometry.box import Box
from onboard.motion.trajectory import State
from onboard.planning.problem import AvoidanceProblem, Envelope


@dataclass(frozen=True)
class Variety:
    """Which kinds of problem to draw.

    Attributes:
        lag: attitude lag, and so a jerk limit; without it acceleration may jump.
        lopsided: different limits in all four directions.
        drift: lateral speed at entry.
        speeding_up: acceleration along the leg at entry.
        passive_safety: run-on and coast as the setpoint stream stops.
    """

    lag: bool = True
    lopsided: bool = False
    drift: bool = True
    speeding_up: bool = False
    passive_safety: bool = False


def draw(rng: Random, variety: Variety) -> AvoidanceProblem:
    """Draw one problem: half start at full speed, most exactly on the front of the region."""
    limits = _draw_limits(rng, variety)
    speed_max_mps = rng.uniform(0.5, 8.0)
    drift_mps = rng.uniform(0.0, 0.6) if variety.drift else 0.0
    lag_s = rng.uniform(0.02, 0.4) if variety.lag else 0.0
    coast_s = rng.uniform(0.1, 1.0) if variety.passive_safety else 0.0
    run_on_m = speed_max_mps * coast_s + speed_max_mps**2 / (2.0 * limits.brake_mps2)
    encounter = Encounter(
        brake_mps2=limits.brake_mps2,
        forward_mps2=limits.forward_mps2,
        left_mps2=limits.left_mps2,
        right_mps2=limits.right_mps2,
        speed_mps=speed_max_mps,
        lateral_speed_mps=drift_mps,
        size_along_m=rng.uniform(0.3, 6.0),
        size_across_m=rng.uniform(0.5, 6.0),
        attitude_lag_s=lag_s,
        reaction_time_s=rng.uniform(0.0, 0.3),
        run_on_m=run_on_m if variety.passive_safety else 0.0,
        coast_time_s=coast_s,
        coast_drift_m=0.0,
    )
    half_m = encounter.size_across_m / 2.0
    region = RegionOfInfluence.around(Box(0.0, encounter.size_along_m, -half_m, half_m), encounter)
    envelope = Envelope(limits, 25.0, _jerk_limits(limits, lag_s), speed_max_mps)
    start, exit_speed_mps = _draw_start(rng, variety, encounter, region, envelope)
    return AvoidanceProblem(
        start=start,
        start_s=rng.uniform(0.0, 1e4),
        region=region,
        envelope=envelope,
        exit_speed_mps=exit_speed_mps,
        coast_time_s=coast_s,
    )


def _draw_limits(rng: Random, variety: Variety) -> AccelerationLimits:
    along, across = (GRAVITY_MPS2 * math.tan(math.radians(rng.uniform(5, 30))) for _ in "xy")
    if not variety.lopsided:
        return AccelerationLimits(along, along, across, across)
    brake, forward, left, right = (rng.uniform(0.5, 1.0) for _ in range(4))
    return AccelerationLimits(along * brake, along * forward, across * left, across * right)


def _jerk_limits(limits: AccelerationLimits, lag_s: float) -> tuple[float, float, float]:
    if lag_s == 0.0:
        return math.inf, math.inf, math.inf
    across_mps3 = max(limits.left_mps2, limits.right_mps2) / lag_s
    return max(limits.brake_mps2, limits.forward_mps2) / lag_s, across_mps3, across_mps3


def _draw_start(
    rng: Random,
    variety: Variety,
    encounter: Encounter[float],
    region: RegionOfInfluence,
    envelope: Envelope,
) -> tuple[State, float]:
    top_mps = envelope.speed_max_mps
    speed_mps = rng.choice([top_mps, rng.uniform(0.05 * top_mps, top_mps)])
    forward_mps2 = 0.0
    if variety.speeding_up and variety.lag:
        # On a cruise profile, which uses half the limit and will level off at the top speed.
        room_mps2 = math.sqrt(2.0 * envelope.jerk_max_mps3[0] * (top_mps - speed_mps))
        forward_mps2 = rng.random() * min(envelope.limits.forward_mps2 / 2.0, room_mps2)
    late_m = encounter.speed_mps * encounter.reaction_time_s
    x_m = region.approach_x_m + late_m * rng.choice([0.0, 0.0, 1.0, rng.random()])
    y_m, lateral_mps = _draw_lateral(rng, encounter, region)
    # The post-condition asks for the entry speed again (Eq. 17); symmetric limits regain any.
    exit_mps = speed_mps if variety.lopsided else rng.choice([speed_mps, top_mps])
    start = State((x_m, y_m, 0.0), (speed_mps, lateral_mps, 0.0), (forward_mps2, 0.0, 0.0))
    return start, exit_mps


def _draw_lateral(
    rng: Random, encounter: Encounter[float], region: RegionOfInfluence
) -> tuple[float, float]:
    """Across the face with any drift, or beside it with a drift towards it."""
    drift_mps = rng.random() * encounter.lateral_speed_mps
    face = region.obstacle
    match rng.choice(["face", "face", "left", "right"]):
        case "left":
            return face.y_min_m - rng.random() * region.drift_left_m, drift_mps
        case "right":
            return face.y_max_m + rng.random() * region.drift_right_m, -drift_mps
        case _:
            return rng.uniform(face.y_min_m, face.y_max_m), rng.choice([-1, 1]) * drift_mps
