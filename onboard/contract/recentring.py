"""Drifting back to the leg line after an avoidance (theory F; the proof is in THEORY.md).

PAPER: the paper's scheme never recovers y (erratum 16).  Here the vehicle drifts back at a small
lateral speed while nothing known stands in the *corridor* beside its way, and comes to rest
sideways as soon as something does:
tests/onboard/contract/test_recentring.py::test_nothing_is_met_that_was_not_seen_in_time.

====  =============================================================================
w v   greatest lateral speed of the drift, errors included; least speed along the leg
k κ   slope of the drift w / v, and its angle
s     lateral distance to a face at which it must be known: room to come to rest
β D   half the field of view, detection range
====  =============================================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Generic

from onboard.contract.arithmetic import Arithmetic
from onboard.contract.region import Encounter
from onboard.geometry.box import Box
from onboard.geometry.frames import Q

# A wider view is counted as this wide: the corridor would have no length ahead.
_HALF_VIEW_MAX_RAD: Final = math.radians(80.0)
# A drift ends with a residue; for less than this none is begun.
DEAD_BAND_M: Final = 0.05
_ROUND_OFF_MPS: Final = 1e-6


@dataclass(frozen=True)
class Drift(Generic[Q]):
    """A drift at its fastest.

    Attributes:
        lateral_mps: w.
        speed_min_mps: v.
        room_m: s.
        ending_s: time in which the vehicle comes to rest sideways.
    """

    lateral_mps: Q
    speed_min_mps: Q
    room_m: Q
    ending_s: Q


def drift_of(
    e: Encounter[Q], *, speed_min_mps: Q, margin_m: Q, notice_s: Q, ops: Arithmetic[Q]
) -> Drift[Q]:
    """Return the drift that an encounter allows for.

    Args:
        e: lateral speed, limits, lag, and the way of the drift once the stream has stopped.
        speed_min_mps: v.
        margin_m: from the vehicle's reference to the real face of what it must not touch.
        notice_s: from something being in view, or the sensor falling silent, to a changed setpoint.
        ops: for floats or arrays.
    """
    w = e.lateral_speed_mps
    stopping_s = w / ops.minimum(e.left_mps2, e.right_mps2)
    late_m = w * (e.attitude_lag_s + notice_s)
    room_m = margin_m + w * stopping_s / 2.0 + late_m + e.coast_drift_m
    return Drift(w, speed_min_mps, room_m, stopping_s + 2.0 * e.attitude_lag_s + notice_s)


def required_view(drift: Drift[Q], range_m: Q, ops: Arithmetic[Q]) -> Q:
    """Return the field of view [rad] with which nothing is met that was not seen in time.

    What is s beside the vehicle now was s + w h beside and v h ahead a time h ago.  It was in view
    if sin β - k cos β >= s / D: that is, β >= κ + asin(s cos κ / D).  Where s cos κ exceeds the
    range no view will do, and more than all round is required.
    """
    v = ops.maximum(drift.speed_min_mps, drift.speed_min_mps * 0.0)
    slope_rad = ops.atan2(drift.lateral_mps, v)
    hypotenuse_mps = ops.sqrt(drift.lateral_mps * drift.lateral_mps + v * v)
    sine = drift.room_m * v / (hypotenuse_mps * range_m)
    cosine = ops.sqrt(ops.maximum(1.0 - sine * sine, sine * 0.0))
    return ops.where(
        sine < 1.0, 2.0 * (slope_rad + ops.atan2(sine, cosine)), sine * 0.0 + 4.0 * math.pi
    )


@dataclass(frozen=True)
class Corridor:
    """The rectangle that has to be free of known obstacles while the vehicle drifts.

    Attributes:
        reach_m: ahead; also the straight way that has to be flown before a drift, so that what is
            beside has been in view.
        side_m: to the side that is drifted to.
        speed_min_mps: along the leg; at less a drift is steeper than the view is wide.
        ending_s: how much sooner than that speed is given up a drift has to end.
    """

    reach_m: float
    side_m: float
    speed_min_mps: float
    ending_s: float

    @classmethod
    def of(cls, drift: Drift[float], field_of_view_rad: float) -> Corridor:
        """Return the corridor in which everything is known, or seen in time.

        Raises:
            ValueError: the drift is steeper than the view is wide.
        """
        tangent = math.tan(min(field_of_view_rad / 2.0, _HALF_VIEW_MAX_RAD))
        slope = drift.lateral_mps / drift.speed_min_mps
        if not 0.0 < slope < tangent:
            raise ValueError(
                f"slope of the drift = {slope:.3f}: must lie above 0 and below {tangent:.3f}, the "
                "slope of the edge of the view"
            )
        reach_m = drift.room_m / (tangent - slope)
        return cls(reach_m, reach_m * tangent, drift.speed_min_mps, drift.ending_s)

    def meets(self, y_m: float, keep_out: Box) -> bool:
        """Tell whether an obstacle in reach stands beside a drift from ``y_m`` to the leg line."""
        left_m, right_m = (y_m - self.side_m, y_m) if y_m > 0.0 else (y_m, y_m + self.side_m)
        return keep_out.y_min_m <= right_m and keep_out.y_max_m >= left_m

    def steady(self, now_mps: float, soon_mps: float) -> bool:
        """Tell whether the speed along the leg is kept up for as long as a drift takes to end."""
        return min(now_mps, soon_mps) >= self.speed_min_mps - _ROUND_OFF_MPS

    def seen(self, y_m: float, *, straight_m: float) -> bool:
        """Tell whether a drift is long enough to begin, and what is beside has been in view."""
        return abs(y_m) > DEAD_BAND_M and straight_m >= self.reach_m
