"""Stops that a plan could be left for: it is flown for a few pieces, then the vehicle brakes.

A plan of the corridor takes seconds to come to rest, in which a mover comes far.  These stops take
as few pieces as the limits allow.  Nothing here is relied on: each is certified as any other way.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.planning.corridor.horizon import PIECE_S, PIECES, Horizon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from onboard.geometry.frames import FloatArray
    from onboard.guidance.movers.mover_guard import MoverGuard
    from onboard.planning.certifier import Certificate
    from onboard.planning.rest_certifier import RestLimits

# So many pieces of a plan are flown before it is left, the most first.
_FLOWN: Final = (10, 5, 2, 1)
# A stop that leads no farther than this is not worth while.
_NOWHERE_M: Final = 0.1
# Of the limits, for round-off.
_SHARE: Final = 0.999


def early_stops(plan: Horizon, limits: RestLimits) -> Iterator[Horizon]:
    """Yield stops along a plan, the farthest first."""
    for flown in _FLOWN:
        if flown >= len(plan.jerk_mps3) or np.abs(plan.nodes[flown, 1:]).max() == 0.0:
            continue
        stopping = _stopping_jerks(plan.nodes[flown], limits, PIECES - flown)
        if stopping is None:
            continue
        jerk_mps3 = np.zeros((PIECES, 2))
        jerk_mps3[:flown] = plan.jerk_mps3[:flown]
        jerk_mps3[flown : flown + len(stopping)] = stopping
        stop = Horizon.integrated(plan.start_s, plan.start, jerk_mps3)
        # Exactly at rest from there on.
        rests = flown + len(stopping)
        stop.nodes[rests:, 1:] = 0.0
        stop.nodes[rests:, 0] = stop.nodes[rests, 0]
        yield stop


def adopts_some(
    plan: Horizon,
    limits: RestLimits,
    guard: MoverGuard,
    adopt: Callable[[Horizon], Certificate | None],
    now_s: float,
) -> bool:
    """Have a plan take over, or an earlier stop along it where only movers speak against it.

    Args:
        plan: leads on.
        limits: of ways to rest.
        guard: tells whether movers do.
        adopt: has a plan take over if it certifies; None if it comes too late.
        now_s: the time.
    """
    certificate = adopt(plan)
    if certificate is None or certificate.valid:
        return certificate is not None
    if not guard.has_refused(now_s, 0.0):
        return False
    for stop in early_stops(plan, limits):
        if math.dist(stop.nodes[0, 0], stop.nodes[-1, 0]) < _NOWHERE_M:
            return False
        certificate = adopt(stop)
        if certificate is not None and certificate.valid:
            return True
    return False


def _stopping_jerks(state: FloatArray, limits: RestLimits, pieces_max: int) -> FloatArray | None:
    """Return the jerks (n, 2) of the shortest stop from a state (3, 2) that keeps to the limits."""
    jerk_max_mps3 = _SHARE * np.array(limits.jerk_xy_max_mps3)
    brake, forward, left, right = limits.acceleration_max_mps2
    least_mps2 = _SHARE * np.array((-brake, -left))
    most_mps2 = _SHARE * np.array((forward, right))
    for count in range(2, pieces_max + 1):
        jerks = _least_jerks(count) @ _asked(state, count)
        if (np.abs(jerks) > jerk_max_mps3).any():
            continue
        pull = state[2] + np.cumsum(jerks * PIECE_S, axis=0)
        within = (pull >= least_mps2).all() and (pull <= most_mps2).all()
        if within and np.hypot(*pull.T).max() <= _SHARE * limits.acceleration_disc_mps2:
            return jerks
    return None


def _asked(state: FloatArray, count: int) -> FloatArray:
    """Return the changes of velocity and acceleration (2, 2) that jerks have to make."""
    coasted_mps = state[1] + count * PIECE_S * state[2]
    asked: FloatArray = -np.stack((coasted_mps, state[2]))
    return asked


@cache
def _least_jerks(count: int) -> FloatArray:
    """Return the matrix (count, 2) from these changes to the jerks of the least norm."""
    left = count - 1.0 - np.arange(count)
    effect = np.stack((PIECE_S**2 * (0.5 + left), np.full(count, PIECE_S)))
    least: FloatArray = np.linalg.pinv(effect)
    return least
