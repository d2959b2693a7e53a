"""Which statements of a contract about heights belong together."""

from __future__ import annotations

import math
from typing import NamedTuple


class StatedHeights(NamedTuple):
    """What a contract states about heights, and what that needs of the rest.

    Attributes:
        radius_z_m: of the body above and below its centre; None if not stated.
        height_drift_m: of the estimated height; None if not stated.
        position_error_z_m: of top and bottom of a box; None if not stated.
        vertical_field_of_view_deg: up and down; None if not stated.
        radius_m: of the body.
        roll_max_deg, pitch_max_deg: greatest angles of the contract.
        stop: whether a way to rest is required.
    """

    radius_z_m: float | None
    height_drift_m: float | None
    position_error_z_m: float | None
    vertical_field_of_view_deg: tuple[float, float] | None
    radius_m: float
    roll_max_deg: float
    pitch_max_deg: float
    stop: bool

    @property
    def tilted_m(self) -> float:
        """How far a disc of the body's radius reaches up and down at the greatest tilt."""
        roll, pitch = math.radians(self.roll_max_deg), math.radians(self.pitch_max_deg)
        return self.radius_m * math.sin(math.atan(math.hypot(math.tan(roll), math.tan(pitch))))


def height_objection(stated: StatedHeights) -> str | None:
    """Return why the heights of a contract cannot be used; None if they can, or if it has none.

    Obstacles count as pillars of any height unless all is stated that tells which of them are out
    of the way.
    """
    terms = {
        "vehicle.radius_z_m [m]": stated.radius_z_m,
        "vehicle.height_drift_m [m]": stated.height_drift_m,
        "sensor.position_error_z_m [m]": stated.position_error_z_m,
        "sensor.vertical_field_of_view_deg [deg]": stated.vertical_field_of_view_deg,
    }
    missing = [key for key, value in terms.items() if value is None]
    if len(missing) == len(terms):
        return None
    if stated.radius_z_m is None or missing:
        return (
            f"{', '.join(missing)} not stated (expected all of {', '.join(terms)}, or none of "
            "them: obstacles count as pillars of any height then)"
        )
    if not stated.stop:
        return (
            "requirements.stop = false beside vehicle.radius_z_m (expected true: heights of "
            "obstacles count only where every way is certified at one height)"
        )
    if stated.radius_z_m <= stated.tilted_m:
        return (
            f"vehicle.radius_z_m = {stated.radius_z_m:g} m (expected more than radius_m times the "
            f"sine of the greatest tilt, {stated.tilted_m:.3f} m, by half the height of the body)"
        )
    return None
