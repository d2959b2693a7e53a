"""Roll and pitch limits -> the accelerations W that a plan may ask for (Eq. 2-7).

Notation (paper -> here): b ``brake_mps2``, a ``forward_mps2``, d ``left_mps2``, u ``right_mps2``
(the paper's "up" is +y, which is right in the leg frame).  See THEORY.md, "Agility".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from onboard.contract.arithmetic import Arithmetic
from onboard.contract.terms import Terms
from onboard.geometry.frames import Q

GRAVITY_MPS2: Final = 9.80665


@dataclass(frozen=True)
class AccelerationLimits:
    """The box W of admissible horizontal accelerations in the leg frame (Eq. 7).

    x acceleration lies in [-brake_mps2, forward_mps2], y in [-left_mps2, right_mps2]; all four
    are positive magnitudes in m/s².

    Raises:
        ValueError: a limit is not finite or not above zero.
    """

    brake_mps2: float
    forward_mps2: float
    left_mps2: float
    right_mps2: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value!r} m/s²: must be finite and above zero")


def tilt_limits(terms: Terms[Q], ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return the accelerations along and across the leg that the tilt gives in still air, in m/s².

    They are half the extents of W in level flight, with the nose along the leg.

    PAPER: Eq. 7 encloses the exact set, and a planner on it asks for roll beyond the limit
    (15.5° at 15°); ``"inner"`` is the largest axis-aligned box with the same x range inside it;
    tests/onboard/contract/test_agility.py::test_paper_box_asks_for_too_much_roll.
    """
    tan_pitch = ops.tan(terms.pitch_max_rad)
    y_mps2 = GRAVITY_MPS2 * ops.tan(terms.roll_max_rad)
    if terms.input_set == "paper":
        y_mps2 = y_mps2 * ops.sqrt(1.0 + tan_pitch * tan_pitch)
    return GRAVITY_MPS2 * tan_pitch, y_mps2


def thrust_to_weight_at_corner(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return thrust over weight at a corner of the paper's box, 1/(cos roll cos pitch) (erratum 8).

    PAPER: the paper leaves T_max open.  The inner box asks for less at its corner,
    sqrt(1 + tan² roll + tan² pitch);
    tests/onboard/contract/test_agility.py::test_thrust_required_is_that_of_the_corner.
    """
    tan_roll, tan_pitch = ops.tan(terms.roll_max_rad), ops.tan(terms.pitch_max_rad)
    return ops.sqrt((1.0 + tan_roll * tan_roll) * (1.0 + tan_pitch * tan_pitch))


def reserved_trim_mps2(terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    """Return the acceleration set aside for the wind [m/s²]; 0 where that would leave nothing."""
    return _reserved_of(tilt_limits(terms, ops), terms, ops)


def _reserved_of(tilt_mps2: tuple[Q, Q], terms: Terms[Q], ops: Arithmetic[Q]) -> Q:
    trim_mps2 = terms.trim_mps2
    enough = trim_mps2 < ops.minimum(*tilt_mps2)
    return ops.where(enough, trim_mps2, trim_mps2 * 0.0)


def available_limits(terms: Terms[Q], ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Return what the trim against the wind leaves of the tilt limits, in m/s² (theory J).

    Where it leaves nothing the clause ``wind`` is violated, and the others are read in still air.
    """
    x_mps2, y_mps2 = tilt_limits(terms, ops)
    reserved_mps2 = _reserved_of((x_mps2, y_mps2), terms, ops)
    return x_mps2 - reserved_mps2, y_mps2 - reserved_mps2
