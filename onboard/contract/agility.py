"""Roll, pitch and thrust limits -> the accelerations W that a plan may ask for (Eq. 2-7).

Notation (paper -> here): b ``brake_mps2``, a ``forward_mps2``, d ``left_mps2``, u ``right_mps2``
(the paper's "up" is +y, which is right in the leg frame).  See THEORY.md, "Agility".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from onboard.files.models import InputSet

GRAVITY_MPS2 = 9.80665


class AgilityError(ValueError):
    """The limits leave no acceleration that the vehicle could fly."""


@dataclass(frozen=True)
class AccelerationLimits:
    """The box W of admissible horizontal accelerations in the leg frame (Eq. 7).

    x acceleration lies in [-brake_mps2, forward_mps2], y in [-left_mps2, right_mps2]; all four
    are positive magnitudes in m/s².
    """

    brake_mps2: float
    forward_mps2: float
    left_mps2: float
    right_mps2: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise AgilityError(f"{name} = {value!r} m/s²: must be finite and above zero")

    def reduced(self, by_mps2: float) -> AccelerationLimits:
        """Return what is left of each limit when the trim against a wind takes a part (theory J).

        Raises:
            AgilityError: nothing is left of one of them.
        """
        return AccelerationLimits(*(limit_mps2 - by_mps2 for limit_mps2 in vars(self).values()))

    def mirrored(self) -> AccelerationLimits:
        """Return the same limits seen from the other side: left and right exchanged."""
        return AccelerationLimits(
            self.brake_mps2, self.forward_mps2, self.right_mps2, self.left_mps2
        )


@dataclass(frozen=True)
class Agility:
    """What attitude and thrust allow.

    Attributes:
        roll_max_rad: phi_max available to the planner, in (0, pi/2).
        pitch_max_rad: theta_max, in (0, pi/2).
        thrust_to_weight: T_max / (m g).
    """

    roll_max_rad: float
    pitch_max_rad: float
    thrust_to_weight: float

    def __post_init__(self) -> None:
        for name in ("roll_max_rad", "pitch_max_rad"):
            angle_rad = getattr(self, name)
            if not 0.0 < angle_rad < math.pi / 2:
                raise AgilityError(f"{name} = {angle_rad!r} rad: must lie between 0 and 90°")
        if not self.thrust_to_weight > 1.0:
            raise AgilityError(
                f"thrust_to_weight = {self.thrust_to_weight!r}: must exceed 1, or the vehicle "
                "cannot even hover and W is empty"
            )

    @property
    def thrust_to_weight_required(self) -> float:
        """Thrust over weight at a vertex of W in level flight (theory, erratum 8).

        PAPER: the paper leaves T_max open.  The thrust that the box asks for at its corner is
        sqrt(1 + tan² + tan²) on the inner box and 1/(cos cos) on the paper's, the larger one;
        shown by tests/onboard/contract/test_agility.py::test_thrust_required_is_that_of_the_corner.
        """
        return 1.0 / (math.cos(self.roll_max_rad) * math.cos(self.pitch_max_rad))

    def acceleration_limits(self, input_set: InputSet = "inner") -> AccelerationLimits:
        """Return the box W in level flight with the nose along the leg.

        PAPER: Eq. 7 encloses the exact set, and a planner on it asks for roll beyond the limit
        (15.5° at 15°); ``"inner"`` is the largest axis-aligned box with the same x range inside
        it; tests/onboard/contract/test_agility.py::test_paper_box_asks_for_too_much_roll.
        """
        x_mps2 = GRAVITY_MPS2 * math.tan(self.pitch_max_rad)
        y_mps2 = GRAVITY_MPS2 * math.tan(self.roll_max_rad)
        if input_set == "paper":
            y_mps2 /= math.cos(self.pitch_max_rad)
        return AccelerationLimits(x_mps2, x_mps2, y_mps2, y_mps2)


def attitude_from_acceleration(
    acceleration_leg_mps2: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return roll [rad], pitch [rad] and specific thrust [m/s²] for an acceleration (Eq. 4)."""
    x_mps2, y_mps2, z_mps2 = acceleration_leg_mps2
    lift_mps2 = GRAVITY_MPS2 - z_mps2
    roll_rad = math.atan2(y_mps2, math.hypot(x_mps2, lift_mps2))
    pitch_rad = math.atan2(-x_mps2, lift_mps2)
    return roll_rad, pitch_rad, math.hypot(x_mps2, y_mps2, lift_mps2)
