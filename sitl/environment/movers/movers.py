"""Movers under way: where each is, and contacts with the vehicle, moving or at rest."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Final

from sitl.environment.movers.config import (
    Dash,
    Hostile,
    Knot,
    MoverConfig,
    Pursuit,
    Trefoil,
    Waypoints,
)
from sitl.environment.movers.paths import (
    DashPath,
    HostilePath,
    KnotPath,
    Path,
    PursuitPath,
    TrefoilPath,
    WaypointPath,
)

# A vehicle that is slower than this is at rest.
REST_MPS: Final = 0.2
# Movers go on in steps no longer than this.
_STEP_S: Final = 0.02


class Mover:
    """One mover.

    Attributes:
        config: as given.
        position_ned_m: its centre now.
        velocity_ned_mps: over the last step.
    """

    def __init__(self, config: MoverConfig, noise: random.Random) -> None:
        self.config = config
        self._path = _path_of(config, noise)
        self.position_ned_m = self._path.start_ned_m
        self.velocity_ned_mps = (0.0, 0.0)

    @property
    def half_m(self) -> float:
        """Half of its edge."""
        return self.config.size_m / 2.0

    @property
    def heights_m(self) -> tuple[float, float]:
        """Its top and bottom, local NED; infinite where it is a pillar."""
        top_m = self.config.top_m
        return (-math.inf, math.inf) if top_m is None else (-top_m, 0.0)

    def distance_m(self, point_ned_m: tuple[float, float]) -> float:
        """Return the distance of a point from it; 0 inside."""
        return math.hypot(
            *(
                max(abs(own - other) - self.half_m, 0.0)
                for own, other in zip(self.position_ned_m, point_ned_m, strict=True)
            )
        )

    def advance(
        self,
        now_s: float,
        step_s: float,
        vehicle_ned_m: tuple[float, float],
        velocity_ned_mps: tuple[float, float],
    ) -> None:
        """Go on for a step, no faster than it may."""
        wanted = self._path.target_ned_m(
            now_s, self.position_ned_m, vehicle_ned_m, velocity_ned_mps
        )
        before = self.position_ned_m
        north_m, east_m = wanted[0] - before[0], wanted[1] - before[1]
        away_m = math.hypot(north_m, east_m)
        share = min(1.0, self.config.speed_mps * step_s / away_m) if away_m > 0.0 else 0.0
        self.position_ned_m = (before[0] + share * north_m, before[1] + share * east_m)
        self.velocity_ned_mps = (share * north_m / step_s, share * east_m / step_s)

    def touch(self, now_s: float) -> None:
        """Take note of a contact."""
        self._path.touched(now_s)


class Movers:
    """All movers of a world, in lock step with its vehicle.

    Args:
        configs: what moves.
        radius_m: of the vehicle.
        seed: of everything random.

    Attributes:
        contacts_moving: how often the vehicle moved while something touched it.
        contacts_at_rest: how often it was touched at rest.
        clearance_min_m: least distance from body to mover so far, infinite without movers.
        speed_at_contact_mps: greatest speed of the vehicle while it was touched.
    """

    def __init__(self, configs: Sequence[MoverConfig], radius_m: float, seed: int) -> None:
        self.all = [Mover(config, random.Random(f"{seed} {config.id}")) for config in configs]
        self._radius_m = radius_m
        self._time_s = 0.0
        self._touching: dict[str, bool] = {}
        self.contacts_moving = self.contacts_at_rest = 0
        self.clearance_min_m, self.speed_at_contact_mps = math.inf, 0.0

    def add(self, mover: Mover) -> None:
        """Have one more mover in the world; the sensors see it, too."""
        self.all.append(mover)

    def advance(
        self,
        now_s: float,
        vehicle_ned_m: tuple[float, float],
        velocity_ned_mps: tuple[float, float],
        *,
        airborne: bool,
        lowest_down_m: float = math.inf,
    ) -> None:
        """Let time pass until now, and look for contacts.

        Args:
            now_s: the time.
            vehicle_ned_m: where the vehicle is, north and east.
            velocity_ned_mps: how it moves.
            airborne: whether it flies; on the ground, movers keep away from it.
            lowest_down_m: where its lowest part is, local NED; infinite: it reaches all of them.
        """
        if not self.all:
            return
        while now_s - self._time_s > 1e-9:
            step_s = min(_STEP_S, now_s - self._time_s)
            self._time_s += step_s
            for mover in self.all:
                mover.advance(self._time_s, step_s, vehicle_ned_m, velocity_ned_mps)
        if airborne:
            speed_mps = math.hypot(*velocity_ned_mps)
            self._look_for_contacts(vehicle_ned_m, lowest_down_m, speed_mps)

    def toward_nearest(self, point_ned_m: tuple[float, float]) -> tuple[float, float]:
        """Return the unit vector (north, east) from a point to the nearest mover; zero without."""
        nearest = min(self.all, key=lambda mover: mover.distance_m(point_ned_m), default=None)
        if nearest is None:
            return 0.0, 0.0
        north_m = nearest.position_ned_m[0] - point_ned_m[0]
        east_m = nearest.position_ned_m[1] - point_ned_m[1]
        length_m = math.hypot(north_m, east_m) or 1.0
        return north_m / length_m, east_m / length_m

    def _look_for_contacts(
        self, vehicle_ned_m: tuple[float, float], lowest_down_m: float, speed_mps: float
    ) -> None:
        for mover in self.all:
            clearance_m = mover.distance_m(vehicle_ned_m) - self._radius_m
            above_m = mover.heights_m[0] - lowest_down_m
            if above_m > 0.0:
                clearance_m = math.hypot(max(clearance_m, 0.0), above_m)
            self.clearance_min_m = min(self.clearance_min_m, clearance_m)
            name = mover.config.id
            if clearance_m >= 0.0:
                self._touching.pop(name, None)
                continue
            mover.touch(self._time_s)
            self.speed_at_contact_mps = max(self.speed_at_contact_mps, speed_mps)
            moving = speed_mps > REST_MPS
            before = self._touching.get(name)
            if before is None and not moving:
                self.contacts_at_rest += 1
            if moving and not before:
                self.contacts_moving += 1
            self._touching[name] = moving or bool(before)


def _path_of(config: MoverConfig, noise: random.Random) -> Path:
    match config.path:
        case Waypoints():
            return WaypointPath(config.path)
        case Trefoil():
            return TrefoilPath(config.path, config.speed_mps)
        case Knot():
            return KnotPath(config.path)
        case Dash():
            return DashPath(config.path, config.speed_mps, config.size_m)
        case Pursuit():
            return PursuitPath(config.path)
        case Hostile():
            return HostilePath(config.path, noise)
