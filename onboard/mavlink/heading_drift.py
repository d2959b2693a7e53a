"""Drift of the estimated heading against the gyros.

Over seconds, integrated turn rates are exact to a fraction of a degree, so any turn of the
estimated heading beyond them is a change of its own error.  This needs neither a magnetometer nor
obstacles.  Recorded flights of PX4: 7° within 10 s, and 18° before the contact that a drifting
heading caused; of ArduPilot: 4°, of which the gyros themselves drift by 0.5°.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from onboard.geometry.frames import wrap_angle

# Across a longer silence the turn is unknown.
_SILENCE_MAX_S: Final = 0.25
_UPRIGHT_COSINE_MIN: Final = 0.1


class Attitude(NamedTuple):
    """One ATTITUDE message: angles, and rates about the body's axes forward, right and down."""

    measured_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    roll_rate_radps: float
    pitch_rate_radps: float
    yaw_rate_radps: float

    @property
    def heading_rate_radps(self) -> float:
        """Rate of the heading, from the gyros."""
        across = self.pitch_rate_radps * math.sin(self.roll_rad)
        down = self.yaw_rate_radps * math.cos(self.roll_rad)
        return (across + down) / max(math.cos(self.pitch_rad), _UPRIGHT_COSINE_MIN)


class HeadingDrift:
    """Integrates the turn of the estimated heading beyond that of the gyros.

    Attributes:
        drift_rad: the integral.
        begun: how often the integral was reset, because of a silence.
    """

    def __init__(self) -> None:
        self.drift_rad = 0.0
        self.begun = 0
        self._latest: Attitude | None = None

    def add(self, attitude: Attitude) -> None:
        """Take the next attitude; one that arrives after a later one is ignored."""
        latest = self._latest
        step_s = math.inf if latest is None else attitude.measured_s - latest.measured_s
        if -_SILENCE_MAX_S <= step_s <= 0.0:
            return
        self._latest = attitude
        if latest is None or not 0.0 < step_s <= _SILENCE_MAX_S:
            self.drift_rad, self.begun = 0.0, self.begun + 1
            return
        rate_radps = (latest.heading_rate_radps + attitude.heading_rate_radps) / 2.0
        turned_rad = wrap_angle(attitude.yaw_rad - latest.yaw_rad)
        self.drift_rad += wrap_angle(turned_rad - rate_radps * step_s)
