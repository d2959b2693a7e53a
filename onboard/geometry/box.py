"""Axis-aligned boxes in the leg frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

# Coefficients of a polynomial of degree three or less, the constant first.
Coefficients = tuple[float, ...]


class Faces(NamedTuple):
    """Positions of the four faces [m] as polynomials in the time since some instant."""

    x_min: Coefficients
    x_max: Coefficients
    y_min: Coefficients
    y_max: Coefficients


@dataclass(frozen=True)
class Box:
    """An axis-aligned rectangle in the leg frame [m]; obstacles are pillars of any height.

    It is a `KeepOut` that does not depend on the time.

    Raises:
        ValueError: a least coordinate exceeds the greatest, or is not a number.
    """

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float

    def __post_init__(self) -> None:
        if not (self.x_min_m <= self.x_max_m and self.y_min_m <= self.y_max_m):
            raise ValueError(f"not a box: {self}; expected min <= max on both axes")

    @property
    def size_m(self) -> tuple[float, float]:
        """Extents along and across the leg."""
        return self.x_max_m - self.x_min_m, self.y_max_m - self.y_min_m

    def inflated(self, margin_m: float) -> Box:
        """Return the box with every face moved out by ``margin_m`` (Eq. 18)."""
        return Box(
            self.x_min_m - margin_m,
            self.x_max_m + margin_m,
            self.y_min_m - margin_m,
            self.y_max_m + margin_m,
        )

    def shifted_by(self, x_m: float, y_m: float) -> Box:
        """Return the rectangle moved by (x_m, y_m)."""
        return Box(self.x_min_m + x_m, self.x_max_m + x_m, self.y_min_m + y_m, self.y_max_m + y_m)

    def intersects(self, other: Box) -> bool:
        """Tell whether the two closed rectangles share a point."""
        return (
            self.x_min_m <= other.x_max_m
            and other.x_min_m <= self.x_max_m
            and self.y_min_m <= other.y_max_m
            and other.y_min_m <= self.y_max_m
        )

    def enclosing(self, other: Box) -> Box:
        """Return the smallest box around both."""
        return Box(
            min(self.x_min_m, other.x_min_m),
            max(self.x_max_m, other.x_max_m),
            min(self.y_min_m, other.y_min_m),
            max(self.y_max_m, other.y_max_m),
        )

    def box_at(self, _time_s: float) -> Box:
        """Return the box itself, as at every time."""
        return self

    def swept(self, _begin_s: float, _end_s: float) -> Box:
        """Return the box itself, as over every interval."""
        return self

    def faces_from(self, _time_s: float) -> Faces:
        """Return the faces, which are constant."""
        return Faces((self.x_min_m,), (self.x_max_m,), (self.y_min_m,), (self.y_max_m,))
