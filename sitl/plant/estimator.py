"""The autopilot's estimate of its own motion, and its errors.

Controller, telemetry and the placing of detections use the estimate; only collisions and the truth
log use the truth.  The mechanisms:

* *Wander*: each of the seven errors (position, velocity, heading) is a sum of sines of seeded
  periods and phases, so it never exceeds its bound, and is the same at every tick rate.  Of the
  heading one sine is most of it: the recorded heading swings slowly from one side to the other,
  by 10° within 5 s where it wanders most.  Position
  and velocity wander by themselves, as the two innovations of a real filter do: a position
  controller then settles where its gain balances the velocity's error, which is most of the
  tracking error of PX4's simulator, and why a higher MPC_XY_P lowers it.
* *Dead reckoning*: without GPS the velocity's error grows by a constant acceleration (tilt and
  accelerometer bias), up to a bound, and the position's error is its integral.  So a vehicle that
  holds by its own estimate drifts off in truth.
* *Jumps*, which the estimator's peers see as a reset.

At rest on the ground, where the filter detects that it does not move, the wander is small; it grows
within seconds of the take-off.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Final, NamedTuple

from sitl.plant.truth import VehicleTruth

# Share of each sine in the greatest error.
_EVEN_SHARES: Final = (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
_HEADING_SHARES: Final = (0.8, 0.1, 0.1)
_ONE_SINE: Final = (1.0, 0.0, 0.0)
_SHARE_AT_REST: Final = 0.1
_SHARE_TIME_S: Final = 3.0  # of the wander's growth after the take-off
_REST_MPS: Final = 0.02
_REST_RADPS: Final = 0.01


@dataclass(frozen=True)
class EstimatorProfile:
    """Greatest errors of an autopilot's estimator.

    Attributes:
        position_m, height_m: greatest error of the position, per horizontal axis, and vertically.
        velocity_mps, climb_mps: the same of the velocity.
        heading_rad: greatest error of the heading.
        drift_mps2, drift_max_mps: growth and bound of the velocity's error without GPS.
        dead_reckoning_s: how long the position stays valid without GPS.
        aiding_stops_s: how long the filter integrates without GPS.
        at_bound: the worst that the bounds allow in place of a wander: the heading is off by its
            bound at all times, the position swings by one sine from bound to bound.
    """

    position_m: float = 0.0
    height_m: float = 0.0
    velocity_mps: float = 0.0
    climb_mps: float = 0.0
    heading_rad: float = 0.0
    drift_mps2: float = 0.0
    drift_max_mps: float = 0.0
    dead_reckoning_s: float = 5.0
    aiding_stops_s: float = 5.0
    at_bound: bool = False


IDEAL: Final = EstimatorProfile()


class EstimateError(NamedTuple):
    """Estimate less truth: NED position [m] and velocity [m/s], and heading [rad]."""

    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0
    velocity_north_mps: float = 0.0
    velocity_east_mps: float = 0.0
    velocity_down_mps: float = 0.0
    yaw_rad: float = 0.0


class _Wander:
    """A sum of sines that stays within a bound."""

    def __init__(
        self,
        bound: float,
        periods_s: tuple[float, float],
        chance: random.Random,
        shares: tuple[float, float, float] = _EVEN_SHARES,
    ) -> None:
        shortest_s, longest_s = periods_s
        self._bound = bound
        self._sines = [
            (
                share * bound,
                2.0 * math.pi / (shortest_s * (longest_s / shortest_s) ** chance.random()),
                chance.uniform(0.0, 2.0 * math.pi),
            )
            for share in shares
        ]

    def at(self, time_s: float) -> float:
        if self._bound == 0.0:
            return 0.0
        (a1, w1, p1), (a2, w2, p2), (a3, w3, p3) = self._sines
        first = a1 * math.sin(w1 * time_s + p1)
        return first + a2 * math.sin(w2 * time_s + p2) + a3 * math.sin(w3 * time_s + p3)


# The wander's shortest and longest periods [s]; PX4's errors decorrelate within 3 to 8 s.
_POSITION_PERIODS_S: Final = (10.0, 30.0)
_VELOCITY_PERIODS_S: Final = (8.0, 25.0)
_HEIGHT_PERIODS_S: Final = (20.0, 60.0)
_HEADING_PERIODS_S: Final = (15.0, 45.0)


class Estimator:
    """One vehicle's estimator.

    Args:
        profile: greatest errors.
        seed: of the errors in this flight.

    Attributes:
        profile: as given.
        error: estimate less truth, since the last update.
        resets: how often the estimate has jumped.
        lost_for_s: for how long GPS has been missing; 0 while it is present.
    """

    def __init__(self, profile: EstimatorProfile, seed: int = 0) -> None:
        chance = random.Random(f"{seed} estimator")
        self.profile = profile
        self.error = EstimateError()
        self.resets = 0
        self.lost_for_s = 0.0
        shares = _ONE_SINE if profile.at_bound else _EVEN_SHARES
        self._wanders = [
            _Wander(bound, periods_s, chance, shares)
            for bound, periods_s in (
                (profile.position_m, _POSITION_PERIODS_S),
                (profile.position_m, _POSITION_PERIODS_S),
                (profile.height_m, _HEIGHT_PERIODS_S),
                (profile.velocity_mps, _VELOCITY_PERIODS_S),
                (profile.velocity_mps, _VELOCITY_PERIODS_S),
                (profile.climb_mps, _VELOCITY_PERIODS_S),
            )
        ]
        self._wanders.append(
            _Wander(profile.heading_rad, _HEADING_PERIODS_S, chance, _HEADING_SHARES)
        )
        self._wanders_at_all = any(
            (profile.position_m, profile.height_m, profile.velocity_mps, profile.heading_rad)
        )
        drift_rad = chance.uniform(0.0, 2.0 * math.pi)
        self._drift_direction = (math.cos(drift_rad), math.sin(drift_rad))
        self._share = _SHARE_AT_REST
        self._updated_s = 0.0
        self._jumped_ned_m = (0.0, 0.0, 0.0)
        self._gps_wrong_m = 0.0

    @property
    def position_valid(self) -> bool:
        """Whether the estimate of the position is still valid: not for long without GPS."""
        return self.lost_for_s < self.profile.dead_reckoning_s

    def jump(self, north_m: float, east_m: float, down_m: float) -> None:
        """Shift the estimate at once and permanently."""
        north, east, down = self._jumped_ned_m
        self._jumped_ned_m = (north + north_m, east + east_m, down + down_m)
        self.resets += 1

    def update(
        self, truth: VehicleTruth, gps_lost_for_s: float, gps_wrong_m: float
    ) -> VehicleTruth:
        """Advance to the present and return the estimate.

        Args:
            truth: state now.
            gps_lost_for_s: for how long GPS has been missing; 0 while it is present.
            gps_wrong_m: by how much GPS places the vehicle too far north.
        """
        if self.lost_for_s > 0.0 >= gps_lost_for_s and self._drift(self.lost_for_s)[1] > 0.0:
            self.resets += 1  # GPS is back, and pulls the estimate to the true position
        if gps_wrong_m != self._gps_wrong_m:
            self.resets += 1
        self.lost_for_s, self._gps_wrong_m = gps_lost_for_s, gps_wrong_m
        if self._wanders_at_all:
            self._grow(truth)
        self.error = self._error_at(truth.time_s)
        return self.estimate(truth)

    def estimate(self, truth: VehicleTruth) -> VehicleTruth:
        """Return the estimate of a state, by the error at the last update."""
        error = self.error
        if not any(error):
            return truth
        north_m, east_m, down_m = truth.position_ned_m
        north_mps, east_mps, down_mps = truth.velocity_ned_mps
        w, x, y, z = truth.attitude_quaternion
        cosine, sine = math.cos(error.yaw_rad / 2.0), math.sin(error.yaw_rad / 2.0)
        return VehicleTruth(
            truth.time_s,
            (north_m + error.north_m, east_m + error.east_m, down_m + error.down_m),
            (
                north_mps + error.velocity_north_mps,
                east_mps + error.velocity_east_mps,
                down_mps + error.velocity_down_mps,
            ),
            truth.acceleration_ned_mps2,
            (
                cosine * w - sine * z,
                cosine * x - sine * y,
                cosine * y + sine * x,
                cosine * z + sine * w,
            ),
            truth.body_rates_radps,
            truth.rotor_speeds_rpm,
        )

    def _grow(self, truth: VehicleTruth) -> None:
        passed_s = min(max(truth.time_s - self._updated_s, 0.0), _SHARE_TIME_S)
        moves = max(map(abs, truth.velocity_ned_mps)) > _REST_MPS
        turns = max(map(abs, truth.body_rates_radps)) > _REST_RADPS
        wanted = 1.0 if moves or turns else _SHARE_AT_REST
        self._share += (wanted - self._share) * passed_s / _SHARE_TIME_S
        self._updated_s = truth.time_s

    def _error_at(self, now_s: float) -> EstimateError:
        north_m, east_m, down_m = self._jumped_ned_m
        north_m += self._gps_wrong_m
        north_mps = east_mps = down_mps = yaw_rad = 0.0
        if self._wanders_at_all:
            share = 1.0 if self.profile.at_bound else self._share
            wandered = [share * wander.at(now_s) for wander in self._wanders]
            north_m, east_m = north_m + wandered[0], east_m + wandered[1]
            down_m += wandered[2]
            north_mps, east_mps, down_mps, yaw_rad = wandered[3:]
            if self.profile.at_bound:
                yaw_rad = math.copysign(self.profile.heading_rad, self._drift_direction[0])
        if self.lost_for_s > 0.0:
            drift_mps, drift_m = self._drift(self.lost_for_s)
            north, east = self._drift_direction
            north_m, east_m = north_m + north * drift_m, east_m + east * drift_m
            north_mps, east_mps = north_mps + north * drift_mps, east_mps + east * drift_mps
        return EstimateError(north_m, east_m, down_m, north_mps, east_mps, down_mps, yaw_rad)

    def _drift(self, lost_for_s: float) -> tuple[float, float]:
        """Return the errors of velocity [m/s] and position [m] after so long without GPS."""
        rate_mps2, limit_mps = self.profile.drift_mps2, self.profile.drift_max_mps
        if rate_mps2 == 0.0:
            return 0.0, 0.0
        growing_s = min(lost_for_s, limit_mps / rate_mps2)
        drift_m = rate_mps2 * growing_s**2 / 2.0 + limit_mps * (lost_for_s - growing_s)
        return rate_mps2 * growing_s, drift_m
