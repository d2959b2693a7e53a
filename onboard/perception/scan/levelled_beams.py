"""Beams in the levelled body: the one form in which every ranging sensor is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.frames import FloatArray

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LevelledBeams:
    """What was measured along each of n bearings, in the order of the bearings.

    Attributes:
        bearing_rad: (n,) from the nose, clockwise, of beams around the sensor.
        width_rad: (n,) of the sector that each stands for.
        hit: (n,) whether it returned from something that may be an obstacle.
        point_m: (2, n) where, in the levelled body; meaningless without a hit.
        free_m: (n,) how far along it nothing is, horizontally from the sensor; 0 if unknown.
        blocked: (n,) whether nothing is known of what is there, not even that nothing returned.
        reach_m: (n,) how far it could have seen an obstacle that was not there.
        sensor_m: where the sensor was at the reference time, in the levelled body.
        moved_m: how far it moved from there, at most, while it measured.
        gap_rad: an obstacle may reach this far beside a beam that passes it.
        point_error_m: by which what is at a point may reach beyond it.
    """

    bearing_rad: FloatArray
    width_rad: FloatArray
    hit: BoolArray
    point_m: FloatArray
    free_m: FloatArray
    blocked: BoolArray
    reach_m: FloatArray
    sensor_m: tuple[float, float] = (0.0, 0.0)
    moved_m: float = 0.0
    gap_rad: float = 0.0
    point_error_m: float = 0.0

    def sorted(self) -> LevelledBeams:
        """Return the same beams in the order of their bearings."""
        if (self.bearing_rad[1:] >= self.bearing_rad[:-1]).all():
            return self
        return self.chosen(np.argsort(self.bearing_rad, kind="stable"))

    def chosen(self, index: NDArray[np.intp]) -> LevelledBeams:
        """Return some of the beams, in an order."""
        return replace(
            self,
            bearing_rad=self.bearing_rad[index],
            width_rad=self.width_rad[index],
            hit=self.hit[index],
            point_m=self.point_m[:, index],
            free_m=self.free_m[index],
            blocked=self.blocked[index],
            reach_m=self.reach_m[index],
        )
