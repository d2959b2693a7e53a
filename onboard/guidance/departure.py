"""The reasons for not leaving STANDBY although control is granted, and how often to report them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Final

from onboard.contract.heights import HeightBand, half_band_m
from onboard.contract.movers import start_clear_of_movers_m
from onboard.events import Event, EventName, RefusalReason, Severity
from onboard.geometry.box import Box
from onboard.guidance.envelope import at_rest_speed_mps
from onboard.guidance.phases import FlightState
from onboard.guidance.situation import Situation
from onboard.monitoring.resumption import FailureTimes, resume_objections
from onboard.vehicle_state import Pose

# A change in the kinds of refusals is reported, but not more often than this.
REFUSAL_PERIOD_S: Final = 5.0
# How near the vehicle must hover to the start of the mission.
START_TOLERANCE_M: Final = 1.5
# A reference slower than this has come to rest, but for round-off.
STOPPED_MPS: Final = 0.01


@unique
class RefusalKind(StrEnum):
    """What keeps the service in STANDBY, or in HOLD."""

    HOLDING = "holding"
    NOT_HOLDING = "not_holding"
    FAILED = "failed"
    MISSION_CHANGED = "mission_changed"
    CONTRACT = "contract"
    PREFLIGHT = "preflight"
    DETECTIONS = "detections"
    CONTRADICTION = "contradiction"
    TELEMETRY = "telemetry"
    POSITION = "position"
    WIND = "wind"
    FLIGHT_TIME = "flight_time"
    BEFORE_LEG = "before_leg"
    LEG_FLOWN = "leg_flown"
    BESIDE_LEG = "beside_leg"
    OFF_HEIGHT = "off_height"
    MOVING = "moving"
    INSIDE_REGION = "inside_region"
    ENVIRONMENT = "environment"
    NO_WAY_BACK = "no_way_back"
    ENERGY = "energy"
    GEOFENCE = "geofence"
    OTHER_DAEMON = "other_daemon"
    START_WORD = "start_word"
    MISSION = "mission"
    LEFT_FLIGHT = "left_flight"
    FLEET = "fleet"
    NO_PROGRESS = "no_progress"
    PROGRESS_VOID = "progress_void"


@dataclass(frozen=True)
class Refusal:
    """One reason for not leaving STANDBY, or HOLD.

    Attributes:
        kind: the reason, for machines.
        text: the reason, for people, with numbers that may change from tick to tick.
        subject: what the reason is about, such as an obstacle's id.
    """

    kind: RefusalKind
    text: str
    subject: str = ""


def departure_refusals(situation: Situation, pose: Pose) -> list[Refusal]:
    """Return why the leg may not be started or resumed from a pose; empty if it may."""
    if situation.mission_doubt is not None:  # where to depart to is not known
        return [Refusal(RefusalKind.MISSION, situation.mission_doubt)]
    x_m, y_m, _ = situation.leg.position_leg(pose.position_ned_m)
    refusals = [
        Refusal(kind, text) for kind, passed, text in _checks(situation, pose) if not passed
    ]
    if situation.left_flight is not None:
        refusals.append(Refusal(RefusalKind.LEFT_FLIGHT, situation.left_flight))
    if situation.fleet_objection is not None:
        refusals.append(Refusal(RefusalKind.FLEET, situation.fleet_objection))
    if (objection := situation.fence_objection(situation.route.mission)) is not None:
        refusals.append(Refusal(RefusalKind.GEOFENCE, objection))
    if situation.best_effort:  # no region matters where only the space seen free is flown into
        return refusals
    refusals += [
        Refusal(
            RefusalKind.INSIDE_REGION,
            f"inside the region of influence of obstacle {obstacle.id}",
            obstacle.id,
        )
        for obstacle in situation.obstacles.between(x_m, x_m)
        if obstacle.region.lane_left_m <= y_m <= obstacle.region.lane_right_m
    ]
    return refusals


def _checks(situation: Situation, pose: Pose) -> Iterator[tuple[RefusalKind, bool, str]]:
    """Yield each check of a pose: its kind, whether it passes, and the refusal if it does not."""
    x_m, y_m, z_m = situation.leg.position_leg(pose.position_ned_m)
    limit_m = START_TOLERANCE_M
    text = f"{-x_m:.1f} m before the start of the leg (limit {limit_m:g} m)"
    yield RefusalKind.BEFORE_LEG, x_m >= -limit_m, text
    before_end = x_m < situation.route.length_m - limit_m
    yield RefusalKind.LEG_FLOWN, before_end, "the leg is already flown"
    leg = situation.route.leg
    # What was threaded may rest as far beside the leg as it may be flown there.
    threaded = situation.best_effort and situation.state is not FlightState.STANDBY
    beside_max_m = leg.threading_half_width_m if threaded else leg.target_half_width_m
    text = f"{abs(y_m):.1f} m beside the leg (limit {beside_max_m:g} m)"
    yield RefusalKind.BESIDE_LEG, abs(y_m) <= beside_max_m, text
    lower_m = _start_lower_max_m(situation)
    terms = situation.assessment.terms
    level_m = terms.tracking_error_z_m if terms.radius_z_m is not None else math.inf
    upper_m, lower_m = min(limit_m, level_m), min(lower_m, level_m)
    limits = f"limits {upper_m:g} m above, {lower_m:.1f} m below"
    text = f"{abs(z_m):.1f} m off the cruise height ({limits})"
    yield RefusalKind.OFF_HEIGHT, -upper_m <= z_m <= lower_m, text
    at_hand = _at_hand(situation, pose)
    text = f"obstacle {at_hand} is at hand above or below, on the way to the cruise height"
    yield RefusalKind.OFF_HEIGHT, at_hand is None, text
    # From rest only: the way that braking would take is not certified.
    speed_mps = math.hypot(*pose.velocity_ned_mps)
    at_rest_mps = at_rest_speed_mps(situation.assessment)
    text = f"not at rest ({speed_mps:.1f} m/s, limit {at_rest_mps:.1f} m/s)"
    yield RefusalKind.MOVING, speed_mps < at_rest_mps, text
    yield RefusalKind.START_WORD, *_word_on_movers(situation)


def _word_on_movers(situation: Situation) -> tuple[bool, str]:
    """Tell whether the operator vouches for enough around the start, where no ring sees it."""
    assessment = situation.assessment
    if assessment.terms.movers_level != "passive_in_view":
        return True, ""
    stated_m = situation.route.mission.start_clear_of_movers_m or 0.0
    needed_m = start_clear_of_movers_m(assessment.terms, assessment.inflated)
    text = f"the mission's start_clear_of_movers_m is {stated_m:g} m (needed {needed_m:.1f} m)"
    return stated_m >= needed_m, text


def _at_hand(situation: Situation, pose: Pose) -> str | None:
    """Return an obstacle that is out of the way of the leg, but not where the vehicle hovers."""
    x_m, y_m, _ = situation.leg.position_leg(pose.position_ned_m)
    here = Box(x_m, x_m, y_m, y_m)
    band = HeightBand.around(pose.position_ned_m[2], half_band_m(situation.assessment.terms))
    for obstacle in situation.obstacles.out_of_way(x_m, x_m):
        if obstacle.region.obstacle.intersects(here) and band.meets(obstacle.filled_m):
            return obstacle.id
    return None


def _start_lower_max_m(situation: Situation) -> float:
    """How far below the cruise height a flight may start: only as near to the ground as is safe.

    Where the contract does not comply, a flight outside it starts all the same.
    """
    margins_m = [c.margin for c in situation.assessment.clauses if c.name == "ground_clearance"]
    return min([START_TOLERANCE_M, *(margin_m for margin_m in margins_m if margin_m > 0.0)])


class RefusalReport:
    """Reports why the service stays in STANDBY, when the kinds of reasons change."""

    def __init__(self) -> None:
        self._reported: frozenset[tuple[RefusalKind, str]] = frozenset()
        self._due_s = -math.inf

    def end(self) -> None:
        """Forget what was reported: control was taken, or taken back."""
        self._reported = frozenset()

    def news(self, refusals: Sequence[Refusal], now_s: float) -> Event | None:
        """Return what there is to report, at most once in `REFUSAL_PERIOD_S`.

        Args:
            refusals: every reason that holds now, at least one.
            now_s: the time.
        """
        kinds = frozenset((refusal.kind, refusal.subject) for refusal in refusals)
        if kinds == self._reported or now_s < self._due_s:
            return None
        self._reported, self._due_s = kinds, now_s + REFUSAL_PERIOD_S
        return refused("not leaving standby", refusals, now_s)


def refused(what: str, refusals: Sequence[Refusal], now_s: float) -> Event:
    """Return the event that reports every reason for a refusal.

    Args:
        what: is refused.
        refusals: at least one.
        now_s: the time.
    """
    text = f"{what}: " + "; ".join(refusal.text for refusal in refusals)
    reasons = [reason_of(refusal) for refusal in refusals]
    return Event(now_s, EventName.REFUSED, Severity.WARNING, text, {"reasons": reasons})


def reason_of(refusal: Refusal) -> RefusalReason:
    """Return a refusal as it is published."""
    return {"kind": refusal.kind.value, "subject": refusal.subject, "text": refusal.text}


def resume_refusals(situation: Situation, failures: FailureTimes, now_s: float) -> list[Refusal]:
    """Return why a hold may not be ended by the operator, but for what departures need as well.

    Args:
        situation: of the flight.
        failures: when each assumption failed last.
        now_s: the time.
    """
    cause, state = situation.hold_cause, situation.reference.sample(now_s)
    if situation.state is not FlightState.HOLDING or cause is None or state is None:
        text = f"not holding (phase {situation.state.phase})"
        return [Refusal(RefusalKind.NOT_HOLDING, text)]
    found = [
        Refusal(RefusalKind.FAILED, text, assumption)
        for assumption, text in resume_objections(*cause, failures, now_s).items()
    ]
    if situation.route.successor is not None:
        text = "another mission was received: the pilot has to take over first"
        found.append(Refusal(RefusalKind.MISSION_CHANGED, text))
    speed_mps = math.hypot(*state.velocity_leg_mps)
    if speed_mps > STOPPED_MPS:
        text = f"still braking ({speed_mps:.1f} m/s)"
        found.append(Refusal(RefusalKind.MOVING, text))
    return found


# What speaks against flying on, but not against a way back that begins where the vehicle is.
NOT_OF_WAY_BACK: Final = frozenset(
    {
        RefusalKind.BEFORE_LEG,
        RefusalKind.LEG_FLOWN,
        RefusalKind.BESIDE_LEG,
        RefusalKind.ENERGY,
        RefusalKind.GEOFENCE,  # the way flown has kept within it
    }
)


def return_refusals(situation: Situation, failures: FailureTimes, now_s: float) -> list[Refusal]:
    """Return why the vehicle may not return along the way flown; what departures need is apart.

    Args:
        situation: of the flight.
        failures: when each assumption failed last.
        now_s: the time.
    """
    state = situation.state
    if state is FlightState.STANDBY:
        return [Refusal(RefusalKind.NO_WAY_BACK, f"not flying (phase {state.phase})")]
    if situation.route.returning:
        return [Refusal(RefusalKind.NO_WAY_BACK, "the vehicle returns already")]
    if state is FlightState.HOLDING:
        return resume_refusals(situation, failures, now_s)
    return []
