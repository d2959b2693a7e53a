"""Drawing back from what is near and was not seen: from farther away, a look shows it.

What is nearer than about twice the body's radius no look from there shows, where the sensor may be
off by its pose's error (THEORY.md, "What is near").  Nothing here decides on safety:
`onboard.planning.rest_certifier` does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from onboard.planning.sidestep import has_room, is_tried, motion, overhangs_m, strip

if TYPE_CHECKING:
    from collections.abc import Iterator

    from onboard.planning.corridor.horizon import Horizon
    from onboard.planning.sidestep import Standstill

# Back along the leg, to either side, ahead: axis and direction.
_WAYS: Final = ((0, -1.0), (1, -1.0), (1, 1.0), (0, 1.0))
_SHARES: Final = (1.0, 0.75, 0.5)


def retreats(at: Standstill, distance_m: float) -> Iterator[Horizon]:
    """Yield motions along one axis, from rest to rest, whose strips are seen free; longest first.

    Args:
        at: where the vehicle rests, and what it knows.
        distance_m: how far to draw back where there is room.
    """
    x_m, y_m = at.place_leg_m
    for share in _SHARES:
        for axis, sign in _WAYS:
            way_m = sign * share * distance_m
            place_leg_m = (x_m + way_m, y_m) if axis == 0 else (x_m, y_m + way_m)
            if is_tried(at, place_leg_m):
                continue
            for overhang_m in overhangs_m(at.limits.run_on):
                if has_room(at, strip(x_m, y_m, (axis, way_m), overhang_m)):
                    found = motion(at, ((axis, way_m),), overhang_m)
                    if found is not None:
                        yield found
                        break
