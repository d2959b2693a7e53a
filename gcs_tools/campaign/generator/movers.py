"""Random flights among movers: hostile ones, at the speed that the contract declares, or faster.

Every error is at its bound: the tracking error toward the nearest mover, faces by a strategy, the
frames of two sensors staggered, names of movers exchanged, parts of movers at the edges of a view.
"""

from __future__ import annotations

import math
import random
from typing import Any, Final, get_args

from gcs_tools.campaign.generator.airframes import SEEN_LATE_S
from gcs_tools.campaign.generator.case import NO_FAULT, FlightCase
from gcs_tools.campaign.generator.scenarios import ATTEMPTS_MAX
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import start_clear_radius_m
from gcs_tools.scenario import Expectation, Outcome, Plant, Scenario
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from sitl.environment.detector_errors import FaceStrategy
from sitl.environment.movers.config import MoverConfig
from sitl.virtual.faults.schema import Fault

_ALTITUDE_M: Final = 3.0
# A hair less than declared, so that round-off does not exceed it.
_USED: Final = 0.9995
# Of the tracking error, which turns from one mover to another faster than it is seen to.
_USED_OF_TRACKING: Final = 0.97
_SPEEDS_MPS: Final = (0.5, 1.0, 1.5)
_STRATEGIES: Final[tuple[FaceStrategy, ...]] = get_args(FaceStrategy)
# By so much farther than the clauses require the sensors see.
_SPARE: Final = (1.01, 1.8)
_FASTER: Final = 1.3
_TIME_LIMIT_S: Final = 40.0
# Of movers that are passed in flight: v_o as a share of the cruise speed, and the vehicle's.
_SLOW_SHARE: Final = (0.1, 0.2)
_PASSING_MPS: Final = (1.5, 2.5)
_PASSING_LIMIT_S: Final = 45.0


def mover_case(draw: random.Random, *, faster: bool = False) -> FlightCase:
    """Draw a flight among movers.

    Args:
        draw: of everything.
        faster: whether the movers are 30 % faster than declared: then nothing is promised.
    """
    for _ in range(ATTEMPTS_MAX):
        speed_mps = draw.choice(_SPEEDS_MPS)
        assessment = _assessment(draw, speed_mps)
        if assessment is None:
            continue
        contract = assessment.contract
        length_m = draw.uniform(20.0, 30.0)
        mission = _mission(draw, contract, length_m)
        if not check(contract, None, mission).may_fly:
            continue
        true_mps = speed_mps * (_FASTER if faster else _USED)
        scenario = Scenario(
            name="movers",
            contract=contract,
            mission=mission,
            obstacles=_stems(draw, contract, length_m),
            plant=_plant(draw, contract, length_m, true_mps),
            faults=_late_ticks(draw),
            field_known=False,
            fly_outside_contract=False,
            expect=Expectation.model_validate({}),
        )
        return FlightCase(
            scenario,
            seed=draw.randrange(2**31),
            variant="faster" if faster else NO_FAULT,
            outcomes=("arrived", "aborted", "held", "collided")
            if faster
            else _outcomes(scenario.faults),
            covered=not faster,
            time_limit_s=_TIME_LIMIT_S,
        )
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no flight among movers that may be flown")


def passed_mover_case(draw: random.Random) -> FlightCase:
    """Draw a flight whose contract has slow movers passed in flight, one at a time.

    In a third of the flights there are more, so that the separation is broken: then, too, the
    vehicle is at rest before any contact.
    """
    for _ in range(ATTEMPTS_MAX):
        contract = _passing_contract(draw)
        length_m = draw.uniform(34.0, 40.0)
        mission = _mission(draw, contract, length_m)
        if not check(contract, None, mission).may_fly:
            continue
        true_mps = _USED * contract.environment.movers[0].speed_max_mps
        plant = _plant(draw, contract, length_m, true_mps)
        movers = _movers_ahead(draw, length_m, true_mps)
        scenario = Scenario(
            name="passed-movers",
            contract=contract,
            mission=mission,
            obstacles=_stems(draw, contract, length_m),
            plant=plant.model_copy(update={"movers": movers}),
            faults=_late_ticks(draw),
            field_known=False,
            fly_outside_contract=False,
            expect=Expectation.model_validate({}),
        )
        return FlightCase(
            scenario,
            seed=draw.randrange(2**31),
            outcomes=_outcomes(scenario.faults),
            time_limit_s=_PASSING_LIMIT_S,
        )
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no flight past movers that may be flown")


def _passing_contract(draw: random.Random) -> Contract:
    """Draw a contract that has movers passed, with range and separation to spare."""
    speed_mps = draw.uniform(*_PASSING_MPS)
    mover_mps = draw.uniform(*_SLOW_SHARE) * speed_mps
    terms: dict[str, Any] = {
        "vehicle": _vehicle(draw, speed_mps),
        "requirements": {"passive_safety": draw.random() < 0.3, "movers": "avoid"},
        "sensor": {
            "detection_range_m": draw.uniform(13.0, 16.0), "field_of_view_deg": 120.0,
            "frame_age_max_s": 0.3, "position_error_m": draw.uniform(0.03, 0.1),
            "all_round_range_m": 13.0,
        },
        "environment": {
            "obstacle_size_max_m": 1.5, "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": 60.0,
            "movers": [
                {"class": "person", "speed_max_mps": mover_mps, "size_max_m": 1.0,
                 "hidden": draw.random() < 0.2},
            ],
        },
    }  # fmt: skip
    return Contract.model_validate(terms)


def _vehicle(draw: random.Random, cruise_speed_mps: float) -> dict[str, Any]:
    return {
        "roll_max_deg": 20.0, "pitch_max_deg": 20.0, "thrust_to_weight": 2.0,
        "cruise_speed_mps": cruise_speed_mps, "radius_m": 0.3,
        "tracking_error_m": draw.uniform(0.1, 0.35), "velocity_error_mps": [0.1, 0.1],
        "reaction_time_s": 0.25, "attitude_lag_s": 0.25, "setpoint_loss_timeout_s": 0.5,
        "setpoint_loss": {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8},
        "setpoint_loss_run_time_s": 3.0, "rest_settle_s": 0.4,
    }  # fmt: skip


def _movers_ahead(
    draw: random.Random, length_m: float, speed_mps: float
) -> tuple[MoverConfig, ...]:
    """Draw one mover on the way, or more: hostile, coming, going, crossing, or standing."""
    movers = []
    for number in range(draw.choice((1, 1, 2, 3))):
        ahead_m, aside_m = draw.uniform(14.0, length_m - 14.0), draw.uniform(-2.0, 2.0)
        start = [ahead_m, aside_m]
        path = draw.choice(
            (
                {"kind": "hostile", "start_ned_m": start},
                {"kind": "pursuit", "start_ned_m": start, "lead_s": draw.choice((0.0, 2.0))},
                {"kind": "waypoints", "places_ned_m": [start, [0.0, aside_m]]},
                {"kind": "waypoints", "places_ned_m": [start, [length_m, aside_m]]},
                {"kind": "waypoints", "places_ned_m": [start, [ahead_m, 6.0], [ahead_m, -6.0]]},
                {"kind": "waypoints", "places_ned_m": [start, [ahead_m + 0.01, aside_m]]},
            )
        )
        movers.append(
            MoverConfig.model_validate(
                {
                    "id": f"mover{number}",
                    "class": "person",
                    "size_m": draw.uniform(0.3, 1.0),
                    "speed_mps": speed_mps,
                    "path": path,
                }
            )
        )
    return tuple(movers)


def _assessment(draw: random.Random, speed_mps: float) -> Assessment | None:
    """Draw a contract whose sensors see a little farther than its clauses require."""
    best_effort = draw.random() < 0.5
    terms: dict[str, Any] = {
        "vehicle": _vehicle(draw, draw.uniform(1.0, 2.5)),
        "requirements": {
            "passive_safety": draw.random() < 0.3, "movers": "passive",
            "progress": "best_effort" if best_effort else "guaranteed",
        },
        "sensor": {
            "detection_range_m": 60.0, "field_of_view_deg": draw.choice((120.0, 150.0)),
            "frame_age_max_s": 0.3, "position_error_m": draw.uniform(0.03, 0.1),
            "all_round_range_m": 60.0,
        },
        "environment": {
            "obstacle_size_max_m": 1.5, "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": 30.0,
            "movers": [
                {"class": "person", "speed_max_mps": speed_mps, "size_max_m": 1.0,
                 "hidden": draw.random() < 0.3},
            ],
        },
    }  # fmt: skip
    spare = draw.uniform(*_SPARE)
    for _ in range(2):  # the error of a face depends on the range
        assessment = assess(Contract.model_validate(terms))
        required = {clause.name: clause.required for clause in assessment.clauses}
        front = ("passive_range.", "passive_silence.", "passive_dead_daemon.", "detection_range",
                 "edge_visibility", "stop", "sensor_silence", "passive_safety")  # fmt: skip
        terms["sensor"]["detection_range_m"] = spare * max(
            value for name, value in required.items() if name.startswith(front)
        )
        terms["sensor"]["all_round_range_m"] = spare * required["all_round.person"]
    assessment = assess(Contract.model_validate(terms))
    broken = [each for each in assessment.clauses if not each.holds and each.concerns == "safety"]
    return None if broken else assessment


def _mission(draw: random.Random, contract: Contract, length_m: float) -> Mission:
    nose = "path" if contract.requirements.progress == "best_effort" else "leg"
    return Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "heading": draw.choice(("leg", nose)),
            "start_clear_m": start_clear_radius_m(assess(contract)),
            "legs": [{"end_ned_m": [length_m, 0.0], "target_half_width_m": 4.0}],
        }
    )


def _stems(draw: random.Random, contract: Contract, length_m: float) -> ObstacleField:
    """Draw a few stems, or one obstacle where passing is guaranteed."""
    count = 6 if contract.requirements.progress == "best_effort" else 1
    stems = []
    for number in range(count):
        size_m = draw.uniform(0.3, 0.8)
        north_m = draw.uniform(6.0, length_m - 4.0)
        side_m = draw.choice((-1.0, 1.0)) * draw.uniform(0.0, 7.0)
        stems.append(
            Obstacle(
                id=f"stem{number}",
                center_ned_m=(north_m, side_m),
                size_m=(size_m, size_m),
                yaw_deg=draw.uniform(0.0, 90.0),
            )
        )
    return ObstacleField.of(stems)


def _plant(draw: random.Random, contract: Contract, length_m: float, speed_mps: float) -> Plant:
    vehicle, sensor = contract.vehicle, contract.sensor
    face_m = _USED * sensor.position_error_m - 0.02 * vehicle.cruise_speed_mps * 0.5
    shared = {
        "uncertainty_m": sensor.position_error_m,
        "face_noise_m": max(face_m, 0.0),
        "frame": draw.choice(("local_ned", "body_frd")),
        "message_version": 2,
        "mover_swap_share": draw.choice((0.0, 0.05, 0.3)),
        "errors": {"faces": draw.choice(_STRATEGIES), "confirm_frames": draw.choice((1, 2, 3))},
    }
    front = {
        **shared, "source": "front", "range_m": sensor.detection_range_m, "rate_hz": 20.0,
        "field_of_view_deg": sensor.field_of_view_deg, "latency_s": draw.uniform(0.02, 0.05),
    }  # fmt: skip
    ring = {
        **shared, "source": "ring", "range_m": sensor.all_round_range_m,
        "rate_hz": draw.choice((12.5, 20.0)), "field_of_view_deg": 360.0,
        "latency_s": draw.uniform(0.02, 0.08),
    }  # fmt: skip
    return Plant.model_validate(
        {
            "realism": "ideal",
            "multirotor": {"thrust_to_weight": 2.0, "radius_m": vehicle.radius_m},
            "start": {"position_ned_m": [0.0, 0.0, -_ALTITUDE_M], "yaw_deg": 0.0},
            "tracking": {
                "toward_obstacle": True,
                "error_m": _USED_OF_TRACKING * vehicle.tracking_error_m,
                "kinematic": True,
                "seen_late_s": SEEN_LATE_S,
            },
            "movers": _movers(draw, length_m, speed_mps),
            "sensors": [front, ring],
        }
    )


def _movers(draw: random.Random, length_m: float, speed_mps: float) -> list[dict[str, Any]]:
    """Draw movers, most of them hostile, none near the start."""
    movers = []
    for number in range(draw.randrange(1, 4)):
        bearing_rad = draw.uniform(-math.pi, math.pi)
        away_m = draw.uniform(6.0, 18.0)
        start = [away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)]
        beside_m = draw.uniform(2.0, 6.0)
        middle = [draw.uniform(6.0, length_m - 4.0), 0.0]
        path = draw.choice(
            (
                {"kind": "hostile", "start_ned_m": start},
                {"kind": "hostile", "start_ned_m": start},
                {"kind": "pursuit", "start_ned_m": start, "lead_s": draw.choice((0.0, 1.0, 2.0))},
                {"kind": "trefoil", "center_ned_m": middle, "radius_m": draw.uniform(3.0, 5.0)},
                {
                    "kind": "waypoints",
                    "places_ned_m": [[middle[0], beside_m], [middle[0], -beside_m]],
                },
            )
        )
        movers.append(
            {
                "id": f"mover{number}",
                "class": "person",
                "size_m": draw.uniform(0.3, 1.0),
                "speed_mps": speed_mps,
                "path": path,
            }
        )
    return movers


def _outcomes(stalls: tuple[Fault, ...]) -> tuple[Outcome, ...]:
    """Return how flights may end: after a second stall in motion it holds (`late_ticks`)."""
    return ("arrived", "aborted", "held") if stalls else ("arrived", "aborted")


def _late_ticks(draw: random.Random) -> tuple[Fault, ...]:
    """Draw short stalls of the service, which the autopilot bridges."""
    if draw.random() < 0.5:
        return ()
    return tuple(
        Fault(kind="tick_stall", start_s=begin_s, duration_s=draw.choice((0.04, 0.08)))
        for begin_s in (draw.uniform(8.0, 20.0), draw.uniform(20.0, 40.0))
    )
