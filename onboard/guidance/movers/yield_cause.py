"""Which movers speak against the way that was refused last, for people; decides nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from onboard.guidance.movers.mover_guard import settling_of
from onboard.planning.mover_certifier import UNASKED, Movers, mover_failures

if TYPE_CHECKING:
    from collections.abc import Iterable

    from onboard.contract.assessment import Assessment
    from onboard.geometry.frames import LegFrame
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.mover_certifier import GrowingBox
    from onboard.planning.rest_certifier import RestLimits


def tracks_in_way(
    refused: tuple[Trajectory, RestLimits],
    assessment: Assessment,
    leg: LegFrame,
    tracks: Iterable[GrowingBox],
    stamp_error_s: float,
) -> frozenset[str]:
    """Return the names of the movers that may be on a way that was refused.

    Args:
        refused: the way, and its limits.
        assessment: of the contract.
        leg: the frame of the way.
        tracks: that are asked about.
        stamp_error_s: how far their stamps may be off.
    """
    way, limits = refused
    settling, found = settling_of(assessment), []
    for track in tracks:
        alone = Movers(UNASKED, (track,), stamp_error_s)
        if mover_failures(way, limits, settling, leg, alone):
            found.append(track.id)
    return frozenset(found)
