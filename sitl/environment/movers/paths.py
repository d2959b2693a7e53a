"""Where movers go: targets that they head for as fast as they may."""

from __future__ import annotations

import math
import random
from typing import Final, Protocol

from sitl.environment.movers.config import Dash, Hostile, Knot, Pursuit, Trefoil, Waypoints

Point = tuple[float, float]
# After a contact a pursuer goes away for so long.
_RETREAT_S: Final = 6.0
# So often it goes away instead of changing its way, so that the vehicle goes on.
_RETREAT_SHARE: Final = 0.25
_FAR_M: Final = 1e3


class Path(Protocol):
    """Where one mover goes."""

    start_ned_m: Point

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return what the mover heads for now."""
        ...

    def touched(self, now_s: float) -> None:
        """Take note that it touches the vehicle."""
        ...


class WaypointPath:
    """From place to place."""

    def __init__(self, path: Waypoints) -> None:
        self._places = path.places_ned_m
        self.start_ned_m = self._places[0]
        self._waits_for_m = path.begins_within_m
        self._next = 0

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return the next place that has not been reached."""
        del now_s, velocity_ned_mps
        if self._waits_for_m is not None:
            if math.dist(here_ned_m, vehicle_ned_m) > self._waits_for_m:
                return here_ned_m
            self._waits_for_m = None
        if math.dist(here_ned_m, self._places[self._next]) < 1e-6:
            self._next = (self._next + 1) % len(self._places)
        return self._places[self._next]

    def touched(self, now_s: float) -> None:
        """Go on."""


class TrefoilPath:
    """Along a clover leaf, whose points come as fast as the mover goes at its middle."""

    def __init__(self, path: Trefoil, speed_mps: float) -> None:
        self._path = path
        # The fastest point of the curve is at the middle: 3 R per radian.
        self._rate_radps = speed_mps / (3.0 * path.radius_m + 1e-9)
        self.start_ned_m = self._at(0.0)

    def _at(self, now_s: float) -> Point:
        angle_rad = math.radians(self._path.phase_deg) + self._rate_radps * now_s
        reach_m = self._path.radius_m * math.cos(3.0 * angle_rad)
        north_m, east_m = self._path.center_ned_m
        return north_m + reach_m * math.cos(angle_rad), east_m + reach_m * math.sin(angle_rad)

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return where it is now by the curve."""
        del here_ned_m, vehicle_ned_m, velocity_ned_mps
        return self._at(now_s)

    def touched(self, now_s: float) -> None:
        """Go on."""


class KnotPath:
    """Along the shadow of a trefoil knot, each point at its own time."""

    def __init__(self, path: Knot) -> None:
        self._path = path
        self.start_ned_m = self._at(0.0)

    def _at(self, now_s: float) -> Point:
        path = self._path
        angle_rad = math.radians(path.phase_deg) + 2.0 * math.pi * now_s / path.period_s
        north_m, east_m = knot_ned_m(path.scale_m, angle_rad)
        return path.center_ned_m[0] + north_m, path.center_ned_m[1] + east_m

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return where it is now by the curve."""
        del here_ned_m, vehicle_ned_m, velocity_ned_mps
        return self._at(now_s)

    def touched(self, now_s: float) -> None:
        """Go on."""


class PursuitPath:
    """Towards where the vehicle is, or will be."""

    def __init__(self, path: Pursuit) -> None:
        self._path = path
        self.start_ned_m = path.start_ned_m
        self._retreats_until_s = -math.inf

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return the place to meet the vehicle, or one away from it after a contact."""
        if now_s < self._path.begins_s:
            return here_ned_m
        if now_s < self._retreats_until_s:
            return away_from(vehicle_ned_m, here_ned_m)
        return ahead_of(vehicle_ned_m, velocity_ned_mps, self._path.lead_s)

    def touched(self, now_s: float) -> None:
        """Retreat for a while."""
        self._retreats_until_s = now_s + _RETREAT_S


class DashPath:
    """Across the way of the vehicle, in time to meet it."""

    def __init__(self, path: Dash, speed_mps: float, size_m: float) -> None:
        self._path = path
        self.start_ned_m = path.start_ned_m
        # What touches the vehicle is a face.
        way_m = math.dist(path.start_ned_m, path.meets_ned_m) - size_m / 2.0
        self._takes_s = max(way_m, 0.0) / max(speed_mps, 1e-9)
        (from_m, from_east_m), (to_m, to_east_m) = path.start_ned_m, path.meets_ned_m
        far = _FAR_M / max(math.dist(path.start_ned_m, path.meets_ned_m), 1e-9)
        self._beyond_ned_m = (
            to_m + far * (to_m - from_m),
            to_east_m + far * (to_east_m - from_east_m),
        )
        self._goes = False

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return where it stands, until it goes."""
        del now_s
        left_m = math.dist(vehicle_ned_m, self._path.meets_ned_m)
        self._goes |= left_m <= math.hypot(*velocity_ned_mps) * self._takes_s
        return self._beyond_ned_m if self._goes else here_ned_m

    def touched(self, now_s: float) -> None:
        """Go on."""


class HostilePath:
    """One way after another, each for a few seconds: whatever may touch the vehicle."""

    def __init__(self, path: Hostile, noise: random.Random) -> None:
        self.start_ned_m = path.start_ned_m
        self._noise = noise
        self._retreats_until_s = self._changes_s = -math.inf
        self._lead_s, self._aside_m, self._from_rad = 0.0, 0.0, 0.0
        self._near_m = math.inf

    def target_ned_m(
        self, now_s: float, here_ned_m: Point, vehicle_ned_m: Point, velocity_ned_mps: Point
    ) -> Point:
        """Return what to head for: the vehicle, ahead of it, or a place beside its way."""
        if now_s < self._retreats_until_s:
            return away_from(vehicle_ned_m, here_ned_m)
        if now_s >= self._changes_s:
            self._choose(now_s)
            if now_s < self._retreats_until_s:
                return away_from(vehicle_ned_m, here_ned_m)
        near = math.dist(here_ned_m, vehicle_ned_m) < self._near_m
        meet_ned_m = ahead_of(vehicle_ned_m, velocity_ned_mps, self._lead_s)
        if near:
            return meet_ned_m
        return (
            meet_ned_m[0] + self._aside_m * math.cos(self._from_rad),
            meet_ned_m[1] + self._aside_m * math.sin(self._from_rad),
        )

    def _choose(self, now_s: float) -> None:
        noise = self._noise
        if noise.random() < _RETREAT_SHARE:
            self._retreats_until_s = now_s + noise.uniform(4.0, 12.0)
            return
        self._changes_s = now_s + noise.uniform(1.0, 6.0)
        self._lead_s = noise.choice((0.0, 0.5, 1.5, 3.0))
        self._aside_m = noise.choice((0.0, 0.0, 2.5, 5.0))
        self._from_rad = noise.uniform(-math.pi, math.pi)
        self._near_m = noise.choice((math.inf, 4.0, 6.0))

    def touched(self, now_s: float) -> None:
        """Retreat for a while."""
        self._retreats_until_s = now_s + self._noise.uniform(0.5, _RETREAT_S)


def knot_ned_m(scale_m: Point, angle_rad: float) -> Point:
    """Return a point of a knot, (north, east) from its middle, at an angle of its curve."""
    north_m = scale_m[0] / 6.0 * (math.sin(angle_rad) + 2.0 * math.sin(2.0 * angle_rad))
    east_m = scale_m[1] / 5.0 * (math.cos(angle_rad) - 2.0 * math.cos(2.0 * angle_rad))
    return north_m, east_m


def ahead_of(vehicle_ned_m: Point, velocity_ned_mps: Point, lead_s: float) -> Point:
    """Return where the vehicle will be if it keeps its velocity."""
    return (
        vehicle_ned_m[0] + lead_s * velocity_ned_mps[0],
        vehicle_ned_m[1] + lead_s * velocity_ned_mps[1],
    )


def away_from(vehicle_ned_m: Point, here_ned_m: Point) -> Point:
    """Return a place far away, on the other side of the vehicle."""
    north_m, east_m = here_ned_m[0] - vehicle_ned_m[0], here_ned_m[1] - vehicle_ned_m[1]
    length_m = math.hypot(north_m, east_m) or 1.0
    return (
        here_ned_m[0] + _FAR_M * (north_m or 1.0) / length_m,
        here_ned_m[1] + _FAR_M * east_m / length_m,
    )
