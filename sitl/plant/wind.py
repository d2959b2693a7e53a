"""Wind: a constant mean, discrete gusts, and Dryden turbulence.

Turbulence is the Dryden model of MIL-HDBK-1797B below 1000 ft, sampled along a vehicle's path at
the relative air speed: shaping filters driven by white noise, one seed one sequence.  Intensities
are given directly instead of through the wind at 20 ft, and the three components are taken along
the mean wind, across it, and down.
"""

from __future__ import annotations

import math
import random
from typing import Annotated

from pydantic import Field

from onboard.files.yaml_file import FileModel
from sitl.plant.multirotor import Wind

_FEET_PER_M = 1.0 / 0.3048
_AIR_SPEED_MIN_MPS = 0.5  # turbulence goes on while the vehicle hovers

Vector = tuple[float, float, float]
VectorKey = Annotated[Vector, Field(strict=False)]


class Gust(FileModel):
    """A "1 - cosine" gust: rises to ``peak_ned_mps`` at its middle and falls again."""

    start_s: Annotated[float, Field(ge=0.0)]
    duration_s: Annotated[float, Field(gt=0.0)]
    peak_ned_mps: VectorKey

    def share(self, now_s: float) -> float:
        """Share of the peak at ``now_s``, 0 to 1."""
        phase = (now_s - self.start_s) / self.duration_s
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * phase)) if 0.0 < phase < 1.0 else 0.0


class WindConfig(FileModel):
    """The air's motion; still by default.

    Attributes:
        turbulence_mps: standard deviation of the horizontal turbulence; 0 for none.
    """

    mean_ned_mps: VectorKey = (0.0, 0.0, 0.0)
    gusts: Annotated[tuple[Gust, ...], Field(strict=False)] = ()
    turbulence_mps: Annotated[float, Field(ge=0.0)] = 0.0


class WindModel:
    """Wind at the vehicle, constant from one sample to the next."""

    def __init__(self, config: WindConfig, noise: random.Random) -> None:
        self._config = config
        self._noise = noise
        self._along_mps = 0.0
        self._across = (0.0, 0.0)
        self._down = (0.0, 0.0)
        north, east, _ = config.mean_ned_mps
        heading_rad = math.atan2(east, north)
        self._heading = math.cos(heading_rad), math.sin(heading_rad)

    def add(self, gust: Gust) -> None:
        """Add one gust."""
        self._config = self._config.model_copy(update={"gusts": (*self._config.gusts, gust)})

    def sample(
        self, now_s: float, period_s: float, height_m: float, velocity_ned_mps: Vector
    ) -> Wind:
        """Return the wind, for the period from ``now_s`` on, where the vehicle flies."""
        north, east, down = self._config.mean_ned_mps
        for gust in self._config.gusts:
            share = gust.share(now_s)
            north += share * gust.peak_ned_mps[0]
            east += share * gust.peak_ned_mps[1]
            down += share * gust.peak_ned_mps[2]
        if self._config.turbulence_mps > 0.0:
            air_speed_mps = math.dist(velocity_ned_mps, self._config.mean_ned_mps)
            air_speed_mps = max(air_speed_mps, _AIR_SPEED_MIN_MPS)
            along, across, sink = self._turbulence(period_s, height_m, air_speed_mps)
            cosine, sine = self._heading
            north += along * cosine - across * sine
            east += along * sine + across * cosine
            down += sink
        return Wind(north, east, down)

    def _turbulence(
        self, period_s: float, height_m: float, air_speed_mps: float
    ) -> tuple[float, float, float]:
        """Advance the Dryden filters by one period; velocities along, across and down [m/s]."""
        height_ft = min(max(height_m * _FEET_PER_M, 10.0), 1000.0)
        shape = 0.177 + 0.000823 * height_ft
        length_down_m = height_ft / _FEET_PER_M
        length_m = length_down_m / shape**1.2
        sigma_mps = self._config.turbulence_mps
        sigma_down_mps = sigma_mps * shape**0.4

        flown_m = period_s * air_speed_mps
        decay = math.exp(-flown_m / length_m)
        kick = sigma_mps * math.sqrt(1.0 - decay * decay)
        self._along_mps = decay * self._along_mps + kick * self._noise.gauss(0.0, 1.0)
        self._across, across = self._second_order(self._across, sigma_mps, flown_m / length_m)
        self._down, down = self._second_order(self._down, sigma_down_mps, flown_m / length_down_m)
        return self._along_mps, across, down

    def _second_order(
        self, memory: tuple[float, float], sigma_mps: float, share: float
    ) -> tuple[tuple[float, float], float]:
        """Advance sigma sqrt(tau) (1 + sqrt(3) tau s) / (1 + tau s)^2 by a share of tau.

        Both lags are sampled exactly; noise held over a period has the power of white noise.
        """
        decay = math.exp(-share)
        noise = self._noise.gauss(0.0, 1.0) * sigma_mps / math.sqrt(share)
        first = decay * memory[0] + (1.0 - decay) * noise
        second = decay * memory[1] + (1.0 - decay) * first
        # (1 + sqrt3 tau s)/(1 + tau s) = sqrt3 + (1 - sqrt3)/(1 + tau s), applied to the first lag.
        return (first, second), math.sqrt(3.0) * first + (1.0 - math.sqrt(3.0)) * second
