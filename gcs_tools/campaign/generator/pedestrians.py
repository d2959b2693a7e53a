"""Random flights among people: a crowd that crosses, followers, oncomers, and who steps out.

People keep to the declared speed, and the sensors see none of them behind a wall or behind another.
The view ahead is 120 degrees; a ring sees all round, or, for the weaker promise, nothing does.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, Final, Literal

from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.generator.scenarios import ATTEMPTS_MAX
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import start_clear_radius_m
from gcs_tools.scenario import Expectation, Plant, Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField

Level = Literal["passive", "passive_in_view"]

_ALTITUDE_M: Final = 3.0
_VIEW_DEG: Final = 120.0
_TIME_LIMIT_S: Final = 75.0
# A hair less than declared, so that round-off does not exceed it.
_USED: Final = 0.9995
_KIOSK_M: Final = 1.5


def pedestrian_case(draw: random.Random, level: Level = "passive") -> FlightCase:
    """Draw a flight among people.

    Args:
        draw: of everything.
        level: ``passive`` flies with a ring; ``passive_in_view`` with the view ahead alone, where
            no person comes from behind.

    Raises:
        ValueError: no contract can require the level.
    """
    for _ in range(ATTEMPTS_MAX):
        scene = draw.choice([name for name in SCENES if level == "passive" or name != "following"])
        contract = _contract(draw, level, hidden=scene == "door")
        length_m = draw.uniform(18.0, 26.0)
        mission = _mission(contract, length_m)
        if not check(contract, None, mission).may_fly:
            continue
        speed_mps = _USED * contract.environment.movers[0].speed_max_mps
        walls, people = SCENES[scene](draw, length_m)
        for number, person in enumerate(people):
            person |= {"id": f"person{number}", "class": "person", "speed_mps": speed_mps}
        return FlightCase(
            Scenario(
                name="pedestrians",
                contract=contract,
                mission=mission,
                obstacles=ObstacleField.of(walls),
                plant=_plant(contract, people),
                faults=(),
                field_known=False,
                fly_outside_contract=False,
                expect=Expectation.model_validate({}),
            ),
            seed=draw.randrange(2**31),
            variant=scene,
            # Where people are in the way for long, the flight is cut off waiting.
            outcomes=("arrived", "aborted"),
            time_limit_s=_TIME_LIMIT_S,
        )
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no flight among people that may be flown")


def _mission(contract: Contract, length_m: float) -> Mission:
    return Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "heading": "leg",
            "start_clear_m": start_clear_radius_m(assess(contract)),
            "legs": [{"end_ned_m": [length_m, 0.0], "target_half_width_m": 4.0}],
        }
    )


# ------------------------------------------------------------------ the scenes

_Scene = tuple[list[Obstacle], list[dict[str, Any]]]


def _crossing(draw: random.Random, length_m: float) -> _Scene:
    """People go to and fro across the way."""
    people = []
    for _ in range(draw.randrange(3, 7)):
        north_m = draw.uniform(7.0, length_m - 3.0)
        side = draw.choice((-1.0, 1.0))
        near_m, far_m = draw.uniform(1.0, 6.0), draw.uniform(4.0, 12.0)
        places = [
            (north_m, side * near_m),
            (north_m + draw.uniform(-3.0, 3.0), -side * far_m),
            (north_m + draw.uniform(-3.0, 3.0), side * far_m),
        ]
        people.append(_walks(draw, places))
    return [], people


def _following(draw: random.Random, length_m: float) -> _Scene:
    """One or two people come from behind, beside the way, up to the vehicle."""
    del length_m
    people = []
    for _ in range(draw.randrange(1, 3)):
        start = (draw.uniform(-12.0, -6.0), draw.uniform(-3.0, 3.0))
        path = {"kind": "pursuit", "start_ned_m": start, "lead_s": 0.0}
        people.append({"size_m": draw.uniform(0.4, 0.8), "path": path})
    return [], people


def _oncoming(draw: random.Random, length_m: float) -> _Scene:
    """People come along the way, past the start and back."""
    people = []
    for _ in range(draw.randrange(1, 4)):
        aside_m = draw.uniform(-2.0, 2.0)
        far_m = length_m + draw.uniform(0.0, 8.0)
        places = [(far_m, aside_m), (-15.0, aside_m + draw.uniform(-2.0, 2.0))]
        people.append(_walks(draw, places))
    return [], people


def _door(draw: random.Random, length_m: float) -> _Scene:
    """A person steps out from behind a kiosk beside the way when the vehicle is near."""
    north_m, side = draw.uniform(8.0, length_m - 5.0), draw.choice((-1.0, 1.0))
    aside_m = side * draw.uniform(2.0, 3.5)
    kiosk = Obstacle(
        id="kiosk", center_ned_m=(north_m, aside_m), size_m=(_KIOSK_M, _KIOSK_M), yaw_deg=0.0
    )
    beyond_m = north_m + _KIOSK_M / 2.0 + 0.5
    places = [(beyond_m, aside_m), (beyond_m, -side * 8.0), (beyond_m, side * 8.0)]
    person = _walks(draw, places)
    person["path"]["begins_within_m"] = draw.uniform(3.0, 7.0)
    return [kiosk], [person]


SCENES: Final[dict[str, Callable[[random.Random, float], _Scene]]] = {
    "crossing": _crossing,
    "following": _following,
    "oncoming": _oncoming,
    "door": _door,
}


def _walks(draw: random.Random, places: list[tuple[float, float]]) -> dict[str, Any]:
    return {
        "size_m": draw.uniform(0.4, 0.8),
        "path": {"kind": "waypoints", "places_ned_m": places},
    }


# ------------------------------------------------------------------ contract and vehicle


def _contract(draw: random.Random, level: Level, *, hidden: bool) -> Contract:
    """Draw a contract that sees as far as people at this speed require, and a little farther."""
    all_round = level == "passive"
    spare = draw.uniform(1.05, 1.5)
    person = {
        "class": "person", "speed_max_mps": draw.choice((1.2, 1.5)), "size_max_m": 1.0,
        "hidden": hidden,
    }  # fmt: skip
    terms: dict[str, Any] = {
        "vehicle": {
            "roll_max_deg": 15.0, "pitch_max_deg": 15.0, "thrust_to_weight": 2.0,
            "cruise_speed_mps": draw.uniform(1.5, 2.5), "radius_m": 0.3, "tracking_error_m": 0.35,
            "velocity_error_mps": [0.45, 0.5], "reaction_time_s": 0.2, "attitude_lag_s": 0.27,
            "setpoint_loss_timeout_s": 0.5,
            "setpoint_loss": {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8},
            "setpoint_loss_run_time_s": 3.0, "rest_settle_s": 0.8,
        },
        "requirements": {"passive_safety": draw.random() < 0.5, "movers": level},
        "sensor": {
            "detection_range_m": 60.0, "field_of_view_deg": _VIEW_DEG, "frame_age_max_s": 0.3,
            "position_error_m": 0.05, "all_round_range_m": 60.0 if all_round else 0.0,
        },
        "environment": {
            "obstacle_size_max_m": 1.5, "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": 30.0, "movers": [person],
        },
    }  # fmt: skip
    for _ in range(2):  # the error of a face depends on the range
        required = {
            clause.name: clause.required
            for clause in assess(Contract.model_validate(terms)).clauses
        }
        front = ("passive_range.", "passive_silence.", "passive_dead_daemon.", "detection_range",
                 "edge_visibility", "stop", "sensor_silence", "passive_safety")  # fmt: skip
        terms["sensor"]["detection_range_m"] = spare * max(
            value for name, value in required.items() if name.startswith(front)
        )
        if all_round:
            terms["sensor"]["all_round_range_m"] = spare * required["all_round.person"]
    return Contract.model_validate(terms)


def _plant(contract: Contract, people: list[dict[str, Any]]) -> Plant:
    sensor = contract.sensor
    shared = {
        "uncertainty_m": sensor.position_error_m, "message_version": 2, "movers_hidden": True,
        "rate_hz": 20.0,
    }  # fmt: skip
    sensors = [
        {
            **shared, "source": "front", "range_m": sensor.detection_range_m,
            "field_of_view_deg": _VIEW_DEG,
        }
    ]  # fmt: skip
    if sensor.all_round_range_m > 0.0:
        ring = {"range_m": sensor.all_round_range_m, "field_of_view_deg": 360.0}
        sensors.append({**shared, "source": "ring", **ring})
    return Plant.model_validate(
        {
            "realism": "ideal",
            "multirotor": {"thrust_to_weight": 2.0, "radius_m": contract.vehicle.radius_m},
            "start": {"position_ned_m": [0.0, 0.0, -_ALTITUDE_M], "yaw_deg": 0.0},
            "movers": people,
            "sensors": sensors,
        }
    )
