"""Which movers speak against the way that was refused last, for people; decides nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from onboard.planning.mover_certifier import Movers, mover_failures

if TYPE_CHECKING:
    from collections.abc import Iterable

    from onboard.geometry.frames import FloatArray
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.planning.mover_certifier import GrowingBox, MoverFreePlaces


class _Anywhere:
    """Places that tell nothing: only the boxes of movers that are seen are asked about."""

    def first_reached(
        self, low_ned_m: FloatArray, high_ned_m: FloatArray, until_s: FloatArray
    ) -> int | None:
        """Return that none is reached."""
        del low_ned_m, high_ned_m, until_s
        return None


_ANYWHERE: Final[MoverFreePlaces] = _Anywhere()


def tracks_in_way(
    guard: MoverGuard, tracks: Iterable[GrowingBox], stamp_error_s: float
) -> frozenset[str]:
    """Return the names of the movers that may be on the way that was refused last.

    Args:
        guard: has refused it.
        tracks: that are asked about.
        stamp_error_s: how far their stamps may be off.
    """
    if guard.refused is None:
        return frozenset()
    way, limits = guard.refused
    found = []
    for track in tracks:
        alone = Movers(_ANYWHERE, (track,), stamp_error_s)
        if mover_failures(way, limits, guard.settling, guard.leg, alone):
            found.append(track.id)
    return frozenset(found)
