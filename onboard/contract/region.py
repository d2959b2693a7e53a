"""Collision set boundary, lane, post-obstacle border and Region of Influence of one obstacle.

Everything is in the leg frame: x along the cruise leg, y to its right (the paper's "up").
The derivations, errata and proofs are in THEORY.md; the formulas run on floats and, unchanged, on
NumPy arrays (`onboard.contract.arithmetic`), so a contract surface is the same code as a flight.

Notation (only inside the formulas):

====  =============================================================================
b a   braking and forward acceleration limits
d u   left and right acceleration limits (the paper's down and up)
V w   entry speed along the leg, largest lateral speed at entry
T     attitude lag, a dead time on both axes
S     extent of the obstacle across the leg (y_max - y_min)
t*    time to clear the worst point of the face sideways
t_m   duration of the worst avoidance: min(V/b, t*)
Φ(t)  least advance in time t: V t - b t²/2, then V²/2b once stopped
D     depth of the collision set in front of the face: Φ(t_m)
P     distance from the front face within which the entry speed is regained
====  =============================================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple

from onboard.contract.agility import AccelerationLimits
from onboard.contract.arithmetic import SCALAR, Arithmetic
from onboard.geometry.box import Box
from onboard.geometry.frames import Q


# Records of a contract are named tuples: a frozen dataclass takes four times as long to make, which
# was a fifth of the time of a verdict.
class Encounter(NamedTuple, Generic[Q]):
    """One obstacle and how the vehicle meets it: all inputs of the formulas.

    Attributes:
        brake_mps2, forward_mps2, left_mps2, right_mps2: acceleration limits, magnitudes.
        speed_mps: largest speed along the leg at entry.
        lateral_speed_mps: largest lateral speed at entry, either way (theory A).
        size_along_m, size_across_m: obstacle extents, already inflated (Eq. 18).
        attitude_lag_s: dead time from setpoint to acceleration (theory D).
        reaction_time_s: from being in range to a changed setpoint (theory C).
        run_on_m: forward run after the setpoint stream stops; 0 without passive safety (theory H).
        coast_time_s: time for which the autopilot keeps its velocity then; 0 without it.
        coast_drift_m: way that a recentring drift makes in that time; 0 without it (theory F).
    """

    brake_mps2: Q
    forward_mps2: Q
    left_mps2: Q
    right_mps2: Q
    speed_mps: Q
    lateral_speed_mps: Q
    size_along_m: Q
    size_across_m: Q
    attitude_lag_s: Q
    reaction_time_s: Q
    run_on_m: Q
    coast_time_s: Q
    coast_drift_m: Q


class Dimensions(NamedTuple, Generic[Q]):
    """Size of the Region of Influence, measured from the faces of the (inflated) obstacle.

    Attributes:
        flat: the boundary is flat (Fig. 9a): there is room to stop; else pointed (Fig. 9b).
        collision_set_depth_m: D, front face to the collision set boundary.
        front_m: front face to the front of the region; D, reaction, attitude lag and run-on.
        overhang_left_m, overhang_right_m: lane beyond the side faces that a plan may use.
        coast_left_m, coast_right_m: beyond the lane, used only if the stream stops.
        drift_left_m, drift_right_m: beyond the side faces, where a vehicle that drifts towards
            the face still has to act (theory A).
        recovery_m: P, front face of what the plan keeps out of to the entry speed regained.
        pob_depth_m: front face to the post-obstacle border.
        avoidance_time_s: t_m.
    """

    flat: Any
    collision_set_depth_m: Q
    front_m: Q
    overhang_left_m: Q
    overhang_right_m: Q
    coast_left_m: Q
    coast_right_m: Q
    drift_left_m: Q
    drift_right_m: Q
    recovery_m: Q
    pob_depth_m: Q
    avoidance_time_s: Q


def dimensions(e: Encounter[Q], ops: Arithmetic[Q]) -> Dimensions[Q]:
    """Size of the Region of Influence (Eq. 8-16, 19-33 as corrected, theory A, C, D, H)."""
    clearing_time_s = time_to_clear(e, ops)
    stopping_time_s = e.speed_mps / e.brake_mps2
    t_m = ops.minimum(stopping_time_s, clearing_time_s)
    depth_m = least_advance(e.speed_mps, e.brake_mps2, t_m, ops)
    late_m = e.speed_mps * (e.reaction_time_s + e.attitude_lag_s)
    drift_left_m = drift_right_m = _drift(e.left_mps2, e)
    left = right = overhang(e.left_mps2, e.right_mps2, t_m, e, ops)
    if e.left_mps2 is not e.right_mps2:  # a contract has one limit for both
        drift_right_m = _drift(e.right_mps2, e)
        right = overhang(e.right_mps2, e.left_mps2, t_m, e, ops)
    (left_m, left_peak_mps), (right_m, right_peak_mps) = left, right
    recovery_m = recovery_distance(e, t_m, ops)
    return Dimensions(
        flat=stopping_time_s <= clearing_time_s,
        collision_set_depth_m=depth_m,
        front_m=e.run_on_m + depth_m + late_m,
        # A vehicle may enter that far beyond the face, and drift on outwards until stopped.
        overhang_left_m=ops.maximum(left_m, drift_left_m + drift_right_m),
        overhang_right_m=ops.maximum(right_m, drift_left_m + drift_right_m),
        coast_left_m=left_peak_mps * e.coast_time_s,
        coast_right_m=right_peak_mps * e.coast_time_s,
        drift_left_m=drift_left_m,
        drift_right_m=drift_right_m,
        recovery_m=recovery_m,
        pob_depth_m=ops.maximum(e.size_along_m, recovery_m - e.run_on_m),
        avoidance_time_s=t_m,
    )


def least_advance(speed_mps: Q, brake_mps2: Q, time_s: Q, ops: Arithmetic[Q]) -> Q:
    """Φ(t): the least way made along the leg in ``time_s`` when braking fully, then standing."""
    t = ops.minimum(time_s, speed_mps / brake_mps2)
    return speed_mps * t - brake_mps2 * t * t / 2.0


def time_to_clear(e: Encounter[Q], ops: Arithmetic[Q]) -> Q:
    """Return t*: time to leave the face sideways from its worst point, at the worst entry drift.

    PAPER: Eq. 9/27 lack the factor 2 under the root, which places the boundary too near by up to
    17 % in a band of speeds; tests/onboard/contract/test_region.py::test_printed_eq_9_is_unsafe.
    """
    t = ops.sqrt(2.0 * e.size_across_m / (e.right_mps2 + e.left_mps2))
    rightwards_s = _time_to_clear_against_drift(e.right_mps2, e.left_mps2, t, e, ops)
    if e.left_mps2 is e.right_mps2:
        return rightwards_s
    return ops.maximum(
        rightwards_s, _time_to_clear_against_drift(e.left_mps2, e.right_mps2, t, e, ops)
    )


def _time_to_clear_against_drift(u: Q, d: Q, t: Q, e: Encounter[Q], ops: Arithmetic[Q]) -> Q:
    """Theory A: drift faster than d t* cannot be turned back, only be outrun to the far side."""
    w = e.lateral_speed_mps
    outrun_s = (ops.sqrt(w * w * (1.0 + u / d) + 2.0 * u * e.size_across_m) - w) / u
    return ops.where(w > d * t, outrun_s, t)


def _drift(u: Q, e: Encounter[Q]) -> Q:
    """Way made sideways at the entry drift before ``u`` has stopped it (theory A, D, F)."""
    w = e.lateral_speed_mps
    return e.coast_drift_m + w * e.attitude_lag_s + w * w / (2.0 * u)


def overhang(u: Q, d: Q, t_m: Q, e: Encounter[Q], ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Lane beyond the face on the side that ``u`` points to, and the peak speed towards it.

    PAPER: Eq. 12-13 hold for a point mass; a lateral speed at entry and attitude lag widen the
    lane (erratum 14, theory A, D):
    tests/onboard/contract/test_region.py::test_lane_with_drift_and_lag.
    """
    w, lag_s = e.lateral_speed_mps, e.attitude_lag_s
    crossing_mps = ops.sqrt((w + u * t_m) * (w + u * t_m) + 2.0 * u * w * lag_s)
    peak_mps = crossing_mps + u * lag_s
    overhang_m = crossing_mps * lag_s + u * lag_s * lag_s / 2.0 + peak_mps * peak_mps / (2.0 * d)
    return overhang_m, peak_mps


def recovery_distance(e: Encounter[Q], t_m: Q, ops: Arithmetic[Q]) -> Q:
    """Return P: distance behind the front face within which the entry speed is regained.

    A vehicle that braked for t until clear still moves sideways.  It goes on braking for m, so
    that the lateral speed and the speed deficit vanish together, and is V again after
    (1 + b/a) Φ(t + m) - Φ(t); the worst t is closed form.  One that stops before the face and
    sidesteps needs V²/2a.  Lag costs at most V (1 + b/a) T more.

    PAPER: Eq. 15/33 print the braking limit where the forward limit stands, and are too short for
    boxes that are more lopsided sideways than lengthways, and with a lateral speed at entry:
    tests/onboard/contract/test_region.py::test_printed_eq_15_is_too_short_for_lopsided_limits and
    ::test_printed_eq_15_is_too_short_with_drift.
    """
    b, a, d, u, speed_mps = e.brake_mps2, e.forward_mps2, e.left_mps2, e.right_mps2, e.speed_mps
    k = ops.maximum(ops.maximum(u / d, d / u), b / a)
    m1 = (k * a - b) / (a + b)
    m0 = e.lateral_speed_mps / ops.minimum(u, d) * a / (a + b)
    worst_s = (k * speed_mps - (1.0 + k) * b * m0) / (b * (k * (1.0 + m1) + m1))
    t = ops.maximum(ops.minimum(worst_s, t_m + e.attitude_lag_s), speed_mps * 0.0)
    braking_m = least_advance(speed_mps, b, t + m1 * t + m0, ops)
    swerving_m = (1.0 + b / a) * braking_m - least_advance(speed_mps, b, t, ops)
    stopping_m = speed_mps * speed_mps / (2.0 * a)
    lag_m = speed_mps * (1.0 + b / a) * e.attitude_lag_s
    return ops.maximum(stopping_m, swerving_m) + lag_m


@dataclass(frozen=True)
class RegionOfInfluence:
    """The Region of Influence of one obstacle, placed in the leg frame.

    Attributes:
        obstacle: the obstacle, inflated (Eq. 18); what a vehicle centre must not touch.
        keep_out: the obstacle extended towards the vehicle by the run-on; what a plan must not
            touch.  Equal to ``obstacle`` without passive safety.
        extent: the region itself (Eq. 16): what has to be free of other obstacles for this one to
            be passed for certain (`conflicts_with`).
        apart: what has to be disjoint for any two obstacles, so that the region of one is free of
            the other: with the published form the regions themselves; where the vehicle stops and
            sidesteps, only one overhang lies between two obstacles, half of it counted with each.
        manoeuvre: where an avoidance by Eq. 17, which swerves without stopping, may take place:
            from where it may begin to the post-obstacle border, and as wide as its lane and a
            coast from it.  Equal to ``extent`` with the published form.
        lane_left_m, lane_right_m: y between which the plan stays.
        drift_left_m, drift_right_m: y beyond the side faces within which a vehicle that drifts
            towards the face still counts as heading for it (theory A).
        collision_set_depth_m: D.
        lateral_speed_mps: the lateral speed at entry that the region allows for.
    """

    obstacle: Box
    keep_out: Box
    extent: Box
    apart: Box
    manoeuvre: Box
    lane_left_m: float
    lane_right_m: float
    drift_left_m: float
    drift_right_m: float
    collision_set_depth_m: float
    lateral_speed_mps: float

    @classmethod
    def around(
        cls, obstacle: Box, e: Encounter[float], stop: Dimensions[float] | None = None
    ) -> RegionOfInfluence:
        """Place the region of an encounter around its (inflated) obstacle.

        Args:
            obstacle: inflated.
            e: the encounter of an avoidance by Eq. 17.
            stop: size of the region of stopping and sidestepping; None: the published form.
        """
        size = dimensions(e, SCALAR)
        lane_left_m = obstacle.y_min_m - size.overhang_left_m
        lane_right_m = obstacle.y_max_m + size.overhang_right_m
        manoeuvre = placed(obstacle, size)
        return cls(
            obstacle=obstacle,
            keep_out=Box(
                obstacle.x_min_m - e.run_on_m, obstacle.x_max_m, obstacle.y_min_m, obstacle.y_max_m
            ),
            extent=manoeuvre if stop is None else placed(obstacle, stop),
            apart=manoeuvre if stop is None else placed(obstacle, stop, overhang_share=0.5),
            manoeuvre=manoeuvre,
            lane_left_m=lane_left_m,
            lane_right_m=lane_right_m,
            drift_left_m=size.drift_left_m,
            drift_right_m=size.drift_right_m,
            collision_set_depth_m=size.collision_set_depth_m,
            lateral_speed_mps=e.lateral_speed_mps,
        )

    def shifted_by(self, x_m: float, y_m: float) -> RegionOfInfluence:
        """Return the region moved by (x_m, y_m)."""
        return replace(
            self,
            obstacle=self.obstacle.shifted_by(x_m, y_m),
            keep_out=self.keep_out.shifted_by(x_m, y_m),
            extent=self.extent.shifted_by(x_m, y_m),
            apart=self.apart.shifted_by(x_m, y_m),
            manoeuvre=self.manoeuvre.shifted_by(x_m, y_m),
            lane_left_m=self.lane_left_m + y_m,
            lane_right_m=self.lane_right_m + y_m,
        )

    @property
    def x_pob_m(self) -> float:
        """The post-obstacle border of an avoidance by Eq. 17."""
        return self.manoeuvre.x_max_m

    @property
    def approach_x_m(self) -> float:
        """Where an avoidance may begin at the earliest: the farther of the two fronts."""
        return min(self.extent.x_min_m, self.manoeuvre.x_min_m)

    @property
    def departure_x_m(self) -> float:
        """Where the obstacle has been passed at the latest: the farther of the two borders."""
        return max(self.extent.x_max_m, self.manoeuvre.x_max_m)

    def conflicts_with(self, other: RegionOfInfluence) -> bool:
        """Tell whether the region of one obstacle is not free for the other's sake."""
        return self.apart.intersects(other.apart)

    @property
    def conflict_band_y_m(self) -> tuple[float, float]:
        """The y between which a vehicle that flies along x would meet the obstacle."""
        return (
            self.obstacle.y_min_m - self.drift_left_m,
            self.obstacle.y_max_m + self.drift_right_m,
        )

    def on_collision_course(self, x_m: float, y_m: float) -> bool:
        """Tell whether the vehicle at (x, y), flying along x, would meet the obstacle."""
        left_m, right_m = self.conflict_band_y_m
        return left_m <= y_m <= right_m and x_m <= self.obstacle.x_max_m


def placed(obstacle: Box, size: Dimensions[float], overhang_share: float = 1.0) -> Box:
    """Return a region around its inflated obstacle, or the given share of what it has beside it."""
    left_m = size.overhang_left_m + size.coast_left_m
    right_m = size.overhang_right_m + size.coast_right_m
    return Box(
        obstacle.x_min_m - size.front_m,
        obstacle.x_min_m + size.pob_depth_m,
        obstacle.y_min_m - overhang_share * left_m,
        obstacle.y_max_m + overhang_share * right_m,
    )


def boundary_depth_at(
    y_m: float, obstacle: Box, limits: AccelerationLimits, speed_mps: float
) -> float:
    """Depth of the collision set at one y: x_min - csb(y) [m], 0 beside the face.

    PAPER: Eq. 20 lacks "x_min -", and Eq. 22, 25 and 8/26 have their sign reversed; as printed,
    safe and unsafe are exchanged:
    tests/onboard/contract/test_region.py::test_printed_signs_are_reversed.
    """
    if not obstacle.y_min_m < y_m < obstacle.y_max_m:
        return 0.0
    right_s = math.sqrt(2.0 * (obstacle.y_max_m - y_m) / limits.right_mps2)
    left_s = math.sqrt(2.0 * (y_m - obstacle.y_min_m) / limits.left_mps2)
    return least_advance(speed_mps, limits.brake_mps2, min(right_s, left_s), SCALAR)
