"""Wind: mean, gusts and turbulence."""

from __future__ import annotations

import math
import random
import statistics

import pytest

from sitl.plant.wind import Gust, WindConfig, WindModel

PERIOD_S = 0.01
STILL = (0.0, 0.0, 0.0)


def model(config: WindConfig, seed: int = 1) -> WindModel:
    return WindModel(config, random.Random(seed))


def test_air_is_still_by_default() -> None:
    assert model(WindConfig()).sample(3.0, PERIOD_S, 10.0, STILL) == (0.0, 0.0, 0.0)


def test_gust_rises_to_its_peak_and_falls_on_top_of_the_mean() -> None:
    gust = Gust(start_s=2.0, duration_s=4.0, peak_ned_mps=(6.0, 0.0, -2.0))
    wind = model(WindConfig(mean_ned_mps=(1.0, 0.0, 0.0), gusts=(gust,)))
    assert wind.sample(1.9, PERIOD_S, 10.0, STILL).north_mps == 1.0
    assert wind.sample(4.0, PERIOD_S, 10.0, STILL) == pytest.approx((7.0, 0.0, -2.0))
    assert wind.sample(3.0, PERIOD_S, 10.0, STILL).north_mps == pytest.approx(4.0)
    assert wind.sample(6.1, PERIOD_S, 10.0, STILL).north_mps == 1.0


@pytest.mark.parametrize("period_s", [PERIOD_S, 2.0 * PERIOD_S])
def test_turbulence_has_the_stated_intensity_and_is_correlated(period_s: float) -> None:
    wind = model(WindConfig(turbulence_mps=1.5))
    samples = [wind.sample(i * period_s, period_s, 300.0, (60.0, 0.0, 0.0)) for i in range(150_000)]
    # At 1000 ft the Dryden model is isotropic: all three components have the same intensity.
    for axis in range(3):
        component = [sample[axis] for sample in samples]
        assert statistics.fmean(component) == pytest.approx(0.0, abs=0.25)
        assert statistics.pstdev(component) == pytest.approx(1.5, rel=0.12)
    along = [sample.north_mps for sample in samples]
    lag = round(3.0 / period_s)  # 3 s at 60 m/s: 180 m
    covariance = statistics.fmean(a * b for a, b in zip(along, along[lag:], strict=False))
    expected = 1.5**2 * math.exp(-180.0 / 304.8)
    assert covariance == pytest.approx(expected, rel=0.3)


def test_turbulence_is_repeatable_by_seed() -> None:
    config = WindConfig(turbulence_mps=1.0)
    first, again, other = (model(config, seed) for seed in (5, 5, 6))
    samples = [
        [wind.sample(0.0, PERIOD_S, 5.0, STILL) for _ in range(5)] for wind in (first, again, other)
    ]
    assert samples[0] == samples[1] != samples[2]
