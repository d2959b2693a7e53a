"""Flights that are to end in a contact in motion: a mover faster than declared, at the worst time.

It stands in the way and comes at the vehicle when that can do no more than brake: `Dash` times it.
What a mover gains by 30 % within the time to rest is no more than what frames, cells and the
planner leave, unless the vehicle takes long to rest.  So it is fast, and brakes gently.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Any, Final

from gcs_tools.campaign.generator.airframes import SEEN_LATE_S
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.preflight.tier import start_clear_radius_m
from gcs_tools.scenario import Expectation, Plant, Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleField

_ALTITUDE_M: Final = 3.0
_SIZE_M: Final = 0.6
_SPARE: Final = 1.02


@dataclass(frozen=True)
class Ambush:
    """Vehicle and mover of a flight.

    Attributes:
        tilt_deg: of the vehicle, which brakes by it.
        cruise_mps: its speed.
        declared_mps: speed of movers that the contract declares.
        factor: by which the mover is faster.
        stands_m: how far along the leg it stands.
        comes_m: so far it comes to meet the vehicle.
        time_limit_s: of the flight.
    """

    tilt_deg: float
    cruise_mps: float
    declared_mps: float
    factor: float
    stands_m: float
    comes_m: float
    time_limit_s: float


def ambush_case(draw: random.Random) -> FlightCase:
    """Draw a flight in which a mover 30 % faster than declared comes at the worst time."""
    ambush = Ambush(
        tilt_deg=8.0,
        cruise_mps=draw.uniform(6.5, 7.5),
        declared_mps=3.0,
        factor=1.3,
        stands_m=62.0,
        comes_m=draw.uniform(13.0, 15.0),
        time_limit_s=20.0,
    )
    return case_of(ambush, draw.randrange(2**31))


def case_of(ambush: Ambush, seed: int) -> FlightCase:
    """Return the flight of an ambush, in which nothing is promised."""
    contract = _contract(ambush)
    mission = Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "start_clear_m": start_clear_radius_m(assess(contract)),
            "legs": [{"end_ned_m": [ambush.stands_m + 10.0, 0.0], "target_half_width_m": 4.0}],
        }
    )
    scenario = Scenario(
        name="ambush",
        contract=contract,
        mission=mission,
        obstacles=ObstacleField.of([]),
        plant=_plant(ambush, contract),
        faults=(),
        field_known=False,
        fly_outside_contract=False,
        expect=Expectation.model_validate({}),
    )
    return FlightCase(
        scenario,
        seed=seed,
        variant=f"x {ambush.factor:g}",
        outcomes=("arrived", "aborted", "held", "collided"),
        covered=False,
        time_limit_s=ambush.time_limit_s,
    )


def _contract(ambush: Ambush) -> Contract:
    terms: dict[str, Any] = {
        "vehicle": {
            "roll_max_deg": ambush.tilt_deg, "pitch_max_deg": ambush.tilt_deg,
            "thrust_to_weight": 2.0, "cruise_speed_mps": ambush.cruise_mps, "radius_m": 0.3,
            "tracking_error_m": 0.2, "velocity_error_mps": [0.1, 0.1], "reaction_time_s": 0.25,
            "attitude_lag_s": 0.25, "setpoint_loss_timeout_s": 0.5, "rest_settle_s": 0.1,
        },
        "requirements": {"passive_safety": False, "movers": "passive"},
        "sensor": {
            "detection_range_m": 80.0, "field_of_view_deg": 150.0, "frame_age_max_s": 0.3,
            "position_error_m": 0.03, "all_round_range_m": 80.0,
        },
        "environment": {
            "obstacle_size_max_m": 1.5, "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": 30.0,
            "movers": [
                {"class": "person", "speed_max_mps": ambush.declared_mps, "size_max_m": 1.0}
            ],
        },
    }  # fmt: skip
    for _ in range(2):  # the error of a face depends on the range
        clauses = assess(Contract.model_validate(terms)).clauses
        required = {clause.name: clause.required for clause in clauses}
        terms["sensor"]["detection_range_m"] = _SPARE * required["passive_silence.person"]
        terms["sensor"]["all_round_range_m"] = _SPARE * required["all_round.person"]
    return Contract.model_validate(terms)


def _plant(ambush: Ambush, contract: Contract) -> Plant:
    vehicle, sensor = contract.vehicle, contract.sensor
    shared = {"uncertainty_m": sensor.position_error_m, "message_version": 2, "rate_hz": 20.0}
    front = {"range_m": sensor.detection_range_m, "field_of_view_deg": sensor.field_of_view_deg}
    ring = {"range_m": sensor.all_round_range_m, "field_of_view_deg": 360.0}
    path = {
        "kind": "dash",
        "start_ned_m": (ambush.stands_m, 0.0),
        "meets_ned_m": (ambush.stands_m - ambush.comes_m, 0.0),
    }
    speed_mps = ambush.factor * ambush.declared_mps
    mover = {"id": "mover", "class": "person", "size_m": _SIZE_M, "speed_mps": speed_mps}
    return Plant.model_validate(
        {
            "realism": "ideal",
            "multirotor": {"thrust_to_weight": 2.0, "radius_m": vehicle.radius_m},
            "start": {"position_ned_m": [0.0, 0.0, -_ALTITUDE_M], "yaw_deg": 0.0},
            "tracking": {
                "toward_obstacle": True, "error_m": 0.97 * vehicle.tracking_error_m,
                "kinematic": True, "seen_late_s": SEEN_LATE_S,
            },
            "movers": [{**mover, "path": path}],
            "sensors": [
                {**shared, **front, "source": "front"},
                {**shared, **ring, "source": "ring"},
            ],
        }
    )  # fmt: skip
