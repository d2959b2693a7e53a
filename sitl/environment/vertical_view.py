"""What of an upright box a sensor with a limited view up and down sees, as its body tilts.

The sensor boxes what it sees: what reaches out of its view is reported to end at its edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.plant.truth import VehicleTruth

# A face is reported within this of the sensor; at the sensor no angle says anything.
_NEAR_M = 0.1
# Steeper edges of a view see straight up, or down.
_STEEP_RAD = math.radians(89.0)


class VerticalView(NamedTuple):
    """A view up and down at one instant.

    Attributes:
        down_m: of the sensor, local NED.
        up_rad, low_rad: elevation of the upper and the lower edge, above the level.
    """

    down_m: float
    up_rad: float
    low_rad: float

    @classmethod
    def of(
        cls, stated_deg: tuple[float, float], truth: VehicleTruth, bearing_rad: float
    ) -> VerticalView:
        """Return the view of a body that tilts.

        Args:
            stated_deg: up and down from the level body.
            truth: of the body.
            bearing_rad: where it looks, clockwise from north.
        """
        ahead_rad = bearing_rad - truth.yaw_rad
        lifted_rad = truth.pitch_rad * math.cos(ahead_rad) - truth.roll_rad * math.sin(ahead_rad)
        up_deg, down_deg = stated_deg
        up_rad, low_rad = math.radians(up_deg) + lifted_rad, lifted_rad - math.radians(down_deg)
        return cls(truth.position_ned_m[2], min(up_rad, _STEEP_RAD), max(low_rad, -_STEEP_RAD))

    def seen_m(
        self, top_m: float, bottom_m: float, nearest_m: float, farthest_m: float
    ) -> tuple[float, float] | None:
        """Return top and bottom, positive down, of what is in view; None if nothing is.

        Args:
            top_m: of the box; may be infinite.
            bottom_m: likewise.
            nearest_m: least distance of the box, seen from above.
            farthest_m: greatest.
        """
        near_m, far_m = max(nearest_m, _NEAR_M), max(farthest_m, _NEAR_M)
        # The highest and the lowest place of the box that is in view.
        highest_m = self.down_m - max(near_m * math.tan(self.up_rad), far_m * math.tan(self.up_rad))
        lowest_m = self.down_m - min(
            near_m * math.tan(self.low_rad), far_m * math.tan(self.low_rad)
        )
        if highest_m >= bottom_m or lowest_m <= top_m:
            return None
        # Of its near side: what is higher up is seen farther away, above its edge, or not at all.
        return max(top_m, highest_m), min(bottom_m, lowest_m)
