"""Whether a way to rest is certified against movers, and has leave, besides the space seen free.

One trajectory is held that is certified against both; a candidate replaces it only if it is, too.
What has been accepted is not checked again: while movers keep to their speeds it stays valid,
whatever appears (THEORY.md, "Movers").
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from onboard.guidance.movers.leave import leave_failures, settling_in_tube
from onboard.planning.mover_certifier import UNASKED, Movers, Settling, mover_failures

if TYPE_CHECKING:
    from onboard.contract.assessment import Assessment
    from onboard.geometry.frames import Vector
    from onboard.guidance.movers.leave import Leave
    from onboard.guidance.situation import Situation
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.rest_certifier import RestLimits


class KnownMovers(Protocol):
    """What is known of movers: the seam to monitoring."""

    @property
    def movers(self) -> Movers | None:
        """What ways are certified against; None where the contract has no movers."""
        ...


class NoMovers:
    """Nothing moves, as the contract says."""

    movers: Movers | None = None


class MoverGuard:
    """Checks ways to rest against movers, and whether the other vehicles of a fleet give leave.

    Args:
        situation: what is flown.

    Attributes:
        known: what is known of movers.
        leave: what the vehicle has leave for; None where it is of no fleet.
        reason: why the last way was refused.
        refused: the last way that movers spoke against, with its limits.
    """

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self.known: KnownMovers = NoMovers()
        self.leave: Leave | None = None
        self._refused_s = self._without_leave_s = -math.inf
        self.reason = ""
        self.refused: tuple[Trajectory, RestLimits] | None = None

    def failures(
        self, way: Trajectory, limits: RestLimits, now_s: float, *, seen_only: bool = False
    ) -> tuple[str, ...]:
        """Return why a mover may be where the vehicle would still move, or why it has no leave.

        Args:
            way: certified in the space seen free; leg frame.
            limits: body and run-on.
            now_s: the time.
            seen_only: ask about movers that are seen, not about those that may be where none has
                been looked for: a place on a plan's way will be looked at again before.
        """
        movers = self.known.movers
        if movers is not None and seen_only:
            movers = replace(movers, places=UNASKED)
        situation = self._situation
        settling = settling_of(situation.assessment)
        found: tuple[str, ...] = ()
        if movers is not None:
            found = mover_failures(way, limits, settling, situation.leg, movers)
        if movers is not None and found and not seen_only:
            self._refused_s, self.reason = now_s, found[0]
            self.refused = way, limits
            if movers.missing is not None:
                self.reason = f"no place is known to hold no mover: {movers.missing}"
        if found or seen_only or self.leave is None:
            return found
        settling = settling_in_tube(settling, situation.assessment)
        found = leave_failures(way, limits, settling, situation.leg, self.leave)
        if found:
            self._refused_s = self._without_leave_s = now_s
            self.reason = found[0]
        return found

    def has_lost_view(self, position_leg_m: Vector, now_s: float) -> bool:
        """Tell whether movers may have come, unseen, to where the vehicle rests.

        Without a sensor that sees all round, nothing leads on then.
        """
        movers, situation = self.known.movers, self._situation
        terms = situation.assessment.terms
        if movers is None or terms.movers_level != "passive_in_view":
            return False
        here_ned_m = np.array((situation.leg.position_ned(position_leg_m)[:2],))
        low, high = here_ned_m - terms.body_m, here_ned_m + terms.body_m
        return movers.places.first_reached(low, high, np.array((now_s,))) is not None

    def waits_for_leave(self, now_s: float, within_s: float) -> bool:
        """Tell whether a way was refused lately since the vehicle has no leave for it."""
        return now_s - self._without_leave_s <= within_s

    def has_refused(self, now_s: float, within_s: float) -> bool:
        """Tell whether a way that was free otherwise has been refused lately."""
        return now_s - self._refused_s <= within_s


def settling_of(assessment: Assessment) -> Settling:
    """Return how long the vehicle of a contract moves after its setpoint rests, or is the last."""
    terms, limits = assessment.terms, assessment.limits
    loss_s = terms.setpoint_loss_timeout_s + terms.attitude_lag_s
    return Settling(
        rest_settle_s=terms.rest_settle_s,
        loss_s=loss_s if terms.passive_safety else None,
        brake_mps2=min(limits.brake_mps2, limits.left_mps2, limits.right_mps2),
        measured_s=terms.setpoint_loss_run_time_s,
    )
