"""What a trajectory must stay out of, at each time: a rectangle whose faces may move.

A `Box` is the constant case.  Whatever moves has faces that are polynomials of the time, so that
the certifier finds the instants at which a trajectory crosses them exactly, by roots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from onboard.geometry.box import Box, Faces


class KeepOut(Protocol):
    """A rectangle in the leg frame that may depend on the time; all times are absolute."""

    def box_at(self, time_s: float) -> Box:
        """Return the rectangle at one time."""

    def swept(self, begin_s: float, end_s: float) -> Box:
        """Return a box that encloses the rectangle at every time of an interval."""

    def faces_from(self, time_s: float) -> Faces:
        """Return the faces as polynomials in the time since ``time_s``, which hold from it on."""


@dataclass(frozen=True)
class MovingBox:
    """A rectangle that moves at a constant velocity, before and after its reference time.

    Attributes:
        box: the rectangle at ``reference_s``, leg frame.
        reference_s: absolute time.
        velocity_leg_mps: along x and y.
    """

    box: Box
    reference_s: float
    velocity_leg_mps: tuple[float, float]

    def box_at(self, time_s: float) -> Box:
        """Return the rectangle at one time."""
        elapsed_s = time_s - self.reference_s
        x_mps, y_mps = self.velocity_leg_mps
        return self.box.shifted_by(x_mps * elapsed_s, y_mps * elapsed_s)

    def swept(self, begin_s: float, end_s: float) -> Box:
        """Return the smallest box around the rectangle at both ends of an interval."""
        return self.box_at(begin_s).enclosing(self.box_at(end_s))

    def faces_from(self, time_s: float) -> Faces:
        """Return the faces, which move linearly."""
        box, (x_mps, y_mps) = self.box_at(time_s), self.velocity_leg_mps
        return Faces(
            (box.x_min_m, x_mps), (box.x_max_m, x_mps), (box.y_min_m, y_mps), (box.y_max_m, y_mps)
        )
