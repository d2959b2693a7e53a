"""Which statements of a contract about heights belong together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from onboard.files.contract_file import Contract


def height_objection(contract: Contract) -> str | None:
    """Return why the heights of a contract cannot be used; None if they can, or if it has none.

    Obstacles count as pillars of any height unless all is stated that tells which of them are out
    of the way.
    """
    vehicle, sensor = contract.vehicle, contract.sensor
    stated = {
        "vehicle.radius_z_m [m]": vehicle.radius_z_m,
        "vehicle.height_drift_m [m]": vehicle.height_drift_m,
        "sensor.position_error_z_m [m]": sensor.position_error_z_m,
        "sensor.vertical_field_of_view_deg [deg]": sensor.vertical_field_of_view_deg,
    }
    missing = [key for key, value in stated.items() if value is None]
    if vehicle.radius_z_m is None and len(missing) == len(stated):
        return None
    if vehicle.radius_z_m is None or missing:
        return (
            f"{', '.join(missing)} not stated (expected all of {', '.join(stated)}, or none of "
            "them: obstacles count as pillars of any height then)"
        )
    if not contract.requirements.stop:
        return (
            "requirements.stop = false beside vehicle.radius_z_m (expected true: heights of "
            "obstacles count only where every way is certified at one height)"
        )
    tilted_m = vehicle.radius_m * math.sin(
        math.atan(
            math.hypot(
                math.tan(math.radians(vehicle.roll_max_deg)),
                math.tan(math.radians(vehicle.pitch_max_deg)),
            )
        )
    )
    if vehicle.radius_z_m <= tilted_m:
        return (
            f"vehicle.radius_z_m = {vehicle.radius_z_m:g} m (expected more than radius_m times the "
            f"sine of the greatest tilt, {tilted_m:.3f} m, by half the height of the body)"
        )
    return None
