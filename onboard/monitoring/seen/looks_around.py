"""Counts what frames have shown around one place, sector by sector."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from onboard.perception.line_of_sight import View
    from onboard.perception.seen_free import IntArray

# A place has been looked at all round when frames have shown every one of these sectors.
_SECTORS: Final = 72
_MIDDLES_RAD: Final = 2.0 * math.pi * np.arange(_SECTORS) / _SECTORS


class LooksAround:
    """How many frames of each sensor have shown each sector around one place."""

    def __init__(self) -> None:
        self._shown: dict[str, IntArray] = {}
        self._from_ned_m = (0.0, 0.0)

    def __bool__(self) -> bool:
        """Whether anything has been shown."""
        return bool(self._shown)

    def forget(self) -> None:
        """Begin again."""
        self._shown = {}

    def shift(self, north_m: float, east_m: float) -> None:
        """Move with the local frame."""
        self._from_ned_m = (self._from_ned_m[0] + north_m, self._from_ned_m[1] + east_m)

    def note(
        self,
        view: View,
        here_ned_m: tuple[float, float],
        yaw_rad: float,
        source: str,
        same_place_m: float,
    ) -> None:
        """Count the sectors around the vehicle that a frame shows, and says something of.

        Args:
            view: of the frame.
            here_ned_m: where the vehicle was, north and east; elsewhere the count begins again.
            yaw_rad: where its nose pointed, clockwise from north.
            source: the sensor.
            same_place_m: how far from the first place it counts as the same.
        """
        if not self._shown or math.dist(here_ned_m, self._from_ned_m) > same_place_m:
            self._shown, self._from_ned_m = {}, here_ned_m
        aside_rad = (_MIDDLES_RAD - yaw_rad + math.pi) % (2.0 * math.pi) - math.pi
        half_rad = math.pi / _SECTORS
        shown = np.abs(aside_rad) + half_rad <= view.half_view_rad
        shown |= view.half_view_rad >= math.pi - half_rad
        if view.free_range_m:  # where it knows nothing, it has not looked
            count, scan_half_rad = len(view.free_range_m), view.scan_half_view_rad
            bins = np.floor((aside_rad + scan_half_rad) * count / (2.0 * scan_half_rad)).astype(int)
            shown &= np.asarray(view.free_range_m)[np.clip(bins, 0, count - 1)] > 0.0
        self._shown[source] = self._shown.get(source, np.zeros(_SECTORS, np.int_)) + shown

    def are_all_round(
        self, place_ned_m: tuple[float, float], same_place_m: float, frames_needed: int
    ) -> bool:
        """Tell whether enough frames of one sensor have shown each sector around a place."""
        if not self._shown or math.dist(place_ned_m, self._from_ned_m) > same_place_m:
            return False
        most = np.max(list(self._shown.values()), axis=0)
        return bool((most >= frames_needed).all())
