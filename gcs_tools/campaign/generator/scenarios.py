"""Random scenarios: fields that keep a random contract, that break it, and faults on top.

One name, one campaign seed and one number give one scenario, on every machine.  What is drawn is
stated in the functions below; whatever the draw, the pre-flight check has the last word on whether
a nominal field keeps its contract.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, get_args

import numpy as np

from gcs_tools.preflight.command import check
from gcs_tools.scenario import Expectation, Outcome, Plant, Scenario
from onboard.contract.assessment import Assessment, assess
from onboard.files.models import Contract, Mission, SensorTerms, VehicleTerms
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.frames import LegFrame
from onboard.perception.intake import POSE_TIMING_S
from sitl.virtual.faults.schedule import Fault, FaultKind

Breach = Literal["larger", "closer", "range", "speed"]

NO_FAULT: Final = "none"
# Drawn again until the contract complies and the field keeps it; in vain is a programming error.
ATTEMPTS_MAX: Final = 4000
# Declared far more than any contract here requires, to learn what it does require.
_AMPLE_M: Final = 1000.0
_AMPLE_DEG: Final = 359.0
_ALTITUDE_M: Final = 3.0
# What falls short of the contract, undeclared, and how much of it is left: the distance at which an
# obstacle is first reported, against that at which avoidance has to begin, and attitude feedback.
_SHORTFALLS: Final = (
    *(("range", share) for share in (0.9, 0.7, 0.5, 0.3)),
    *(("attitude", share) for share in (0.4, 0.25, 0.1)),
)
_ATTITUDE_GAIN_PER_S: Final = 11.0
# The competition's boxes, and a course past them.
_BOX_M: Final = (2.0, 20.0)
_COURSE_M: Final = (90.0, 140.0)


@dataclass(frozen=True)
class Extent:
    """How long flights are: legs, speeds, and whether they begin in the air."""

    length_m: tuple[float, float]
    speed_mps: tuple[float, float]
    airborne: bool


# Legs of about 45 m, and long enough for two obstacles where the separation is wide.
_FULL: Final = Extent((38.0, 52.0), (1.2, 5.0), airborne=False)
# A third of the time: one obstacle, faster, no take-off (simulation shortcut: starts in hover).
_QUICK: Final = Extent((16.0, 20.0), (3.0, 5.5), airborne=True)
# Where nothing goes wrong every take-off is the same: so many of a hundred flights do without.
_FROM_HOVER_PERCENT: Final = 90
_TURN_MAX_DEG: Final = 20.0

# Seconds of latency and confirmation that the simulated sensor needs lie within this.
_REACTION_TIME_S: Final = (0.15, 0.25)
# So many flights are flown by ArduPilot as it is in the field; its tilt overshoots by 1.4.
_FIELD_SHARE: Final = 0.5
_FIELD_TILT_MAX_DEG: Final = 15.0
_TUNED: Final = {"PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0}
# So many of the others use their tracking error to this share, toward the nearest obstacle.
_PINNED_SHARE: Final = 0.2
_PINNED_ERROR_SHARE: Final = 0.8

_MEAN_WIND_MAX_MPS: Final = 3.0
_TURBULENCE_MAX_MPS: Final = 0.3


@dataclass(frozen=True)
class Case:
    """One flight of a campaign, and what it may come to.

    Attributes:
        scenario: what is flown.
        seed: of the simulation.
        variant: the breach or the kind of fault; `NO_FAULT` for neither.
        trigger: when the fault begins, in words.
        outcomes: what the flight may come to.
        covered: whether the contract promises that nothing is hit.
        expectation: hold the flight to what its scenario file expects, too.
        refusable: the field was not made to keep the contract: the pre-flight check may refuse it.
    """

    scenario: Scenario
    seed: int
    variant: str = NO_FAULT
    trigger: str = ""
    outcomes: tuple[Outcome, ...] = ("arrived",)
    covered: bool = True
    expectation: bool = False
    refusable: bool = False


def generated(generator: str, campaign_seed: int, number: int) -> Case:
    """Return flight ``number`` of a campaign.

    Raises:
        KeyError: there is no such generator; `GENERATORS` lists them.
    """
    draw = random.Random(f"{generator} {campaign_seed} {number}")
    case = GENERATORS[generator](draw)
    name = f"{generator}-{campaign_seed}-{number}"
    return replace(case, scenario=replace(case.scenario, name=name))


# ------------------------------------------------------------------ generators


def _nominal(draw: random.Random, extent: Extent = _FULL) -> Case:
    return Case(_compliant_scenario(draw, extent), _seed(draw))


def _mostly_from_hover(draw: random.Random) -> Case:
    """Leave take-off and most of the first turn out of most flights (simulation shortcut)."""
    case = _nominal(draw)
    if draw.randrange(100) >= _FROM_HOVER_PERCENT:
        return case
    scenario = case.scenario
    position_ned_m = (*scenario.mission.start_ned_m, -scenario.mission.altitude_m)
    leg = LegFrame.between(position_ned_m, (*scenario.mission.legs[0].end_ned_m, 0.0))
    yaw_deg = math.degrees(leg.heading_rad) + draw.uniform(-_TURN_MAX_DEG, _TURN_MAX_DEG)
    start = scenario.plant.start.model_copy(
        update={"position_ned_m": position_ned_m, "yaw_deg": yaw_deg}
    )
    plant = scenario.plant.model_copy(update={"start": start})
    return replace(case, scenario=replace(scenario, plant=plant))


def _violating(draw: random.Random) -> Case:
    """Break one clause that the pre-flight check cannot know of, or declares itself."""
    breach = draw.choice(get_args(Breach))
    scenario = _compliant_scenario(draw, stop=True)
    vehicle, sensor = scenario.contract.vehicle, scenario.contract.sensor
    match breach:
        case "larger" | "closer":
            scenario = _with_breaching_field(draw, scenario, breach)
        case "range":
            required_m = _required_range_m(assess(scenario.contract))
            terms = {"detection_range_m": required_m * draw.uniform(0.5, 0.98)}
            scenario = _redeclared(scenario, sensor=sensor.model_copy(update=terms))
        case _:
            terms = {"cruise_speed_mps": vehicle.cruise_speed_mps * draw.uniform(1.3, 2.0)}
            scenario = _redeclared(scenario, vehicle=vehicle.model_copy(update=terms))
    # What is seen from the start keeps the service from departing, and the operator lands.
    unforeseen = breach in ("larger", "closer")
    outcomes: tuple[Outcome, ...] = ("arrived", "held", "aborted") if unforeseen else ("aborted",)
    return Case(scenario, _seed(draw), breach, outcomes=outcomes)


def _redeclared(scenario: Scenario, **sections: VehicleTerms | SensorTerms) -> Scenario:
    return replace(scenario, contract=scenario.contract.model_copy(update=sections))


def _faulty(draw: random.Random, extent: Extent = _FULL) -> Case:
    """One fault of any kind on a nominal flight, at any time or on a transition."""
    kind: FaultKind = draw.choice(FAULT_KINDS)
    scenario = _compliant_scenario(draw, extent, stop=True, passive_safety=True)
    fault = _drawn_fault(draw, kind, scenario)
    scenario = replace(scenario, faults=(*_leading_to(draw, fault), fault))
    return Case(
        scenario,
        _seed(draw),
        kind,
        trigger=f"{fault.phase or 'start'} {fault.entry}",
        # Landed by the operator, who need not have the service for it, is a safe end too.
        outcomes=("arrived",) if _is_tolerated(scenario) else ("arrived", "held", "aborted"),
        covered=kind not in UNDETECTABLE | DISPLACING,
    )


def _outside(draw: random.Random) -> Case:
    """The worst case just outside the contract, which nothing on board can know of.

    Head-on at an obstacle that fills S_max, and nothing is promised: what the flight comes to says
    how much of the contract is needed, and how much is margin.
    """
    what, share = draw.choice(_SHORTFALLS)
    scenario = _compliant_scenario(draw, stop=True, passive_safety=False)
    scenario = replace(scenario, obstacles=_head_on(scenario))
    front_m = assess(scenario.contract).inflated.region.front_m
    fault = Fault.model_validate(
        {"kind": "detections_hidden", "amount": share * front_m}
        if what == "range"
        else {"kind": "attitude_slow", "phase": "cruise", "amount": share * _ATTITUDE_GAIN_PER_S}
    )
    return Case(
        replace(scenario, faults=(fault,)),
        _seed(draw),
        f"{what} x {share:g}",
        outcomes=("arrived", "held", "aborted", "collided"),
        covered=False,
    )


def _head_on(scenario: Scenario) -> ObstacleField:
    """Return the first obstacle only, square to the leg, in its middle, and as large as may be."""
    end_north_m, end_east_m = scenario.mission.legs[0].end_ned_m
    heading_rad = math.atan2(end_east_m, end_north_m)
    north_m, east_m = scenario.obstacles.center_ned_m[0]
    along_m = north_m * math.cos(heading_rad) + east_m * math.sin(heading_rad)
    size_m = scenario.contract.environment.obstacle_size_max_m
    return ObstacleField.of(
        [
            Obstacle(
                id="0",
                center_ned_m=_ned_m(heading_rad, along_m, 0.0),
                size_m=(size_m, size_m),
                yaw_deg=math.degrees(heading_rad),
            )
        ]
    )


def _competition(draw: random.Random) -> Case:
    """Fields by the rules of the UAV Testing Competition, whatever contract would suit them.

    One to three boxes of 2 to 20 m by 2 to 20 m at any rotation, on the way of the vehicle.  The
    contract is made for the largest of them; the pre-flight check decides whether it is flown.
    """
    boxes = [
        (draw.uniform(*_BOX_M), draw.uniform(*_BOX_M), draw.uniform(0.0, math.pi))
        for _ in range(draw.randint(1, 3))
    ]
    heading_rad = draw.uniform(-math.pi, math.pi)
    length_m = draw.uniform(*_COURSE_M)
    placed = [
        Obstacle(
            id=str(number),
            center_ned_m=_ned_m(
                heading_rad, draw.uniform(0.25, 0.75) * length_m, draw.uniform(-8.0, 8.0)
            ),
            size_m=(length, width),
            yaw_deg=math.degrees(heading_rad + turn_rad),
        )
        for number, (length, width, turn_rad) in enumerate(boxes)
    ]
    size_m = max(
        max(
            length * abs(math.cos(turn)) + width * abs(math.sin(turn)),
            length * abs(math.sin(turn)) + width * abs(math.cos(turn)),
        )
        for length, width, turn in boxes
    )
    extent = replace(_FULL, length_m=(length_m, length_m))
    return field_case(draw, ObstacleField.of(placed), heading_rad, extent, size_m * 1.001)


def field_case(
    draw: random.Random,
    obstacles: ObstacleField,
    heading_rad: float,
    extent: Extent,
    size_max_m: float,
) -> Case:
    """Return a flight through a field that nobody made for us; the check may refuse it."""
    for _ in range(ATTEMPTS_MAX):
        contract = _compliant_contract(
            draw, extent, stop=True, passive_safety=False, size_max_m=size_max_m
        )
        if contract is not None:
            break
    else:
        raise AssertionError(f"{ATTEMPTS_MAX} draws gave no compliant contract")
    mission = _mission(draw, contract, heading_rad, extent.length_m[0])
    scenario = _flight(draw, contract, mission, obstacles, extent)
    return Case(scenario, _seed(draw), refusable=True)


GENERATORS: Final[dict[str, Callable[[random.Random], Case]]] = {
    "nominal": _mostly_from_hover,
    "violating": _violating,
    "faults": _faulty,
    "outside": _outside,
    "competition": _competition,
    "quick": lambda draw: _nominal(draw, _QUICK),
    "quick-faults": lambda draw: _faulty(draw, _QUICK),
}

FAULT_KINDS: Final[tuple[FaultKind, ...]] = get_args(FaultKind)
# A sensor that claims to have looked, and is wrong beyond its declared error, cannot be found out
# by anybody who has no other: nothing is promised, and what happens is counted.  Boxes said to be
# in the wrong frame are such a claim; that they move with the vehicle is not looked for.
UNDETECTABLE: Final[frozenset[FaultKind]] = frozenset(
    {"detections_hidden", "detections_wrong_frame"}
)
# These move the vehicle where the service does not want it, and no computer on board can prevent
# it: physics, or somebody else's setpoints.  A collision is excused only after the alarm.
DISPLACING: Final[frozenset[FaultKind]] = frozenset(
    {
        "gust",
        "thrust_lost",
        "attitude_slow",
        "parameter_changed",
        "motor_failed",
        "second_commander",
    }
)
# What the contract does not even mention, or covers: the mission has to be flown to its end.
TOLERATED: Final[frozenset[FaultKind]] = frozenset(
    {"detections_shifted", "link_duplicating", "solver_limited", "disk_full"}
)


def _is_tolerated(scenario: Scenario) -> bool:
    return all(fault.kind in TOLERATED for fault in scenario.faults)


def _seed(draw: random.Random) -> int:
    return draw.randrange(2**31)


# ------------------------------------------------------------------ a contract that complies


def _compliant_scenario(
    draw: random.Random,
    extent: Extent = _FULL,
    *,
    stop: bool | None = None,
    passive_safety: bool | None = None,
) -> Scenario:
    """Draw until the pre-flight check says that the flight is covered."""
    for _ in range(ATTEMPTS_MAX):
        contract = _compliant_contract(
            draw,
            extent,
            stop=draw.random() < 0.7 if stop is None else stop,
            passive_safety=draw.random() < 0.5 if passive_safety is None else passive_safety,
        )
        if contract is None:
            continue
        scenario = _scenario(draw, contract, extent)
        if scenario is not None:
            return scenario
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no compliant scenario")


def _compliant_contract(
    draw: random.Random,
    extent: Extent,
    *,
    stop: bool,
    passive_safety: bool,
    size_max_m: float | None = None,
) -> Contract | None:
    """Draw speed, agility and sizes; declare what they require, and a little more."""
    field = draw.random() < _FIELD_SHARE
    terms: dict[str, dict[str, Any]] = {
        "vehicle": {
            "roll_max_deg": draw.uniform(8.0, 22.0),
            "pitch_max_deg": draw.uniform(8.0, 22.0),
            "thrust_to_weight": 2.0,
            "cruise_speed_mps": draw.uniform(*extent.speed_mps),
            "radius_m": draw.uniform(0.2, 0.5),
            "tracking_error_m": draw.uniform(0.2, 0.35),
            "velocity_error_mps": [0.25, 0.15],
            "reaction_time_s": draw.uniform(*_REACTION_TIME_S),
            "attitude_lag_s": draw.uniform(0.15, 0.2),
            "setpoint_loss_timeout_s": 0.5,
            "recentring_speed_mps": draw.choice((0.0, 0.0, draw.uniform(0.1, 0.4))),
            **(_field_terms(draw) if field else {}),
        },
        "requirements": {"stop": stop, "passive_safety": passive_safety},
        "sensor": {
            "detection_range_m": _AMPLE_M,
            "field_of_view_deg": _AMPLE_DEG,
            "frame_age_max_s": 0.3,
            "position_error_m": draw.uniform(0.02, 0.08),
        },
        "environment": {
            "obstacle_size_max_m": draw.uniform(0.5, 5.0) if size_max_m is None else size_max_m,
            "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": _AMPLE_M,
        },
    }
    ample = assess(Contract.model_validate(terms))
    required = {clause.name: clause.required for clause in ample.clauses}
    terms["sensor"]["detection_range_m"] = _required_range_m(ample) * draw.uniform(1.01, 1.5)
    terms["sensor"]["field_of_view_deg"] = min(
        _AMPLE_DEG, max(60.0, required["field_of_view"] * draw.uniform(1.01, 1.4))
    )
    terms["environment"]["obstacle_separation_min_m"] = required["separation"] * 1.001
    contract = Contract.model_validate(terms)
    # Room for one obstacle at the least, on a leg of the length drawn here.
    region = ample.inflated.region
    roomy = region.front_m + ample.inflated.roi_length_m < extent.length_m[0]
    return contract if roomy and assess(contract).compliant else None


def _field_terms(draw: random.Random) -> dict[str, Any]:
    """What a tuned ArduPilot vehicle declares where it flies as in the field."""
    return {
        "roll_max_deg": draw.uniform(8.0, _FIELD_TILT_MAX_DEG),
        "pitch_max_deg": draw.uniform(8.0, _FIELD_TILT_MAX_DEG),
        "tracking_error_m": draw.uniform(0.35, 0.5),
        "velocity_error_mps": [0.55, 0.6],
        "attitude_lag_s": draw.uniform(0.25, 0.3),
        "heading_error_deg": 1.2,
    }


def _is_field(contract: Contract) -> bool:
    return contract.vehicle.heading_error_deg > 0.0


def _required_range_m(assessment: Assessment) -> float:
    return max(
        clause.required
        for clause in assessment.clauses
        if clause.declared == assessment.terms.detection_range_m
    )


# ------------------------------------------------------------------ a field, a mission, a plant


def _scenario(draw: random.Random, contract: Contract, extent: Extent) -> Scenario | None:
    """Place obstacles along a leg in a random direction; None where the check refuses."""
    heading_rad = draw.uniform(-math.pi, math.pi)
    length_m = draw.uniform(*extent.length_m)
    obstacles = _obstacles(draw, contract, heading_rad, length_m)
    mission = _mission(draw, contract, heading_rad, length_m)
    if not obstacles or not check(contract, obstacles, mission).compliant:
        return None
    return _flight(draw, contract, mission, obstacles, extent)


def _mission(
    draw: random.Random, contract: Contract, heading_rad: float, length_m: float
) -> Mission:
    size_m, derived = contract.environment.obstacle_size_max_m, assess(contract).inflated
    return Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "climb_max_m": draw.choice((0.0, 0.0, draw.uniform(0.5, 1.5))),
            "legs": [
                {
                    "end_ned_m": _ned_m(heading_rad, length_m, 0.0),
                    "target_half_width_m": 2.0 * size_m + derived.roi_width_m + 2.0,
                }
            ],
        }
    )


def _flight(
    draw: random.Random,
    contract: Contract,
    mission: Mission,
    obstacles: ObstacleField,
    extent: Extent,
) -> Scenario:
    return Scenario(
        name="",
        contract=contract,
        mission=mission,
        obstacles=obstacles,
        plant=_plant(draw, contract, -mission.altitude_m if extent.airborne else 0.0),
        faults=(),
        field_known=True,
        fly_outside_contract=False,
        expect=Expectation.model_validate({}),
    )


def _obstacles(
    draw: random.Random, contract: Contract, heading_rad: float, length_m: float
) -> ObstacleField:
    """Obstacles one after another, each as near to the one before as the contract allows."""
    derived = assess(contract).inflated
    separation_m = contract.environment.obstacle_separation_min_m
    half_m = contract.environment.obstacle_size_max_m / 2.0
    along_m = derived.region.front_m + half_m + derived.margin_m + draw.uniform(0.5, 4.0)
    last_m = length_m - (derived.roi_length_m - derived.region.front_m) - 0.5
    placed: list[Obstacle] = []
    while along_m < last_m:
        # Head-on half of the time; else anywhere up to just beside the vehicle's way.
        reach_m = draw.choice((0.2, 1.0)) * (half_m + derived.margin_m)
        centre_m = (along_m, draw.uniform(-reach_m, reach_m))
        placed.append(_obstacle(draw, contract, heading_rad, centre_m, str(len(placed))))
        along_m += separation_m * draw.choice((1.05, draw.uniform(1.05, 1.6)))
    return ObstacleField.of(placed)


def _obstacle(
    draw: random.Random,
    contract: Contract,
    heading_rad: float,
    centre_leg_m: tuple[float, float],
    name: str,
) -> Obstacle:
    """Return a box that fills S_max in the leg frame in a third of all cases, turned or not."""
    turn_rad = draw.choice((0.0, draw.uniform(0.0, math.pi / 2.0)))
    aspect = draw.uniform(0.2, 1.0)
    sides = draw.choice(((1.0, aspect), (aspect, 1.0), (1.0, 1.0)))
    cosine, sine = abs(math.cos(turn_rad)), abs(math.sin(turn_rad))
    extent = max(cosine * sides[0] + sine * sides[1], sine * sides[0] + cosine * sides[1])
    size_max_m = contract.environment.obstacle_size_max_m
    size_m = size_max_m * draw.choice((1.0, draw.uniform(0.1, 1.0), draw.uniform(0.5, 1.0)))
    scale_m = size_m / extent
    return Obstacle(
        id=name,
        center_ned_m=_ned_m(heading_rad, *centre_leg_m),
        size_m=(sides[0] * scale_m, sides[1] * scale_m),
        yaw_deg=math.degrees(heading_rad + turn_rad),
    )


def _ned_m(heading_rad: float, along_m: float, across_m: float) -> tuple[float, float]:
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    return cosine * along_m - sine * across_m, sine * along_m + cosine * across_m


def _plant(draw: random.Random, contract: Contract, down_m: float) -> Plant:
    """Return a vehicle and a sensor that are as good as the contract says, and some wind."""
    direction_rad = draw.uniform(-math.pi, math.pi)
    wind_mps = draw.choice((0.0, draw.uniform(0.0, _MEAN_WIND_MAX_MPS)))
    turbulence_mps = draw.choice((0.0, draw.uniform(0.0, _TURBULENCE_MAX_MPS)))
    noise_share, frame = draw.random(), draw.choice(("local_ned", "body_frd"))
    kind = _field_plant() if _is_field(contract) else _ideal_plant(draw, contract)
    if _is_field(contract):
        frame = "body_frd"  # where the daemon allows for the heading's error
    noise_m = noise_share * _noise_max_m(contract, frame)
    face_noise_m = draw.random() * (_noise_max_m(contract, frame) - noise_m)
    return Plant.model_validate(
        {
            **kind,
            "multirotor": {
                "thrust_to_weight": contract.vehicle.thrust_to_weight,
                "radius_m": contract.vehicle.radius_m,
            },
            "start": {"position_ned_m": [0.0, 0.0, down_m]},
            "wind": {
                "mean_ned_mps": [*_ned_m(direction_rad, wind_mps, 0.0), 0.0],
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


def _field_plant() -> dict[str, Any]:
    return {"realism": "field", "flavour": "ardupilot", "parameters": _TUNED}


def _ideal_plant(draw: random.Random, contract: Contract) -> dict[str, Any]:
    error_m = _PINNED_ERROR_SHARE * contract.vehicle.tracking_error_m
    pinned = {"toward_obstacle": draw.random() < _PINNED_SHARE, "error_m": error_m}
    return {"realism": "ideal", "tracking": pinned}


def _noise_max_m(contract: Contract, frame: str) -> float:
    """Return how wrong either coordinate of a centre may be within the contract's position error.

    Uniform in a square, it adds up along the leg.  What the body sees is placed with a pose whose
    time is as exact as telemetry, and a vehicle at speed has moved on by then.
    """
    vehicle, error_m = contract.vehicle, contract.sensor.position_error_m
    if frame == "body_frd":
        error_m -= (vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0]) * POSE_TIMING_S
    return max(error_m, 0.0) * math.sqrt(0.5)


# ------------------------------------------------------------------ what breaks the contract


def _with_breaching_field(draw: random.Random, scenario: Scenario, breach: Breach) -> Scenario:
    """Make the first obstacle too large, or put a neighbour where its region is.

    Either way the vehicle still starts where it should: beyond the obstacle, or away from it.
    """
    field = scenario.obstacles
    size_max_m = scenario.contract.environment.obstacle_size_max_m
    if breach == "larger":
        # Turned or not, no box with such sides fits into S_max.
        side_m = size_max_m * draw.uniform(1.2, 3.0)
        half_size_m, center_ned_m = field.half_size_m.copy(), field.center_ned_m.copy()
        half_size_m[0] = side_m / 2.0
        center_ned_m[0] *= 1.0 + side_m / math.hypot(*center_ned_m[0])
        field = replace(field, half_size_m=half_size_m, center_ned_m=center_ned_m)
    else:
        apart_m = draw.uniform(0.3, 0.7) * scenario.contract.environment.obstacle_separation_min_m
        north_m, east_m = field.center_ned_m[0].tolist()
        end_north_m, end_east_m = scenario.mission.legs[0].end_ned_m
        turn_rad = draw.uniform(-math.pi / 3.0, math.pi / 3.0)
        beside_m = _ned_m(math.atan2(end_east_m, end_north_m) + turn_rad, apart_m, 0.0)
        neighbour = ObstacleField.of(
            [
                Obstacle(
                    id="neighbour",
                    center_ned_m=(north_m + beside_m[0], east_m + beside_m[1]),
                    size_m=(size_max_m / 2.0, size_max_m / 2.0),
                )
            ]
        )
        field = ObstacleField(
            (*field.ids, *neighbour.ids),
            np.vstack((field.center_ned_m, neighbour.center_ned_m)),
            np.vstack((field.half_size_m, neighbour.half_size_m)),
            np.append(field.yaw_rad, neighbour.yaw_rad),
        )
    return replace(scenario, obstacles=field, field_known=False)


# ------------------------------------------------------------------ faults

# Amounts that are drawn, in the units of `sitl.virtual.faults.schedule.AMOUNTS`; other kinds have
# none, or one that depends on the contract.
_AMOUNT_RANGES: Final[dict[str, tuple[float, float]]] = {
    "detections_late": (0.05, 0.5),
    "detections_intermittent": (0.1, 0.9),
    "detections_slow": (2.0, 8.0),
    "detections_narrow_view": (20.0, 120.0),
    "detections_uncertain": (0.03, 0.3),
    "detections_oversized": (1.2, 4.0),
    "detections_ghost": (3.0, 15.0),
    "detections_out_of_order": (0.1, 0.9),
    "sensor_clock_ahead": (0.2, 10.0),
    "sensor_clock_skewed": (0.005, 0.2),
    "link_lossy": (0.05, 0.6),
    "link_duplicating": (0.05, 0.9),
    "link_reordering": (0.05, 0.6),
    "link_corrupting": (0.05, 0.4),
    "parameter_changed": (20.0, 30.0),
    "gust": (2.0, 9.0),
    "thrust_lost": (0.78, 0.95),
    "attitude_slow": (1.0, 8.0),
    "telemetry_corrupted": (0.05, 0.4),
    "position_reset": (0.6, 5.0),
    "height_reset": (1.0, 5.0),
    "mission_changed": (-90.0, 90.0),
}
_UNITS: Final = (0.001, 0.01, 0.3048)  # millimetres, centimetres, feet, taken for metres
# These end by themselves: a stall or a pilot that never ends leaves nothing to observe.
_PASSING_S: Final[dict[str, tuple[float, float]]] = {
    "tick_stall": (0.04, 1.0),
    "operator_takes_over": (1.0, 4.0),
}
_DURATION_S: Final = (0.2, 4.0)
# Every transition of the automaton, by the phase that it leads into and how often before.
_TRANSITIONS: Final = (
    ("cruise", 1),
    ("avoid", 1),
    ("cruise", 2),
    ("arrived", 1),
    ("hold", 1),
    ("standby", 2),
)


def _drawn_fault(draw: random.Random, kind: FaultKind, scenario: Scenario) -> Fault:
    """Return a fault that begins at any time, some time into a phase, or on its transition."""
    phase, entry = draw.choice(_TRANSITIONS)
    when = draw.choice(
        (
            {"start_s": draw.uniform(0.0, 30.0)},
            {"phase": phase, "entry": entry},
            {"phase": phase, "entry": entry, "start_s": draw.uniform(0.0, 4.0)},
        )
    )
    passing_s = draw.uniform(*_PASSING_S.get(kind, _DURATION_S))
    duration_s = passing_s if kind in _PASSING_S else draw.choice((None, passing_s))
    amount = _drawn_amount(draw, kind, scenario)
    return Fault.model_validate({"kind": kind, "duration_s": duration_s, "amount": amount, **when})


def _leading_to(draw: random.Random, fault: Fault) -> tuple[Fault, ...]:
    """Return what brings the service into a phase that no nominal flight comes to."""
    at = {"phase": draw.choice(("cruise", "avoid")), "start_s": draw.uniform(0.5, 3.0)}
    match fault.phase:
        case "hold":
            leading = {"kind": "detections_off", "duration_s": None, **at}
        case "standby":
            leading = {"kind": "operator_takes_over", "duration_s": 2.0, **at}
        case _:
            return ()
    # Of two faults of one kind only one is present.
    return () if leading["kind"] == fault.kind else (Fault.model_validate(leading),)


def _drawn_amount(draw: random.Random, kind: FaultKind, scenario: Scenario) -> float | None:
    sensor = scenario.contract.sensor
    match kind:
        case "detections_short_range" | "detections_hidden":
            return sensor.detection_range_m * draw.uniform(0.3, 1.0)
        case "detections_shifted":
            # Undeclared, but together with the noise still within the contract's position error.
            (each,) = scenario.plant.sensors
            free_m = _noise_max_m(scenario.contract, each.frame) - each.noise_m
            return draw.random() * free_m * math.sqrt(2.0)
        case "detections_wrong_units":
            return draw.choice(_UNITS)
        case _ if kind in _AMOUNT_RANGES:
            return draw.uniform(*_AMOUNT_RANGES[kind])
        case _:
            return None
