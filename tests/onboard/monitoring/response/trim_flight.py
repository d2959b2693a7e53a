"""A vehicle in a wind: what attitude and velocity its autopilot would report."""

import math
from collections.abc import Iterator

from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import TICK_S
from onboard.vehicle_state import Pose

Horizontal = tuple[float, float]


def poses(
    duration_s: float,
    *,
    start_s: float = 0.0,
    acceleration_mps2: Horizontal = (0.0, 0.0),
    velocity_mps: Horizontal = (0.0, 0.0),
    wind_mps: Horizontal = (0.0, 0.0),
    drag_per_s: float = 0.45,
    yaw_rad: float = 0.0,
) -> Iterator[Pose]:
    """Fly with a constant acceleration, north and east, and tilt as that and the drag ask for."""
    for step in range(1, round(duration_s / TICK_S) + 1):
        elapsed_s = step * TICK_S
        vn_mps, ve_mps = (
            v + a * elapsed_s for v, a in zip(velocity_mps, acceleration_mps2, strict=True)
        )
        north_mps2 = acceleration_mps2[0] + drag_per_s * (vn_mps - wind_mps[0])
        east_mps2 = acceleration_mps2[1] + drag_per_s * (ve_mps - wind_mps[1])
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        forward_mps2 = cosine * north_mps2 + sine * east_mps2
        right_mps2 = cosine * east_mps2 - sine * north_mps2
        yield Pose(
            start_s + elapsed_s,
            (0.0, 0.0, -4.0),
            (vn_mps, ve_mps, 0.0),
            math.atan(right_mps2 / GRAVITY_MPS2),
            -math.atan(forward_mps2 / GRAVITY_MPS2),
            yaw_rad,
        )
