"""Random vehicles and sensors that keep their contract, in some wind."""

from __future__ import annotations

import math
import random
from typing import Final

from gcs_tools.campaign.generator.airframes import Airframe
from gcs_tools.campaign.generator.fields import ned_m
from gcs_tools.scenario import Plant
from onboard.files.contract_file import Contract
from onboard.perception.placement import POSE_TIMING_S

_MEAN_WIND_MAX_MPS: Final = 3.0
_TURBULENCE_MAX_MPS: Final = 0.3


def matching_plant(
    draw: random.Random, contract: Contract, airframe: Airframe, down_m: float
) -> Plant:
    """Draw a vehicle and a sensor within the contract's errors, and some wind.

    Args:
        draw: the flight's random numbers.
        contract: that the vehicle and its sensor keep.
        airframe: the kind of vehicle, whose errors the contract declares.
        down_m: NED height that the flight starts at.
    """
    direction_rad = draw.uniform(-math.pi, math.pi)
    wind_mps = draw.choice((0.0, draw.uniform(0.0, _MEAN_WIND_MAX_MPS)))
    turbulence_mps = draw.choice((0.0, draw.uniform(0.0, _TURBULENCE_MAX_MPS)))
    noise_share, frame = draw.random(), draw.choice(("local_ned", "body_frd"))
    kind = airframe.plant(draw, contract)
    if airframe.as_in_the_field:
        frame = "body_frd"  # only there does the daemon allow for the heading's error
    noise_m = noise_share * noise_max_m(contract, frame, airframe.wander_m)
    face_noise_m = draw.random() * (noise_max_m(contract, frame, airframe.wander_m) - noise_m)
    return Plant.model_validate(
        {
            **kind,
            "multirotor": {
                "thrust_to_weight": contract.vehicle.thrust_to_weight,
                "radius_m": contract.vehicle.radius_m,
            },
            "start": {"position_ned_m": [0.0, 0.0, down_m]},
            "wind": {
                "mean_ned_mps": [*ned_m(direction_rad, wind_mps, 0.0), 0.0],
                "turbulence_mps": turbulence_mps,
            },
            "sensors": [
                {
                    "range_m": contract.sensor.detection_range_m,
                    "field_of_view_deg": contract.sensor.field_of_view_deg,
                    "noise_m": noise_m,
                    "face_noise_m": face_noise_m,
                    "uncertainty_m": contract.sensor.position_error_m,
                    "frame": frame,
                }
            ],
        }
    )


def noise_max_m(contract: Contract, frame: str, wander_m: float = 0.0) -> float:
    """Return the largest error [m] of either coordinate of a centre that the contract admits.

    Errors uniform in a square add up along its diagonal.  Boxes in the body frame are placed with a
    pose whose time is only as exact as telemetry, during which the vehicle moves on.

    Args:
        contract: that the sensor keeps.
        frame: of its boxes.
        wander_m: how far the vehicle's estimate may place them off, on either axis.
    """
    vehicle, error_m = contract.vehicle, contract.sensor.position_error_m - wander_m
    if frame == "body_frd":
        error_m -= (vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0]) * POSE_TIMING_S
    return max(error_m, 0.0) * math.sqrt(0.5)
