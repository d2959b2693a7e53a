"""Another simulated vehicle, as the sensors of this one see it, and as it may touch this one."""

from __future__ import annotations

import math
import random
from typing import Final

from sitl.environment.movers.config import MoverConfig, Waypoints
from sitl.environment.movers.movers import Mover

KIND: Final = "vehicle"


class OtherVehicle(Mover):
    """A round body whose motion another simulation computes.

    Between two placements it goes on as it did: its error after 20 ms at 10 m/s² is 2 mm.

    Args:
        name: of the vehicle.
        radius_m: of its body, rotors included.
        position_ned_m: where it is at first, in the local frame of the vehicle that sees it.
    """

    def __init__(self, name: str, radius_m: float, position_ned_m: tuple[float, float]) -> None:
        path = Waypoints(kind="waypoints", places_ned_m=(position_ned_m,))
        config = MoverConfig(id=name, kind=KIND, size_m=2.0 * radius_m, speed_mps=0.0, path=path)
        super().__init__(config, random.Random(0))
        self._placed_ned_m, self._placed_s = self.position_ned_m, 0.0

    def place(
        self,
        now_s: float,
        position_ned_m: tuple[float, float],
        velocity_ned_mps: tuple[float, float],
    ) -> None:
        """Say where it is now and how it moves, in that frame."""
        self._placed_ned_m, self._placed_s = position_ned_m, now_s
        self.position_ned_m, self.velocity_ned_mps = position_ned_m, velocity_ned_mps

    def distance_m(self, point_ned_m: tuple[float, float]) -> float:
        """Return the distance of a point from it; 0 inside."""
        return max(math.dist(self.position_ned_m, point_ned_m) - self.half_m, 0.0)

    def advance(
        self,
        now_s: float,
        step_s: float,  # noqa: ARG002  since it was placed, not since the last step
        vehicle_ned_m: tuple[float, float],  # noqa: ARG002  it heeds no simulated mover's aim
        velocity_ned_mps: tuple[float, float],  # noqa: ARG002  likewise
    ) -> None:
        """Go on as it moved when it was placed."""
        (north_m, east_m), (north_mps, east_mps) = self._placed_ned_m, self.velocity_ned_mps
        passed_s = now_s - self._placed_s
        self.position_ned_m = (north_m + passed_s * north_mps, east_m + passed_s * east_mps)
