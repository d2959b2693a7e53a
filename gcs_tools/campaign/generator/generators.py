"""The generators of campaigns, by name.

A generator's name, the campaign's seed and a number determine one flight, on every machine.  The
pre-flight check decides whether a nominal field keeps its contract, whatever was drawn.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Final, get_args

from gcs_tools.campaign.generator.airframes import drawn_airframe
from gcs_tools.campaign.generator.ambushes import ambush_case
from gcs_tools.campaign.generator.case import FULL, QUICK, Extent, FlightCase
from gcs_tools.campaign.generator.contracts import compliant_contract, required_range_m
from gcs_tools.campaign.generator.dense_fields import best_effort_scenario
from gcs_tools.campaign.generator.faults import (
    DISPLACING,
    FAULT_KINDS,
    UNDETECTABLE,
    all_tolerated,
    drawn_fault,
    leading_faults,
)
from gcs_tools.campaign.generator.fields import (
    Breach,
    head_on_field,
    ned_m,
    with_breaching_field,
)
from gcs_tools.campaign.generator.movers import mover_case, passed_mover_case
from gcs_tools.campaign.generator.pedestrians import pedestrian_case
from gcs_tools.campaign.generator.scenarios import (
    ATTEMPTS_MAX,
    compliant_scenario,
    flight_scenario,
    straight_mission,
)
from gcs_tools.scenario import Outcome, Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import SensorTerms, VehicleTerms
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.frames import LegFrame
from sitl.virtual.faults.schema import Fault, FaultKind

# What falls short of the contract without being declared, and the share of it that is left: the
# distance of first reports relative to the region's front, and the gain of attitude feedback.
_SHORTFALLS: Final = (
    *(("range", share) for share in (0.9, 0.7, 0.5, 0.3)),
    *(("attitude", share) for share in (0.4, 0.25, 0.1)),
)
_ATTITUDE_GAIN_PER_S: Final = 11.0
# The competition's boxes and the length of a course past them.
_BOX_M: Final = (2.0, 20.0)
_COURSE_M: Final = (90.0, 140.0)
# Without faults every take-off is the same, so this share of flights starts in hover.
_FROM_HOVER_PERCENT: Final = 90
_TURN_MAX_DEG: Final = 20.0


def generated(generator: str, campaign_seed: int, number: int) -> FlightCase:
    """Draw flight ``number`` of a campaign.

    Raises:
        KeyError: the generator does not exist; `GENERATORS` lists them.
    """
    draw = random.Random(f"{generator} {campaign_seed} {number}")
    case = GENERATORS[generator](draw)
    name = f"{generator}-{campaign_seed}-{number}"
    return replace(case, scenario=replace(case.scenario, name=name))


def _nominal(draw: random.Random, extent: Extent = FULL) -> FlightCase:
    return FlightCase(compliant_scenario(draw, extent), _seed(draw))


def _mostly_from_hover(draw: random.Random) -> FlightCase:
    """Start most flights in hover, with the nose near the leg (a simulation shortcut)."""
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


def _violating(draw: random.Random) -> FlightCase:
    """Break one assumption: in the field, unknown to the pre-flight check, or in the contract."""
    breach = draw.choice(get_args(Breach))
    scenario = compliant_scenario(draw, stop=True)
    vehicle, sensor = scenario.contract.vehicle, scenario.contract.sensor
    match breach:
        case "larger" | "closer":
            scenario = with_breaching_field(draw, scenario, breach)
        case "range":
            required_m = required_range_m(assess(scenario.contract))
            terms = {"detection_range_m": required_m * draw.uniform(0.5, 0.98)}
            scenario = _redeclared(scenario, sensor=sensor.model_copy(update=terms))
        case _:
            terms = {"cruise_speed_mps": vehicle.cruise_speed_mps * draw.uniform(1.3, 2.0)}
            scenario = _redeclared(scenario, vehicle=vehicle.model_copy(update=terms))
    # If the start already shows the breach, the service does not depart and the operator lands.
    unforeseen = breach in ("larger", "closer")
    outcomes: tuple[Outcome, ...] = ("arrived", "held", "aborted") if unforeseen else ("aborted",)
    return FlightCase(scenario, _seed(draw), breach, outcomes=outcomes)


def _redeclared(scenario: Scenario, **sections: VehicleTerms | SensorTerms) -> Scenario:
    return replace(scenario, contract=scenario.contract.model_copy(update=sections))


def _faulty(draw: random.Random, extent: Extent = FULL) -> FlightCase:
    """Inject one fault of any kind into a nominal flight, at any time or on a transition."""
    kind: FaultKind = draw.choice(FAULT_KINDS)
    scenario = compliant_scenario(draw, extent, stop=True, passive_safety=True)
    fault = drawn_fault(draw, kind, scenario)
    scenario = replace(scenario, faults=(*leading_faults(draw, fault, scenario), fault))
    return FlightCase(
        scenario,
        _seed(draw),
        kind,
        trigger=f"{fault.phase or 'start'} {fault.entry}",
        # A landing by the operator, which needs no service, is a safe end too.
        outcomes=("arrived",) if all_tolerated(scenario) else ("arrived", "held", "aborted"),
        covered=kind not in UNDETECTABLE | DISPLACING,
    )


def _best_effort(draw: random.Random) -> FlightCase:
    """Fly with best effort through stems that no separation covers; stopping safely is a success.

    Passing is not guaranteed, so that a field without a passage ends in a hold.
    """
    return FlightCase(best_effort_scenario(draw), _seed(draw), outcomes=("arrived", "held"))


def _faulty_best_effort(draw: random.Random) -> FlightCase:
    """Inject one fault of any kind into a flight with best effort."""
    kind: FaultKind = draw.choice(FAULT_KINDS)
    scenario = best_effort_scenario(draw)
    fault = drawn_fault(draw, kind, scenario)
    scenario = replace(scenario, faults=(*leading_faults(draw, fault, scenario), fault))
    return FlightCase(
        scenario,
        _seed(draw),
        kind,
        trigger=f"{fault.phase or 'start'} {fault.entry}",
        outcomes=("arrived", "held", "aborted"),
        covered=kind not in UNDETECTABLE | DISPLACING,
    )


def _outside(draw: random.Random) -> FlightCase:
    """Fly the worst case just outside the contract, which nothing on board can detect.

    The leg leads head-on to an obstacle of size S_max.  Nothing is promised; the outcomes show how
    much of the contract is needed, and how much of it is margin.
    """
    what, share = draw.choice(_SHORTFALLS)
    # The shares of the attitude's gain are those of an ideal vehicle.
    extent = replace(FULL, ideal=True)
    scenario = compliant_scenario(draw, extent, stop=True, passive_safety=False)
    scenario = replace(scenario, obstacles=head_on_field(scenario))
    front_m = assess(scenario.contract).inflated.region.front_m
    fault = Fault.model_validate(
        {"kind": "detections_hidden", "amount": share * front_m}
        if what == "range"
        else {"kind": "attitude_slow", "phase": "cruise", "amount": share * _ATTITUDE_GAIN_PER_S}
    )
    return FlightCase(
        replace(scenario, faults=(fault,)),
        _seed(draw),
        f"{what} x {share:g}",
        outcomes=("arrived", "held", "aborted", "collided"),
        covered=False,
    )


def _competition(draw: random.Random) -> FlightCase:
    """Draw a field by the rules of the UAV Testing Competition, regardless of any contract.

    One to three boxes of 2 to 20 m by 2 to 20 m at any rotation, near the vehicle's path.  The
    contract is drawn for the largest of them; the pre-flight check decides whether it is flown.
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
            center_ned_m=ned_m(
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
    extent = replace(FULL, length_m=(length_m, length_m))
    return field_case(draw, ObstacleField.of(placed), heading_rad, extent, size_m * 1.001)


def field_case(
    draw: random.Random,
    obstacles: ObstacleField,
    heading_rad: float,
    extent: Extent,
    size_max_m: float,
) -> FlightCase:
    """Draw contract, mission and plant for a given field, which the pre-flight check may refuse.

    Args:
        draw: the flight's random numbers.
        obstacles: the field; the leg starts at its origin.
        heading_rad: direction of the leg.
        extent: of the flight.
        size_max_m: largest obstacle that the contract declares.

    Raises:
        AssertionError: `ATTEMPTS_MAX` draws were all refused, which is a defect of the generator.
    """
    for _ in range(ATTEMPTS_MAX):
        # Errors of the field leave no contract for the largest obstacles: draw that again, too.
        airframe = drawn_airframe(draw, extent)
        contract = compliant_contract(
            draw, extent, airframe, stop=True, passive_safety=False, size_max_m=size_max_m
        )
        if contract is not None:
            break
    else:
        raise AssertionError(f"{ATTEMPTS_MAX} draws gave no compliant contract")
    mission = straight_mission(draw, contract, heading_rad, extent.length_m[0])
    scenario = flight_scenario(draw, contract, airframe, mission, obstacles, extent)
    return FlightCase(scenario, _seed(draw), refusable=True)


def _seed(draw: random.Random) -> int:
    return draw.randrange(2**31)


GENERATORS: Final[dict[str, Callable[[random.Random], FlightCase]]] = {
    "nominal": _mostly_from_hover,
    "violating": _violating,
    "faults": _faulty,
    "outside": _outside,
    "competition": _competition,
    "best-effort": _best_effort,
    "best-effort-faults": _faulty_best_effort,
    "movers": mover_case,
    "pedestrians": pedestrian_case,
    "ambush": ambush_case,
    "faster-movers": lambda draw: mover_case(draw, faster=True),
    "passed-movers": passed_mover_case,
    "quick": lambda draw: _nominal(draw, QUICK),
    "quick-faults": lambda draw: _faulty(draw, QUICK),
}
