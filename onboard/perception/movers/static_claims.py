"""What sensors claim to stand still, and whether it does."""

from __future__ import annotations

from typing import Final, NamedTuple

from onboard.geometry.box import Box

# More claims than these are not compared; a map of them has its own limit.
_CLAIMS_MAX: Final = 10_000
_ROUND_OFF_M: Final = 1e-6


class Moved(NamedTuple):
    """Something that was claimed to stand still has moved.

    Attributes:
        displacement_m: of a face, from its first sighting.
        limit_m: what errors explain.
    """

    displacement_m: float
    limit_m: float


class StaticClaims:
    """Compares each whole box that is claimed to be static with the first one of its track."""

    def __init__(self) -> None:
        self._first: dict[str, tuple[Box, float]] = {}
        self._broken: set[str] = set()

    def clear(self) -> None:
        """Begin again: the local frame has moved.  What has moved once stays a mover."""
        self._first.clear()

    def is_broken(self, track_id: str) -> bool:
        """Tell whether a track was claimed to be static, and has moved."""
        return track_id in self._broken

    def check(self, track_id: str, measured: Box, error_m: float) -> Moved | None:
        """Take a claim; return how far the first one was off where errors do not explain that.

        Args:
            track_id: what it was made of.
            measured: its whole box, along north and east.
            error_m: how far each face may be off along these axes.
        """
        first, first_error_m = self._first.get(track_id, (None, 0.0))
        if first is None:
            if len(self._first) < _CLAIMS_MAX:
                self._first[track_id] = (measured, error_m)
            return None
        limit_m = first_error_m + error_m + _ROUND_OFF_M
        displaced_m = max(
            abs(measured.x_min_m - first.x_min_m),
            abs(measured.x_max_m - first.x_max_m),
            abs(measured.y_min_m - first.y_min_m),
            abs(measured.y_max_m - first.y_max_m),
        )
        if displaced_m <= limit_m or track_id in self._broken:
            return None
        self._broken.add(track_id)
        return Moved(displaced_m, limit_m)
