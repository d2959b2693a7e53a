"""Whether the vehicle has leave for a way: all of it in its tube, at rest in it in time.

A way that only this speaks against is why the vehicle waits (YIELD), as it does for movers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from onboard.planning.mover_certifier import moving_until_s
from onboard.planning.tube_certifier import lies_in_tube, occupied_ned_m

if TYPE_CHECKING:
    from onboard.contract.assessment import Assessment
    from onboard.geometry.frames import FloatArray, LegFrame
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.mover_certifier import Settling
    from onboard.planning.rest_certifier import RestLimits


class Leave(Protocol):
    """What a vehicle of a fleet has leave for; `onboard.fleet.member` implements it."""

    @property
    def tube_m(self) -> FloatArray:
        """Where body and tracking error may be, (N, 4), local NED."""
        ...

    @property
    def expires_s(self) -> float:
        """When the vehicle has to be at rest."""
        ...

    def who_may_come(self, area_m: FloatArray, until_s: float) -> str | None:
        """Return which vehicle that has left its tube may be in an area until then."""
        ...

    def waits_for(self) -> str:
        """Return what the vehicle waits for, for people."""
        ...


def leave_failures(
    way: Trajectory, limits: RestLimits, settling: Settling, leg: LegFrame, leave: Leave
) -> tuple[str, ...]:
    """Return why the vehicle has no leave for a way; empty if it has, or if it only rests there.

    Args:
        way: ends at rest; leg frame.
        limits: body and run-on.
        settling: how long the vehicle moves on.
        leg: the frame.
        leave: what it has leave for.
    """
    until_s = moving_until_s(way, settling)
    if until_s is None:
        return ()
    if until_s >= leave.expires_s or not lies_in_tube(way, limits, leg, leave.tube_m):
        return (leave.waits_for(),)
    area_m = occupied_ned_m(way, limits.body_radius_m, limits.run_on, leg)
    stranger = leave.who_may_come(area_m, until_s)
    return () if stranger is None else (f"{stranger} has left its tube and may come",)


def settling_in_tube(settling: Settling, assessment: Assessment) -> Settling:
    """Return how long the vehicle moves after its reference rests: at least its lag."""
    settle_s = max(settling.rest_settle_s, assessment.terms.attitude_lag_s)
    return replace(settling, rest_settle_s=settle_s)
