"""The operator's word that the place of the first hover is free (A0 of the two-tier theory).

It is about a place on the ground, stated in the local frame in which the daemon was started.  So it
is taken once, at the first departure, and never after that frame has moved or come into doubt; from
then on it lives in the seen-free set, which moves and is voided like all that was seen.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onboard.perception.detection import Corners


class OperatorsWord:
    """Remembers whether the word may still be taken, and what has been taken by it.

    Attributes:
        may_be_taken: whether the frame of the word still stands and it has not been taken.
    """

    def __init__(self) -> None:
        self.may_be_taken = True
        # (north, east, radius) in metres of what is taken for free by it, present local frame.
        self._disc_ned_m: tuple[float, float, float] | None = None

    def take(self, north_m: float, east_m: float, radius_m: float) -> None:
        """Take the word for a disc; it cannot be taken again."""
        self.may_be_taken = False
        self._disc_ned_m = (north_m, east_m, radius_m)

    def shift(self, north_m: float, east_m: float) -> None:
        """Move with the local frame: what has been taken moves, what has not is void."""
        self.may_be_taken = False
        if self._disc_ned_m is not None:
            x_m, y_m, radius_m = self._disc_ned_m
            self._disc_ned_m = (x_m + north_m, y_m + east_m, radius_m)

    def forget(self, *, frame_stands: bool) -> None:
        """Take nothing for free by it any more.

        Args:
            frame_stands: the place is still where the operator said, so that a word which has not
                been taken yet may be.
        """
        self.may_be_taken = self.may_be_taken and frame_stands
        self._disc_ned_m = None

    def contradicted_by(self, boxes_ned_m: Sequence[Corners], margin_m: float) -> int | None:
        """Return the index of a box that reaches into the disc by more than a margin.

        Args:
            boxes_ned_m: corners of each, north and east.
            margin_m: by which its faces may be off.
        """
        if self._disc_ned_m is None:
            return None
        *centre_m, radius_m = self._disc_ned_m
        for index, corners in enumerate(boxes_ned_m):
            around_m = [(x_m - centre_m[0], y_m - centre_m[1]) for x_m, y_m in corners]
            if _distance_m(around_m) + margin_m < radius_m:
                return index
        return None


def _distance_m(corners_m: Sequence[tuple[float, float]]) -> float:
    """Return the distance of a convex polygon, corners in order, from the origin."""
    nearest_m, left, right = math.inf, True, True
    for (x_m, y_m), (next_x_m, next_y_m) in zip(
        corners_m, (*corners_m[1:], corners_m[0]), strict=True
    ):
        along_x_m, along_y_m = next_x_m - x_m, next_y_m - y_m
        turn = along_x_m * -y_m - along_y_m * -x_m
        left, right = left and turn > 0.0, right and turn < 0.0
        length_m2 = max(along_x_m * along_x_m + along_y_m * along_y_m, 1e-12)
        share = min(max(-(x_m * along_x_m + y_m * along_y_m) / length_m2, 0.0), 1.0)
        nearest_m = min(nearest_m, math.hypot(x_m + share * along_x_m, y_m + share * along_y_m))
    # Only within a polygon that has an area do all turns have a sign: a box without an extent is a
    # point or a line, and the origin on an edge is at no distance of that.
    return 0.0 if left or right else nearest_m
