"""The box of free air that the operator vouches for, and where it lies around the vehicle."""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.fence import Fence
from onboard.geometry.frames import LegFrame

# The vehicle stays that near to the height at which control was granted.
HEIGHT_BAND_M: Final = 2.0
_SIDE_MIN_M: Final = 4.0
_SIDE_MAX_M: Final = 1000.0
_WRITTEN: Final = re.compile(r"(\d+(?:\.\d*)?)x(\d+(?:\.\d*)?)")
# A geofence is looked at in places so far apart; between them its clearance falls by no more.
_GRID_M: Final = 0.5


class FreeAir(NamedTuple):
    """A box of free air: how long it is ahead of the vehicle, and how wide."""

    length_m: float
    width_m: float

    def __str__(self) -> str:
        """Return it as it is written on the command line."""
        return f"{self.length_m:g}x{self.width_m:g}"


def free_air(text: str) -> FreeAir:
    """Return the box that ``LENGTHxWIDTH`` in metres describes.

    Raises:
        ArgumentTypeError: the text does not, or a side is not from 4 to 1000 m.
    """
    written = _WRITTEN.fullmatch(text.strip())
    if written is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not LENGTHxWIDTH in metres, such as 60x20 (ahead of the nose, and across)"
        )
    sides_m = FreeAir(float(written[1]), float(written[2]))
    if not all(_SIDE_MIN_M <= side_m <= _SIDE_MAX_M for side_m in sides_m):
        raise argparse.ArgumentTypeError(
            f"{text!r}: each side must be from {_SIDE_MIN_M:g} to {_SIDE_MAX_M:g} m"
        )
    return sides_m


@dataclass(frozen=True)
class PlacedBox:
    """The box around a vehicle: it begins a margin behind it and reaches ahead along its nose.

    Attributes:
        frame: origin where control was granted, x along the nose.
        air: how large the box is.
        margin_m: between each side and the reference; what is left of it bounds the vehicle.
    """

    frame: LegFrame
    air: FreeAir
    margin_m: float

    def leaves(self, position_ned_m: tuple[float, float, float]) -> str | None:
        """Return by which side a place is outside, in words; None inside."""
        x_m, y_m, z_m = self.frame.position_leg(position_ned_m)
        if not -self.margin_m <= x_m <= self.air.length_m - self.margin_m:
            return "the vehicle has left the free air by its end"
        if abs(y_m) > self.air.width_m / 2.0:
            return "the vehicle has left the free air by its side"
        if abs(z_m) > HEIGHT_BAND_M:
            return f"the vehicle is {abs(z_m):.1f} m off its height, limit {HEIGHT_BAND_M:g} m"
        return None

    def leaves_fence(self, fence: Fence) -> bool:
        """Tell whether a part of the box may lie where a geofence does not let the vehicle be."""
        length_m, width_m = self.air
        x_m = np.linspace(0.0, length_m, 1 + math.ceil(length_m / _GRID_M)) - self.margin_m
        y_m = np.linspace(-0.5 * width_m, 0.5 * width_m, 1 + math.ceil(width_m / _GRID_M))
        along_m, across_m = (each.ravel() for each in np.meshgrid(x_m, y_m))
        places = np.column_stack((along_m, across_m, np.zeros_like(along_m)))
        north_m, east_m, _ = self.frame.position_ned_from_leg(places).T
        return bool(fence.clearance_m(north_m, east_m).min() < _GRID_M / math.sqrt(2.0))
