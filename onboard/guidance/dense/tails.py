"""Ways to come to rest from what is intended: what the shield has certified, cheapest first."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.contract.agility import AccelerationLimits
from onboard.motion.trajectory import Trajectory, X, Y, Z
from onboard.planning.closed_form import brake_to_hover

if TYPE_CHECKING:
    from collections.abc import Iterator

    from onboard.planning.problem import Envelope

# Knots that are nearer to each other than this are one.
_SAME_S: Final = 1e-9
# Share of W that gentle braking takes.
_GENTLE: Final = 0.4
# Slower than this sideways there is no lateral plan to keep.
_STRAIGHT_MPS: Final = 1e-3


def ways_to_rest(
    head: Trajectory, intended: Trajectory, envelope: Envelope
) -> Iterator[Trajectory]:
    """Yield ways to rest that begin as intended, cheapest first.

    Args:
        head: what is flown until the switch.
        intended: what would be flown after it.
        envelope: what the vehicle can be asked to fly.
    """
    switch_s, state = head.end_s, head.final
    braking = brake_to_hover(state, switch_s, envelope)
    yield head.followed_by(braking)
    # A setpoint that brakes hard lets the vehicle run back, should the stream be lost.
    yield head.followed_by(brake_to_hover(state, switch_s, _gentle(envelope)))
    if intended.end_s <= switch_s + _SAME_S:
        return
    planned = intended.from_time(switch_s)
    if np.abs(planned.velocity_leg_mps[:, Y]).max() > _STRAIGHT_MPS:
        yield head.followed_by(_braking_along(braking, planned))
    final = planned.final
    if np.abs(final.velocity_leg_mps).max() > _STRAIGHT_MPS:
        planned = planned.followed_by(brake_to_hover(final, planned.end_s, envelope))
    yield head.followed_by(planned)


def _gentle(envelope: Envelope) -> Envelope:
    limits = envelope.limits
    return replace(
        envelope,
        limits=AccelerationLimits(
            _GENTLE * limits.brake_mps2,
            _GENTLE * limits.forward_mps2,
            _GENTLE * limits.left_mps2,
            _GENTLE * limits.right_mps2,
        ),
    )


def _braking_along(braking: Trajectory, planned: Trajectory) -> Trajectory:
    """Return a trajectory that brakes along the leg, and moves sideways as planned."""
    knots_s = np.unique((*braking.knots_s, *planned.knots_s))
    kept = np.concatenate(([True], np.diff(knots_s) > _SAME_S))
    knots_s = knots_s[kept]
    durations_s = np.diff(knots_s)
    arrays = [np.zeros((len(durations_s), 3)) for _ in range(4)]
    for row, (begin_s, duration_s) in enumerate(zip(knots_s, durations_s, strict=False)):
        for axis, source in ((X, braking), (Y, planned), (Z, braking)):
            state = source.sample(float(begin_s))
            for array, vector in zip(arrays[:3], state, strict=True):
                array[row, axis] = vector[axis]
            arrays[3][row, axis] = _jerk_at(source, begin_s + duration_s / 2.0, axis)
    return Trajectory(float(knots_s[0]), durations_s, *arrays)


def _jerk_at(trajectory: Trajectory, time_s: float, axis: int) -> float:
    piece = bisect_right(trajectory.knots_s, time_s) - 1
    coasting = not 0 <= piece < len(trajectory.durations_s)
    return 0.0 if coasting else float(trajectory.jerk_leg_mps3[piece, axis])
