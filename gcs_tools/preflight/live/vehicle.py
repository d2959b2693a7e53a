"""Checks what is known of a live vehicle against its contract and mission."""

from __future__ import annotations

import math
from itertools import pairwise

from shapely import LineString

from gcs_tools.preflight.finding import VEHICLE_IDENTITY, Finding, Verdict
from gcs_tools.preflight.live.firmware import firmware_finding
from gcs_tools.preflight.live.parameters import check_parameters, corridor_m
from gcs_tools.preflight.live.takeover import takeover_finding
from gcs_tools.vehicle.clock import ANSWER_TIMEOUT_S, PINGS
from gcs_tools.vehicle.geofence import fence_areas
from gcs_tools.vehicle.operator import HEALTH_TIMEOUT_S
from gcs_tools.vehicle.query import TRIES, WAIT_S
from gcs_tools.vehicle.survey import COUNTED, LISTEN_S, VehicleFacts
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.guidance.departure import START_TOLERANCE_M
from onboard.mavlink.profiles.parameter_rules import ReportedParameters
from onboard.mavlink.profiles.profile import CONSTANT_POSITION, NEEDED_ESTIMATOR_FLAGS
from onboard.mavlink.profiles.registry import known_profiles
from onboard.mavlink.profiles.setpoint_loss import loss_model_in_words, loss_model_refusal
from onboard.mission_items.fence_items import FenceError
from onboard.monitoring.detections import CLOCK_TOLERANCE_S
from onboard.monitoring.energy import there_and_back_s

RATE_MIN_HZ = 5.0
# What is left of the battery after the mission: take-off, landing, and a third more than planned.
GROUND_TIME_S = 60.0
TIME_RESERVE = 4.0 / 3.0
CHARGE_RESERVE = 0.2
# Of the default gates; PX4 by default arms up to this (COM_ARM_EKF_POS, _VEL, _YAW).
INNOVATION_RATIO_MAX = 0.5

_NOT_ANSWERED = f"neither TIMESYNC nor PING was answered within {ANSWER_TIMEOUT_S:g} s"


def evaluate(
    facts: VehicleFacts, assessment: Assessment, mission: Mission | None, endurance_s: float | None
) -> list[Finding]:
    """Check what was learnt of a vehicle against a contract, and a mission where there is one.

    Args:
        facts: of the vehicle.
        assessment: the contract.
        mission: for battery, home, start and geofence; None leaves these unchecked.
        endurance_s: hover time of a full battery; needed where the vehicle estimates no
            remaining time.
    """
    terms = assessment.terms
    findings = [
        _identity(facts),
        _health(facts),
        firmware_finding(facts.profile, facts.version, facts.stage),
        *(_rate(facts, name) for name in COUNTED),
        _link_delay(facts, terms.reaction_time_s),
        _clock(facts),
        _estimator(facts),
        *_setpoint_loss(facts, assessment),
        *_parameters(facts, assessment, mission),
        takeover_finding(facts.profile.take_over, facts.parameters, heard=facts.radio_heard),
    ]
    if mission is not None:
        findings += [_home(facts), _start(facts, mission)]
        findings.append(_fence_areas(facts, mission, corridor_m(assessment, mission)))
        findings.append(_battery_finding(facts, mission, assessment, endurance_s))
    return findings


def flight_time_s(mission: Mission, assessment: Assessment) -> float:
    """Return how long a mission takes, with take-off, landing and a reserve for avoidances."""
    points = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
    length_m = sum(math.dist(*leg) for leg in pairwise(points))
    return GROUND_TIME_S + TIME_RESERVE * length_m / assessment.terms.cruise_speed_mps


def _battery_finding(
    facts: VehicleFacts, mission: Mission, assessment: Assessment, endurance_s: float | None
) -> Finding:
    """Check the battery against the mission; against its budget, the way back included, if any."""
    needed_s, budget = flight_time_s(mission, assessment), mission.energy
    if budget is None:
        return _battery(facts, needed_s, endurance_s, CHARGE_RESERVE)
    back_s = there_and_back_s(mission, assessment.terms.cruise_speed_mps)
    needed_s = max(2.0 * (needed_s - GROUND_TIME_S), back_s) + GROUND_TIME_S
    return _battery(facts, needed_s, budget.endurance_s, budget.reserve_fraction)


def _parameters(
    facts: VehicleFacts, assessment: Assessment, mission: Mission | None
) -> list[Finding]:
    if facts.profile.parameters is None:
        known = ", ".join(each.name for each in known_profiles() if each.parameters is not None)
        text = f"no rules for the parameters of this autopilot, expected one of: {known}"
        return [_unknown("parameters", text)]
    reported = ReportedParameters(
        facts.parameters, facts.version, complete=facts.parameters_complete
    )
    return check_parameters(facts.profile.parameters, reported, assessment, mission)


def _setpoint_loss(facts: VehicleFacts, assessment: Assessment) -> list[Finding]:
    contract = assessment.contract
    if not contract.requirements.passive_safety:
        return []
    refusal = loss_model_refusal(facts.profile, contract)
    text = refusal or loss_model_in_words(contract)
    return [_known("setpoint_loss", holds=refusal is None, text=text)]


def _known(name: str, *, holds: bool, text: str) -> Finding:
    return Finding("vehicle", name, Verdict.of(holds=holds), text)


def _unknown(name: str, text: str) -> Finding:
    return Finding("vehicle", name, Verdict.UNKNOWN, text)


def _identity(facts: VehicleFacts) -> Finding:
    version = "" if facts.version is None else ".".join(map(str, facts.version))
    text = " ".join(filter(None, (facts.profile.name, version, facts.stage)))
    return _known(VEHICLE_IDENTITY, holds=True, text=f"system id {facts.system_id}, {text}")


def _health(facts: VehicleFacts) -> Finding:
    text = facts.unhealthy or "sensors, estimator, position and home"
    failed = f"after {HEALTH_TIMEOUT_S:g} s not ready: {text}"
    return _known("health", holds=not facts.unhealthy, text=failed if facts.unhealthy else text)


def _rate(facts: VehicleFacts, name: str) -> Finding:
    rate_hz = facts.rates_hz.get(name, 0.0)
    text = f"{rate_hz:.0f} Hz in {LISTEN_S:g} s on this link, needs {RATE_MIN_HZ:g} Hz"
    return _known(name, holds=rate_hz >= RATE_MIN_HZ, text=text)


def _link_delay(facts: VehicleFacts, limit_s: float) -> Finding:
    if facts.clock is None:
        return _unknown("link delay", _NOT_ANSWERED)
    trip_s = facts.clock.round_trip_s
    text = (
        f"round trip {trip_s * 1e3:.0f} ms at most in {PINGS} exchanges ({facts.clock.source}), "
        f"reaction_time_s of the contract {limit_s * 1e3:.0f} ms"
    )
    return _known("link delay", holds=trip_s <= limit_s, text=text)


def _clock(facts: VehicleFacts) -> Finding:
    if facts.clock is None:
        return _unknown("clock", _NOT_ANSWERED)
    unsteady_s, unix_s = facts.clock.unsteady_s, facts.clock.unix_offset_s
    if unsteady_s is None:
        return _unknown("clock", "TIMESYNC was not answered, and no SYSTEM_TIME arrived")
    # No clock drifts by this much in a few exchanges: it was set, or something resets it.
    holds = unsteady_s <= CLOCK_TOLERANCE_S
    steady = (
        f"jumped by {unsteady_s * 1e3:.1f} ms, limit {CLOCK_TOLERANCE_S * 1e3:g} ms "
        f"({facts.clock.source})"
    )
    unix = "it does not tell Unix time"
    if unix_s is not None:
        unix = f"its Unix time is {in_words(unix_s)} this computer's"
    return _known("clock", holds=holds, text=f"{steady}; {unix}")


def in_words(ahead_s: float) -> str:
    """Say how far a clock is ahead of another, or behind it."""
    if abs(ahead_s) < 0.5e-3:
        return "the same as"
    return f"{abs(ahead_s):.3f} s {'ahead of' if ahead_s > 0.0 else 'behind'}"


def _estimator(facts: VehicleFacts) -> Finding:
    if facts.estimator is None:
        return _unknown("estimator", f"no status within {TRIES * WAIT_S:g} s, asked {TRIES} times")
    flags, ratio = facts.estimator.flags, facts.estimator.worst_ratio
    own, note = facts.profile.estimator, ""
    faults = {**own.made_up_flags, **own.doubt_flags}
    if own.constant_at_rest and facts.on_ground:
        at_rest = [bit for bit in CONSTANT_POSITION if flags & bit]
        faults = {bit: text for bit, text in faults.items() if bit not in CONSTANT_POSITION}
        note = ", position kept constant at rest" if at_rest else ""
    wrong = [f"no {name}" for bits, name in NEEDED_ESTIMATOR_FLAGS if not flags & bits]
    wrong += [text for bit, text in faults.items() if flags & bit]
    if wrong:
        return _known("estimator", holds=False, text=", ".join(wrong))
    if math.isnan(ratio):
        return _unknown("estimator", "reports no innovations")
    text = f"innovations at {ratio:.2f} of where they are rejected, limit {INNOVATION_RATIO_MAX:g}"
    return _known("estimator", holds=ratio <= INNOVATION_RATIO_MAX, text=text + note)


def _home(facts: VehicleFacts) -> Finding:
    if facts.home_ned_m is None:
        return _unknown("home", f"no HOME_POSITION within {TRIES * WAIT_S:g} s")
    *_, down_m = facts.home_ned_m
    text = (
        f"{abs(down_m):.1f} m above or below the local origin, from which altitudes count; "
        f"limit {START_TOLERANCE_M:g} m"
    )
    return _known("home", holds=abs(down_m) <= START_TOLERANCE_M, text=text)


def _start(facts: VehicleFacts, mission: Mission) -> Finding:
    if facts.position_ned_m is None:
        return _unknown("start", "no position reported")
    away_m = math.dist(facts.position_ned_m[:2], mission.start_ned_m)
    text = f"{away_m:.1f} m from the start of the mission, limit {START_TOLERANCE_M:g} m"
    return _known("start", holds=away_m <= START_TOLERANCE_M, text=text)


def _fence_areas(facts: VehicleFacts, mission: Mission, corridor_m: float) -> Finding:
    """Check the corridor of the mission against all areas together.

    Some autopilots are content if one inclusion contains the vehicle; all of them must do here.
    """
    name = "geofence areas"
    if facts.fence is None or facts.origin is None:
        missing = "the geofence on board" if facts.fence is None else "home"
        return _unknown(name, f"the vehicle did not report {missing}")
    known = facts.profile.parameters
    counter = None if known is None else known.fence_count
    counted = 0.0 if counter is None else facts.parameters.get(counter, 0.0)
    if counted > 0.0 and not facts.fence:
        return _unknown(name, f"the vehicle counts {counted:g} points ({counter}), but sent none")
    path = LineString([mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)])
    try:
        areas = fence_areas(facts.fence, facts.origin)
        margins_m = [(area.margin_m(path) - corridor_m, str(area)) for area in areas]
    except FenceError as error:
        return _unknown(name, str(error))
    if not margins_m:
        return _known(name, holds=True, text="none on board")
    margin_m, worst = min(margins_m)
    corridor = f"corridor of {corridor_m:.1f} m on each side of the legs"
    if margin_m == -math.inf:
        return _known(name, holds=False, text=f"the legs cross the {worst}")
    what = "clear of" if margin_m >= 0.0 else "too wide for"
    text = f"{corridor} is {what} the {worst} by {abs(margin_m):.1f} m"
    return _known(name, holds=margin_m >= 0.0, text=text)


def _battery(
    facts: VehicleFacts, needed_s: float, endurance_s: float | None, reserve: float
) -> Finding:
    estimated_s, share = facts.battery_time_s, facts.battery_share
    endured_s = None
    if share is not None and endurance_s is not None:
        endured_s = max(share - reserve, 0.0) * endurance_s
    # What a vehicle estimates with its motors off may be days: the shorter time counts.
    left_s = min((each for each in (estimated_s, endured_s) if each is not None), default=None)
    if left_s is None:
        lacking = "charge" if share is None else "remaining time; set --endurance"
        return _unknown("battery", f"the vehicle reports no {lacking}")
    charge = "" if share is None else f"{100.0 * share:.0f} % charged, "
    text = f"{charge}{left_s:.0f} s of flight left, the mission needs {needed_s:.0f} s"
    return _known("battery", holds=left_s >= needed_s, text=text)
