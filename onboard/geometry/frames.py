"""Coordinate frames, and every transformation between them.

* **NED**: local north, east, down; origin where the autopilot put it.
* **FRD**: body forward, right, down.
* **leg**: origin at the start of a cruise leg, x along the leg, y to its right, z down.

Rotations are named so that adjacent frame names cancel: ``rotation_ned_from_leg @ vector_leg`` is
in NED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Q = TypeVar("Q", float, FloatArray)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class LegFrame:
    """The frame of one cruise leg.

    Attributes:
        origin_ned_m: start of the leg, (3,), NED.
        heading_rad: direction of the leg, from north towards east.
    """

    origin_ned_m: tuple[float, float, float]
    heading_rad: float

    @classmethod
    def between(
        cls, start_ned_m: tuple[float, float, float], end_ned_m: tuple[float, float, float]
    ) -> LegFrame:
        """Return the frame of the leg between two points, whatever their heights.

        Raises:
            ValueError: the two points are less than a centimetre apart on the ground.
        """
        north_m, east_m = end_ned_m[0] - start_ned_m[0], end_ned_m[1] - start_ned_m[1]
        if math.hypot(north_m, east_m) < 0.01:
            raise ValueError(
                f"leg start and end are less than 1 cm apart: {start_ned_m} to {end_ned_m} m (NED)"
            )
        return cls(start_ned_m, math.atan2(east_m, north_m))

    @cached_property
    def rotation_ned_from_leg(self) -> FloatArray:
        """Rotation matrix (3, 3): ``vector_ned = rotation_ned_from_leg @ vector_leg``."""
        return rotation_about_down(self.heading_rad)

    # One vector at a time, as tuples: several times faster than an array of three.

    def position_ned(self, position_leg_m: Vector) -> Vector:
        """Return one position in metres, leg -> NED."""
        x, y, z = self.vector_ned(position_leg_m)
        north_m, east_m, down_m = self.origin_ned_m
        return x + north_m, y + east_m, z + down_m

    def position_leg(self, position_ned_m: Vector) -> Vector:
        """Return one position in metres, NED -> leg."""
        (x, y, z), (north_m, east_m, down_m) = position_ned_m, self.origin_ned_m
        return self.vector_leg((x - north_m, y - east_m, z - down_m))

    def vector_ned(self, vector_leg: Vector) -> Vector:
        """Return one velocity, acceleration, ..., leg -> NED."""
        (cosine, sine), (x, y, z) = self._direction, vector_leg
        return cosine * x - sine * y, sine * x + cosine * y, z

    def vector_leg(self, vector_ned: Vector) -> Vector:
        """Return one velocity, acceleration, ..., NED -> leg."""
        (cosine, sine), (x, y, z) = self._direction, vector_ned
        return cosine * x + sine * y, cosine * y - sine * x, z

    @cached_property
    def _direction(self) -> tuple[float, float]:
        return math.cos(self.heading_rad), math.sin(self.heading_rad)

    def position_ned_from_leg(self, position_leg_m: FloatArray) -> FloatArray:
        """Positions (..., 3) in metres, leg -> NED."""
        moved: FloatArray = self.vector_ned_from_leg(position_leg_m) + np.array(self.origin_ned_m)
        return moved

    def position_leg_from_ned(self, position_ned_m: FloatArray) -> FloatArray:
        """Positions (..., 3) in metres, NED -> leg."""
        return self.vector_leg_from_ned(position_ned_m - np.asarray(self.origin_ned_m))

    def vector_ned_from_leg(self, vector_leg: FloatArray) -> FloatArray:
        """Velocities, accelerations, ... (..., 3), leg -> NED."""
        rotated: FloatArray = vector_leg @ self.rotation_ned_from_leg.T
        return rotated

    def vector_leg_from_ned(self, vector_ned: FloatArray) -> FloatArray:
        """Velocities, accelerations, ... (..., 3), NED -> leg."""
        rotated: FloatArray = vector_ned @ self.rotation_ned_from_leg
        return rotated


def rotation_about_down(angle_rad: float) -> FloatArray:
    """Rotation matrix (3, 3) by ``angle_rad`` about the down axis, from north towards east."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def heading_displacement_m(
    distance_m: Q,
    heading_error_rad: Q,
    sine: Callable[[Any], Any] = math.sin,
) -> Q:
    """Return how far a heading error moves a point that is placed from the body, in metres.

    The point turns about the vehicle: it moves by the chord 2 d sin(psi / 2), which is more than
    d sin(psi) (theory I;
    tests/onboard/geometry/test_frames.py::test_heading_displacement_is_the_chord).

    Args:
        distance_m: d, horizontally from the vehicle to the point.
        heading_error_rad: psi, estimated heading less true heading, magnitude.
        sine: for floats or arrays.
    """
    displaced_m: Q = 2.0 * distance_m * sine(heading_error_rad / 2.0)
    return displaced_m


def wrap_angle(angle_rad: float) -> float:
    """Return the same direction in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
