"""A contract's numbers, as monitors and watches get them."""

import math

from onboard.contract.assessment import Terms

TERMS = Terms[float](
    roll_max_rad=0.26,
    pitch_max_rad=0.26,
    thrust_to_weight=2.0,
    cruise_speed_mps=2.8,
    radius_m=0.3,
    tracking_error_m=0.25,
    velocity_error_x_mps=0.2,
    velocity_error_y_mps=0.1,
    reaction_time_s=0.15,
    attitude_lag_s=0.15,
    setpoint_loss_timeout_s=0.5,
    detection_range_m=12.0,
    field_of_view_rad=math.radians(120.0),
    frame_age_max_s=0.3,
    recentring_speed_mps=0.0,
    position_error_m=0.05,
    obstacle_size_max_m=4.0,
    obstacle_size_min_m=0.0,
    obstacle_separation_min_m=16.0,
    tracking_error_z_m=1.0,
    heading_error_rad=0.0,
    estimator_reset_max_m=0.0,
    drag_per_s=0.45,
)
