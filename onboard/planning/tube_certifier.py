"""Certifies a way to rest within a tube: each short piece, run-on included, in one of its boxes.

Exact in continuous time as `rest_certifier`: a piece and its run-on lie in the box of their
Bernstein points.  A piece between two boxes is halved a few times; boxes in a row overlap by more
than what is left of it then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from onboard.planning.mover_certifier import OWN_PLACE, swept_ned
from onboard.planning.rest_certifier import GRID_TOLERANCE_M, halves, motion_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from onboard.contract.run_on import RunOn
    from onboard.geometry.frames import FloatArray, LegFrame
    from onboard.motion.trajectory import Trajectory
    from onboard.planning.rest_certifier import RestLimits

_SPLITS_MAX: Final = 5


def occupied_ned_m(
    way: Trajectory, body_radius_m: float, run_on: RunOn, leg: LegFrame
) -> FloatArray:
    """Return boxes that hold the body on a way, and on the run-on of each of its setpoints.

    Args:
        way: leg frame.
        body_radius_m: radius of the vehicle plus its tracking error.
        run_on: how the vehicle runs on after a loss of the stream; without points: not asked.
        leg: the frame.

    Returns:
        (N, 4), north from, to, east from, to, in the order in which they are flown.
    """
    low, high = swept_ned(motion_points(way), (OWN_PLACE, *run_on.gains), leg)
    grown_m = body_radius_m + 2.0 * GRID_TOLERANCE_M
    return _boxes(low - grown_m, high + grown_m)


def lies_in_tube(way: Trajectory, limits: RestLimits, leg: LegFrame, tube_m: FloatArray) -> bool:
    """Tell whether the body stays in a tube.

    Args:
        way: ends at rest; leg frame.
        limits: body and run-on.
        leg: the frame.
        tube_m: (N, 4), where body and tracking error may be.
    """
    if not len(tube_m):
        return False
    points = motion_points(way)
    grown_m, run_on = limits.body_radius_m + 2.0 * GRID_TOLERANCE_M, limits.run_on
    whole = (OWN_PLACE, *run_on.gains)
    for _ in range(_SPLITS_MAX + 1):
        outside = ~_are_inside(points, whole, grown_m, leg, tube_m)
        if run_on.gains and outside.any():
            # The run as a whole may be longer than two boxes have in common: strip by strip.
            suspects = points[:, outside]
            strips = [_are_inside(suspects, strip, grown_m, leg, tube_m) for strip in run_on.strips]
            outside[outside] = ~np.logical_and.reduce(strips)
        if not outside.any():
            return True
        points = halves(points[:, outside])
    return False


def _are_inside(
    points: FloatArray,
    gains: tuple[tuple[float, float], ...],
    grown_m: float,
    leg: LegFrame,
    tube_m: FloatArray,
) -> NDArray[np.bool_]:
    """Tell of each piece whether one box of a tube holds it, with that part of its run-on."""
    low, high = swept_ned(points, gains, leg)
    boxes_m = _boxes(low - grown_m, high + grown_m)[:, None]
    inside = (tube_m[:, 0::2] <= boxes_m[..., 0::2]) & (boxes_m[..., 1::2] <= tube_m[:, 1::2])
    return np.asarray(np.logical_and.reduce(inside, axis=2).any(axis=1))


def _boxes(low: FloatArray, high: FloatArray) -> FloatArray:
    boxes_m: FloatArray = np.column_stack((low[:, 0], high[:, 0], low[:, 1], high[:, 1]))
    return boxes_m
