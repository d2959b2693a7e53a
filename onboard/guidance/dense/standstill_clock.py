"""Tells when the vehicle has rested, or has got no nearer, for so long that it pauses."""

from __future__ import annotations

import math
from typing import Final

from onboard.planning.corridor.guide import FAR_M

# Nearer by this is progress.
NEARER_M: Final = 0.2
# At rest for so long, or without progress for longer: nothing certifies.
_IDLE_S: Final = 0.6
_WITHOUT_PROGRESS_S: Final = 5.0
# The guide has changed: the way left is longer by this than it was.
_LONGER_M: Final = 2.0
# So often, and by so much in all, without ever getting nearer than before: to and fro does not
# count as progress.  A guide that tries the long way round again and again is under way for ever.
# One honest detour may be as long as some times the leg.
_DETOURS_MAX: Final = 12
_DETOURS_MAX_M: Final = 200.0
_DETOURS_MAX_LEGS: Final = 4.0


class StandstillClock:
    """Measures how long the vehicle has made no progress."""

    def __init__(self) -> None:
        self._idle_since_s: float | None = None
        self._nearest_m, self._nearest_s = math.inf, -math.inf
        self._ever_nearest_m, self._detours, self._detours_m = math.inf, 0, 0.0
        self._detours_max_m = _DETOURS_MAX_M

    def restart(self, now_s: float) -> None:
        """Count from now on."""
        self._idle_since_s, self._nearest_s = None, now_s

    def begin_leg(self, now_s: float, length_m: float) -> None:
        """Count from now on, with another way left.

        Args:
            now_s: the time.
            length_m: of the leg.
        """
        self._detours_max_m = max(_DETOURS_MAX_M, _DETOURS_MAX_LEGS * length_m)
        self._nearest_m = self._ever_nearest_m = math.inf
        self._detours, self._detours_m = 0, 0.0
        self.restart(now_s)

    def has_stopped(self, left_m: float, now_s: float, *, still: bool) -> bool:
        """Tell whether the vehicle has been at rest, or got no nearer, for long.

        Args:
            left_m: of the way to the end of the leg; `FAR_M` exactly where the guide knows none,
                which is neither nearer nor longer than what it knew before.
            now_s: the time.
            still: whether it rests, and stays so.
        """
        known = math.isfinite(left_m) and left_m != FAR_M
        if known and left_m < self._ever_nearest_m - NEARER_M:
            self._ever_nearest_m, self._detours, self._detours_m = left_m, 0, 0.0
        longer = known and left_m > self._nearest_m + _LONGER_M
        if longer:
            self._detours += 1
            self._detours_m += left_m - self._nearest_m
        nearer = known and left_m < self._nearest_m - NEARER_M
        astray = self._detours > _DETOURS_MAX or self._detours_m > self._detours_max_m
        if (nearer or longer) and not astray:
            self._nearest_m, self._nearest_s = left_m, now_s
        if not still:
            self._idle_since_s = None
        elif self._idle_since_s is None:
            self._idle_since_s = now_s
        idle = self._idle_since_s is not None and now_s - self._idle_since_s >= _IDLE_S
        return idle or now_s - self._nearest_s > _WITHOUT_PROGRESS_S
