"""Vehicles of the evaluation: errors, limits, and how they run on after a loss of the stream."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs_tools.benchmark.obstacles import Floats
from gcs_tools.benchmark.run_on_models import coasting_run_on, frozen_run_on
from onboard.contract.run_on import NO_RUN_ON, RunOn, overshoot
from onboard.planning.rest_certifier import RestLimits

_LAG_S = 0.19
# State (3, 2) of the setpoint when the stream stops, and the positions (k, 2) afterwards.
LossCurve = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Vehicle:
    """What one vehicle is, as far as a flight at the level of references needs it."""

    radius_m: float = 0.3
    tracking_error_m: float = 0.35
    face_error_m: float = 0.1
    speed_max_mps: float = 2.8
    acceleration_max_mps2: float = 2.63
    attitude_lag_s: float = 0.27
    range_m: float = 12.0
    half_view_rad: float = math.radians(45.0)
    frames_needed: int = 3
    run_on: RunOn = NO_RUN_ON
    after_loss: LossCurve | None = None

    @property
    def body_radius_m(self) -> float:
        """Radius about the reference."""
        return self.radius_m + self.tracking_error_m

    @property
    def limits(self) -> RestLimits:
        """What its plans may ask of it; the nose points along the path."""
        most = self.acceleration_max_mps2
        return RestLimits(
            self.body_radius_m,
            self.speed_max_mps,
            (most, most, most, most),
            most,
            0.6 * most / self.attitude_lag_s,
            self.run_on,
        )


def coast_curve(timeout_s: float, brake_mps2: float) -> LossCurve:
    """Return the run of an autopilot that integrates the setpoint for a time, then brakes."""
    times = np.linspace(0.0, timeout_s, 5)[:, None]
    shares = np.linspace(0.0, 1.0, 13)[:, None]

    def curve(state: Floats) -> Floats:
        p, v, a = state
        coast = p + v * times + a * times**2 / 2.0
        fastest = v + a * timeout_s
        stopping_s = _LAG_S + float(np.hypot(*fastest)) / (2.0 * brake_mps2)
        return np.concatenate((coast, coast[-1] + shares * fastest * stopping_s))

    return curve


def frozen_curve(gain_per_s: float, velocity_gain_per_s: float, lag_s: float) -> LossCurve:
    """Return the run of a linear loop that keeps its last setpoint: position, velocity, bias.

    ``x'' = (Kp (p - x) + v + a / Kv - x') / lag``, from x = p and x' = v.
    """
    step_s, count = 0.005, 1600
    kept = []
    gain_v = gain_a = 0.0
    speed_v, speed_a = 1.0, 0.0
    for k in range(count):
        if not k % 10:
            kept.append((gain_v, gain_a))
        pull_v = (-gain_per_s * gain_v + 1.0 - speed_v) / lag_s
        pull_a = (-gain_per_s * gain_a + 1.0 / velocity_gain_per_s - speed_a) / lag_s
        speed_v, speed_a = speed_v + step_s * pull_v, speed_a + step_s * pull_a
        gain_v, gain_a = gain_v + step_s * speed_v, gain_a + step_s * speed_a
    gains = np.array(kept)

    def curve(state: Floats) -> Floats:
        points: Floats = state[0] + gains @ state[1:]
        return points

    return curve


def vehicles() -> dict[str, Vehicle]:
    """Return the vehicles by name; the last two are safe when the stream stops."""
    gain, velocity_gain, lag_s = 0.95, 1.8, 0.2
    most = Vehicle().acceleration_max_mps2
    coast = coasting_run_on(
        0.2,
        lag_s=_LAG_S,
        brake_mps2=most,
        speed_max_mps=Vehicle().speed_max_mps,
        acceleration_max_mps2=most,
    )
    frozen = frozen_run_on(
        overshoot(gain, lag_s) / gain, gain_per_s=gain, velocity_gain_per_s=velocity_gain
    )
    return {
        "default": Vehicle(),
        "ardupilot": Vehicle(run_on=coast, after_loss=coast_curve(0.2, most)),
        "px4": Vehicle(
            radius_m=0.4,
            tracking_error_m=0.8,
            run_on=frozen,
            after_loss=frozen_curve(gain, velocity_gain, lag_s),
        ),
    }
