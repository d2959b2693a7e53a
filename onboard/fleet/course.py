"""What a vehicle of a fleet does at a tick, and how it flies, as it asks for leave by it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from onboard.fleet.area import Place
from onboard.geometry.frames import FloatArray


@dataclass(frozen=True)
class FlightTerms:
    """How the vehicle flies.

    Attributes:
        body_m: r + E, its radius and tracking error.
        cruise_mps, brake_mps2: speed along a leg, and with what it brakes.
        lag_s: until it brakes.
        settle_s: t_set, from a reference at rest to the vehicle at rest.
        run_on_s: how long the vehicle runs on at the speed of a setpoint that is its last.
    """

    body_m: float
    cruise_mps: float
    brake_mps2: float
    lag_s: float
    settle_s: float
    run_on_s: float = 0.0

    @property
    def stop_s(self) -> float:
        """How long a stop takes."""
        return self.lag_s + self.cruise_mps / self.brake_mps2

    @property
    def stop_m(self) -> float:
        """How long its way is."""
        return self.cruise_mps * (self.lag_s + self.cruise_mps / (2.0 * self.brake_mps2))

    @property
    def beyond_m(self) -> float:
        """How far beyond the end of a stop the vehicle runs on, if the stream ends on the way.

        From v on the way, ``v t - v^2 / 2b``, which is greatest at ``v = b t``.
        """
        if not math.isfinite(self.run_on_s):
            return 0.0  # not known, so that nothing certifies
        speed_mps = min(self.brake_mps2 * self.run_on_s, self.cruise_mps)
        return speed_mps * (self.run_on_s - speed_mps / (2.0 * self.brake_mps2))


@dataclass(frozen=True)
class Course:
    """What the vehicle does at a tick.

    Attributes:
        position_m: north, east, of the reference that it follows; else of the vehicle.
        position_s: when it is there.
        rests_s: when it will rest at the latest, if it does not and nothing else is decided.
        rests: whether it is at rest there, and nothing else is decided.
        held_m: (N, 4), what its body may still occupy on the way that it holds.
        leg: start and end of the leg that it flies; None where it asks for no way.
        terms: how it flies.
    """

    position_m: Place
    position_s: float
    rests_s: float
    rests: bool
    held_m: FloatArray
    leg: tuple[Place, Place] | None
    terms: FlightTerms
