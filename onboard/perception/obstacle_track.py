"""Obstacles as they are remembered: what encloses the measurements, and how high it may reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from onboard.contract.region import RegionOfInfluence
from onboard.geometry.box import Box
from onboard.perception.detection import ANY_HEIGHT, Corners, DownRange


@dataclass(frozen=True)
class Obstacle:
    """An obstacle to avoid as one, in the current leg frame.

    Attributes:
        id: ``source/id`` of its detections; those of a merged one are joined by ``+``.
        members: ids of the tracks in it, more than one if their regions intersect.
        measured: the box that encloses every measurement of every member.
        position_error_m: the largest uncertainty reported for a face.
        region: its Region of Influence.
        down_m: top and bottom in local NED over all measurements; None for any height.
        filled_m: heights in local NED that it may fill, errors included.
    """

    id: str
    members: tuple[str, ...]
    measured: Box
    position_error_m: float
    region: RegionOfInfluence
    down_m: DownRange | None = None
    filled_m: DownRange = ANY_HEIGHT

    def shifted_by(self, x_m: float, y_m: float) -> Obstacle:
        """Return the same obstacle elsewhere in the leg frame."""
        return replace(
            self,
            measured=self.measured.shifted_by(x_m, y_m),
            region=self.region.shifted_by(x_m, y_m),
        )

    def confirms(self, earlier: Obstacle, position_error_m: float) -> bool:
        """Tell whether all that was measured since agrees with an earlier state of the obstacle.

        Every face lies within the error of every measurement of it, so that one which comes to lie
        farther out by no more than both errors does not say that the earlier bound was wrong.

        Args:
            earlier: the obstacle as it was known before.
            position_error_m: of a face, where a sensor reports less.
        """
        errors_m = [max(o.position_error_m, position_error_m) for o in (self, earlier)]
        bound = earlier.measured.inflated(sum(errors_m))
        return self.members == earlier.members and bound.enclosing(self.measured) == bound


@dataclass(frozen=True)
class Track:
    """One detected obstacle: what encloses its measurements, in NED for other legs too.

    Attributes:
        corners_ned_m: of what encloses every measurement.
        measured: the same in the frame of the leg.
        position_error_m: the largest error of a face.
        apart_from: the track that it is a place of, where places contradict each other.
        down_m: top and bottom as measured; None once a measurement did not say.
        filled_m: heights that it may fill, errors included; infinite where a measurement of a new
            part of it did not say.
    """

    corners_ned_m: Corners
    measured: Box
    position_error_m: float
    apart_from: str | None
    down_m: DownRange | None
    filled_m: DownRange = ANY_HEIGHT

    def explains(self, measured: Box, position_error_m: float) -> bool:
        """Tell whether a worse measurement says nothing beyond the errors of both."""
        return position_error_m > self.position_error_m and self._covers(measured, position_error_m)

    def filled_with(self, new: Track) -> DownRange:
        """Return the heights that it may fill after one more measurement of it.

        A face that was out of view this time is where it was measured before, as long as the
        measurement shows nothing but what was measured then.
        """
        (top_m, bottom_m), (new_top_m, new_bottom_m) = self.filled_m, new.filled_m
        if self._covers(new.measured, new.position_error_m):
            new_top_m = top_m if math.isinf(new_top_m) else new_top_m
            new_bottom_m = bottom_m if math.isinf(new_bottom_m) else new_bottom_m
        return min(top_m, new_top_m), max(bottom_m, new_bottom_m)

    def updated(
        self,
        new: Track,
        corners_of: Callable[[Box], Corners],
        *,
        error_max_m: float,
        in_full: bool,
    ) -> Track:
        """Return what is known of it after one more measurement.

        Args:
            new: the measurement.
            corners_of: corners in NED of a box in the frame of the leg.
            error_max_m: of a face by the contract; worse counts until it is seen in full within.
            in_full: whether the sensor saw the whole obstacle.
        """
        known = self
        down_m, filled_m = down_union((known.down_m, new.down_m)), known.filled_with(new)
        if (down_m, filled_m) != (known.down_m, known.filled_m):
            known = replace(known, down_m=down_m, filled_m=filled_m)
        measured, error_m = new.measured, new.position_error_m
        if error_m > error_max_m and known.explains(measured, error_m):
            return known
        if not (in_full and error_m <= error_max_m < known.position_error_m):
            measured = known.measured.enclosing(measured)
            error_m = max(known.position_error_m, error_m)
        if measured == known.measured and error_m == known.position_error_m:
            return known
        return Track(
            # Sound for any later leg: what encloses every measurement in this one encloses them.
            corners_of(measured),
            measured,
            error_m,
            known.apart_from or new.apart_from,
            down_m,
            filled_m,
        )

    def _covers(self, measured: Box, position_error_m: float) -> bool:
        bound = self.measured.inflated(self.position_error_m + position_error_m)
        return bound.enclosing(measured) == bound


def down_union(ranges_m: Iterable[DownRange | None]) -> DownRange | None:
    """Return the least range around some; None, any height, if one of them is unknown."""
    known_m = []
    for range_m in ranges_m:
        if range_m is None:
            return None
        known_m.append(range_m)
    return min(top_m for top_m, _ in known_m), max(bottom_m for _, bottom_m in known_m)
