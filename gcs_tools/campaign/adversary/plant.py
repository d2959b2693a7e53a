"""The plant of an adversary: every error of vehicle, estimate and detector at its bound."""

from __future__ import annotations

import math
from typing import Any, Final, get_args

from gcs_tools.campaign.adversary.contract import EMPTY_FRAMES, Timing
from gcs_tools.campaign.adversary.genes import Genes
from gcs_tools.campaign.generator.airframes import SEEN_LATE_S
from gcs_tools.scenario import Plant
from onboard.files.contract_file import Contract
from onboard.perception.placement import POSE_TIMING_S
from sitl.environment.detector_errors import FaceStrategy

# Of each error that the service monitors: a hair less, so that round-off does not exceed it.
USED: Final = 0.9995
# Of the velocity errors: an error of the heading turns one into the other.
_USED_OF_SPEEDS: Final = 0.97
_STRATEGIES: Final[tuple[FaceStrategy, ...]] = get_args(FaceStrategy)
# A scanner's box misses the end of a face by up to the arc between two rays; that much is faces.
_SCANNER_ERROR_MIN_M: Final = 0.08
_SCANNER_RESOLUTION_DEG: Final = 0.2
# Of the face error, where the estimate of the position errs; its faces have the rest.
_POSE_SHARE: Final = 0.3
_POSE_MOVES: Final = 0.1


def strategy_of(genes: Genes, contract: Contract) -> str:
    """Return what the detector does with its errors, in words."""
    if _scans(genes, contract):
        return "scanner"
    return genes.choice("strategy", _STRATEGIES)


def adversary_plant(
    genes: Genes, contract: Contract, timing: Timing, altitude_m: float, heading_rad: float
) -> Plant:
    """Return the plant, in hover at the origin with its nose about along the first leg."""
    vehicle, pose_m = contract.vehicle, pose_error_m(genes, contract)
    along_mps, across_mps = vehicle.velocity_error_mps
    yaw_rad = heading_rad + genes.uniform("yaw", -0.2, 0.2)
    return Plant.model_validate(
        {
            "realism": "ideal",
            "physics_rate_hz": 400,
            "multirotor": {
                "thrust_to_weight": vehicle.thrust_to_weight,
                "radius_m": vehicle.radius_m,
            },
            "start": {"position_ned_m": [0.0, 0.0, -altitude_m], "yaw_deg": math.degrees(yaw_rad)},
            "estimator": {
                "position_m": pose_m * math.sqrt(0.5),
                "heading_deg": USED * vehicle.heading_error_deg,
                "at_bound": True,
            },
            "tracking": {
                "toward_obstacle": True,
                # The error of the estimate moves on until it is seen.
                "error_m": max(USED * vehicle.tracking_error_m - _POSE_MOVES * pose_m, 0.0),
                "kinematic": True,
                "velocity_error_mps": [_USED_OF_SPEEDS * along_mps, _USED_OF_SPEEDS * across_mps],
                "seen_late_s": SEEN_LATE_S,
            },
            "sensors": [_sensor(genes, contract, timing, pose_m)],
        }
    )


def pose_error_m(genes: Genes, contract: Contract) -> float:
    """Return the error of the estimated position: a part of the face error, or none."""
    if not genes.choice("pose_error", (False, False, False, True)) or _scans(genes, contract):
        return 0.0
    share = min(_POSE_SHARE, 0.2 * contract.vehicle.tracking_error_m / _face_m(contract))
    return share * _face_m(contract)


def timing_error_m(contract: Contract) -> float:
    """Return what the age of a pose takes of the face error of boxes in the body frame."""
    vehicle = contract.vehicle
    fastest_mps = vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0]
    return fastest_mps * POSE_TIMING_S


def frame_of(genes: Genes, contract: Contract) -> str:
    """Return the frame of the boxes; only in the body frame does a heading error displace them."""
    turned = contract.vehicle.heading_error_deg > 0.0
    return "body_frd" if turned else genes.choice("frame", ("local_ned", "local_ned", "body_frd"))


def _face_m(contract: Contract) -> float:
    return contract.sensor.position_error_m


def _scans(genes: Genes, contract: Contract) -> bool:
    able = _face_m(contract) >= _SCANNER_ERROR_MIN_M
    return able and genes.choice("scanner", (False,) * 5 + (True,))


def _sensor(genes: Genes, contract: Contract, timing: Timing, pose_m: float) -> dict[str, Any]:
    frame = frame_of(genes, contract)
    face_m = USED * _face_m(contract) - pose_m
    if frame == "body_frd":
        face_m -= timing_error_m(contract)
    shared = {
        "range_m": contract.sensor.detection_range_m,
        "field_of_view_deg": contract.sensor.field_of_view_deg,
        "rate_hz": 1.0 / timing.period_s,
        "latency_s": timing.latency_s,
        "uncertainty_m": contract.sensor.position_error_m,
        "frame": frame,
    }
    if _scans(genes, contract):
        return {**shared, "scanner": {"resolution_deg": _SCANNER_RESOLUTION_DEG}}
    errors = {
        "faces": strategy_of(genes, contract),
        "late_m": genes.uniform("late", 1.0, 8.0),
        "confirm_frames": timing.confirm_frames,
        "empty_every": timing.empty_every,
        "empty_frames": EMPTY_FRAMES if timing.empty_every else 1,
    }
    return {**shared, "face_noise_m": max(face_m, 0.0), "errors": errors}
