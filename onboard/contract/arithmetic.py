"""The functions that differ between floats and arrays: one formula for a flight and for a surface.

The formulas of the contract take an `Arithmetic` as ``ops``.  With `SCALAR` they work on floats,
with `ARRAY` on NumPy arrays of one shape, element by element.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic

import numpy as np

from onboard.geometry.frames import FloatArray, Q


@dataclass(frozen=True)
class Arithmetic(Generic[Q]):
    """The functions that differ between floats and arrays.

    Attributes:
        where: condition, value where it holds, value elsewhere; both values are computed.
        anywhere: whether a condition holds for at least one element.
    """

    sqrt: Callable[[Q], Q]
    exp: Callable[[Q], Q]
    sin: Callable[[Q], Q]
    tan: Callable[[Q], Q]
    atan2: Callable[[Q, Q], Q]
    minimum: Callable[[Q, Q], Q]
    maximum: Callable[[Q, Q], Q]
    where: Callable[[Any, Q, Q], Q]
    anywhere: Callable[[Any], Any]


SCALAR: Final[Arithmetic[float]] = Arithmetic(
    sqrt=math.sqrt,
    exp=math.exp,
    sin=math.sin,
    tan=math.tan,
    atan2=math.atan2,
    minimum=min,
    maximum=max,
    where=lambda condition, yes, no: yes if condition else no,
    anywhere=bool,
)
ARRAY: Final[Arithmetic[FloatArray]] = Arithmetic(
    sqrt=np.sqrt,
    exp=np.exp,
    sin=np.sin,
    tan=np.tan,
    atan2=np.arctan2,
    minimum=np.minimum,
    maximum=np.maximum,
    where=np.where,
    anywhere=np.any,
)
