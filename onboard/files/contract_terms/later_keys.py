"""Keys that contract files have got since their hash is part of authorizations."""

from __future__ import annotations

from typing import Final

# Keys added after the first version: absent from a contract's canonical form at their default.
LATER_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "vehicle": (
        "setpoint_loss_run_on_speed_mps",
        "tracking_error_z_m",
        "heading_error_deg",
        "estimator_reset_max_m",
        "drag_per_s",
        "setpoint_loss",
        "position_drift_mps",
        "clearance_wish_m",
        "radius_z_m",
        "height_drift_m",
        "height_drift_flight_m",
        "rest_settle_s",
        "rest_speed_mps",
        "setpoint_loss_run_time_s",
    ),
    "requirements": ("progress", "flight_time_max_s", "movers", "yield_max_s"),
    "sensor": (
        "thinnest_obstacle_m",
        "no_return_is_free_to_m",
        "position_error_z_m",
        "vertical_field_of_view_deg",
        "all_round_range_m",
    ),
    "environment": ("wind_max_mps", "terrain_max_m", "terrain_error_m", "movers"),
}
