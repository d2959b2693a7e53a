"""Which statements of a contract about heights belong together."""

from __future__ import annotations

import math
from collections.abc import Mapping

RADIUS_Z = "vehicle.radius_z_m [m]"


def height_objection(
    stated: Mapping[str, object], radius_m: float, tilts_deg: tuple[float, float], *, stop: bool
) -> str | None:
    """Return why the heights of a contract cannot be used; None if they can, or if it has none.

    Obstacles count as pillars of any height unless all is stated that tells which of them are out
    of the way.

    Args:
        stated: the values by their keys, with units; None for what is not stated.
        radius_m: of the vehicle.
        tilts_deg: its greatest roll and pitch.
        stop: the requirement of that name.
    """
    missing = [key for key, value in stated.items() if value is None]
    if len(missing) == len(stated):
        return None
    radius_z_m = stated[RADIUS_Z]
    if missing or not isinstance(radius_z_m, float):
        return (
            f"{', '.join(missing)} not stated (expected all of {', '.join(stated)}, or none of "
            "them: obstacles count as pillars of any height then)"
        )
    if not stop:
        return (
            "requirements.stop = false beside vehicle.radius_z_m (expected true: heights of "
            "obstacles count only where every way is certified at one height)"
        )
    tilt_rad = math.atan(math.hypot(*(math.tan(math.radians(tilt)) for tilt in tilts_deg)))
    tilted_m = radius_m * math.sin(tilt_rad)
    if radius_z_m <= tilted_m:
        return (
            f"vehicle.radius_z_m = {radius_z_m:g} m (expected more than radius_m times the sine of "
            f"the greatest tilt, {tilted_m:.3f} m, by half the height of the body)"
        )
    return None
