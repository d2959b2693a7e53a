"""What must be true of every flight of a campaign, judged from its logs and from ground truth.

Each oracle yields one sentence per finding.  An oracle that rests on an assumption is silent where
that assumption was broken: `Case.covered` says whether collisions are promised away, and a flight
with faults or violations is not held to the contract's tracking error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np

from gcs_tools.campaign.detection_bounds import detection_bound
from gcs_tools.campaign.generator.scenarios import DISPLACING, Case
from gcs_tools.logs.flight_log import Log
from gcs_tools.logs.result import Result
from onboard.contract.agility import GRAVITY_MPS2
from onboard.contract.assessment import TICK_S
from onboard.events import EventName
from onboard.files.models import Contract
from onboard.geometry.frames import FloatArray
from onboard.recording.messages import StateRecord
from sitl.virtual.faults.schedule import Fault

_FLYING: Final = frozenset({"cruise", "avoid"})
_ROUND_OFF: Final = 1e-6
# The service's own tolerance at the border of a region (`onboard.guidance.phases`).
_BORDER_M: Final = 1e-3
_ENTRY_LATERAL_MPS: Final = 1e-3
# Steps of the worst case, and what they may be wrong by at 10 m/s.
_STEP_S: Final = 1e-3
_ROOM_TOLERANCE_M: Final = 0.01
# Without a motor a quadrotor falls: no software brings it to a defined end.
FALLING: Final = frozenset({"motor_failed"})
# More obstacles than any field here has, split and renamed ones included.
KNOWN_OBSTACLES_MAX: Final = 200


_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Evidence:
    """One flight, as its oracles see it.

    Attributes:
        case: what was flown and what it may come to.
        result: what came of it.
        flight, truth: the service's records, and the simulation's, tick by tick.
        at_rest: whether the vehicle came to rest and was told to land within the time limit.
    """

    case: Case
    result: Result
    flight: Log
    truth: Log
    at_rest: bool

    @property
    def undisturbed(self) -> bool:
        """Whether no fault was injected and no assumption was seen to fail."""
        return not self.case.scenario.faults and not self.result.violations

    @property
    def states(self) -> Sequence[StateRecord]:
        """The service's state in every tick."""
        return self.flight.states

    @cached_property
    def true_tracking_error_m(self) -> float:
        """Largest horizontal distance of the true position from the reference while flying."""
        return max(
            (
                math.dist(state.reference_position_ned_m[:2], truth.position_ned_m[:2])
                for state, truth in zip(self.states, self.truth.truths, strict=True)
                if state.phase in _FLYING and state.reference_position_ned_m is not None
            ),
            default=0.0,
        )


def findings(evidence: Evidence) -> dict[str, str]:
    """Return the first finding of every oracle that has one, by the oracle's name."""
    found = ((name, next(oracle(evidence), None)) for name, oracle in ORACLES.items())
    return {name: text for name, text in found if text is not None}


def _no_collision(evidence: Evidence) -> Iterator[str]:
    if evidence.case.covered and evidence.result.collisions:
        yield f"{evidence.result.collisions} collision(s)"


def _no_surprise(evidence: Evidence) -> Iterator[str]:
    """Where others may push the vehicle into something, the alarm comes first at the least."""
    case, result = evidence.case, evidence.result
    if case.covered or case.variant not in DISPLACING or not result.collisions:
        return
    faults = case.scenario.faults
    if faults and all(_began_in_standby(evidence, fault) for fault in faults):
        return  # somebody else flew, and was not watched
    ticks = zip(evidence.states, evidence.truth.truths, strict=True)
    hit_s = next(state.time_s for state, truth in ticks if truth.collisions)
    alarmed = any(
        event.name in {EventName.VIOLATION, EventName.SUSPICION} and event.time_s <= hit_s
        for event in evidence.flight.events
    )
    if not alarmed:
        yield f"{result.collisions} collision(s) without any alarm before"


def _no_exception(evidence: Evidence) -> Iterator[str]:
    """The service catches its own defects, and holds; here each is a finding.

    Among them is a motion of its own that does not certify, which only a vehicle of which nothing
    is promised may force on it.
    """
    for event in evidence.flight.events:
        if event.name != EventName.VIOLATION or event.data["assumption"] != "self_check":
            continue
        if event.data["unit"] == "exceptions" or evidence.case.covered:
            yield f"deciding failed: {event.text}"


def _plan_not_expired(evidence: Evidence) -> Iterator[str]:
    """Within an avoidance, what is sent belongs to a plan that has not come to its end.

    A service that is dead or stalled sends nothing, whatever its last state was.
    """
    if any(fault.kind in ("daemon_dead", "tick_stall") for fault in evidence.case.scenario.faults):
        return
    plans = iter(evidence.flight.plans)
    plan, upcoming = None, next(plans, None)
    for state in evidence.states:
        while upcoming is not None and upcoming.time_s <= state.time_s + _ROUND_OFF:
            plan, upcoming = upcoming, next(plans, None)
        if state.phase != "avoid":
            continue
        if plan is None:
            yield "avoidance without a plan"
        elif plan.end_s is not None and state.time_s > plan.end_s + TICK_S + _ROUND_OFF:
            yield f"setpoint sent {state.time_s - plan.end_s:.2f} s after its plan expired"


def _defined_end(evidence: Evidence) -> Iterator[str]:
    if not evidence.at_rest and evidence.case.variant not in FALLING:
        yield "the vehicle did not come to rest within the time limit"


def _outcome(evidence: Evidence) -> Iterator[str]:
    result, allowed = evidence.result, evidence.case.outcomes
    if evidence.case.covered and result.outcome not in allowed:
        yield f"{result.outcome} ({result.reason}), not {' or '.join(allowed)}"


def _expectation(evidence: Evidence) -> Iterator[str]:
    """What a scenario file states; a generated one says it by its outcomes."""
    scenario = evidence.case.scenario
    if evidence.case.expectation and not evidence.result.meets(scenario.expect):
        yield f"{evidence.result.outcome}: {evidence.result.reason}"


def _certified_plans(evidence: Evidence) -> Iterator[str]:
    for plan in evidence.flight.plans:
        if not plan.certificate.valid:
            yield f"plan {plan.kind} round {plan.obstacle} is flown without certificate"


def _plans_in_region(evidence: Evidence) -> Iterator[str]:
    """The paper's G_roi: an avoidance plan never leaves the region of its obstacle."""
    for plan in evidence.flight.plans:
        if plan.kind == "brake":
            continue
        outside_m = _outside_m(np.array(plan.path_ned_m)[:, :2], np.array(plan.region_ned_m))
        if outside_m > _BORDER_M:
            yield f"plan {plan.kind} leaves its region by {outside_m:.3f} m"


def _outside_m(points_ned_m: FloatArray, corners_ned_m: FloatArray) -> float:
    """How far the farthest of points (N, 2) is outside a rectangle of corners (4, 2) in order."""
    origin_m = corners_ned_m[0]
    worst_m = 0.0
    for corner_m in (corners_ned_m[1], corners_ned_m[3]):
        side_m = float(np.linalg.norm(corner_m - origin_m))
        along_m = (points_ned_m - origin_m) @ ((corner_m - origin_m) / side_m)
        worst_m = max(worst_m, float(-along_m.min()), float(along_m.max()) - side_m)
    return worst_m


def _tracking(evidence: Evidence) -> Iterator[str]:
    """The flown path, by ground truth, stays within E_tr of the planned one."""
    limit_m = evidence.case.scenario.contract.vehicle.tracking_error_m
    if not evidence.undisturbed:
        return
    worst_m = evidence.true_tracking_error_m
    if worst_m > limit_m:
        yield f"flown {worst_m:.3f} m beside the plan, {limit_m:.3f} m declared"


def _setpoints_in_limits(evidence: Evidence) -> Iterator[str]:
    """Inner box of erratum 7 with the climb of erratum 8: what the contract lets plans ask for."""
    vehicle = evidence.case.scenario.contract.vehicle
    tan_pitch = math.tan(math.radians(vehicle.pitch_max_deg))
    tan_roll = math.tan(math.radians(vehicle.roll_max_deg))
    thrust_mps2 = vehicle.thrust_to_weight * GRAVITY_MPS2
    for state in evidence.states:
        asked = state.reference_acceleration_ned_mps2
        if asked is None or state.leg_heading_rad is None or state.phase not in _FLYING:
            continue
        along_mps2, across_mps2 = _in_leg(asked, state.leg_heading_rad)
        lift_mps2 = GRAVITY_MPS2 - asked[2]
        if (
            abs(along_mps2) > tan_pitch * lift_mps2 + _ROUND_OFF
            or abs(across_mps2) > tan_roll * lift_mps2 + _ROUND_OFF
            or math.hypot(along_mps2, across_mps2, lift_mps2) > thrust_mps2 + _ROUND_OFF
        ):
            yield (
                f"setpoint asks for {along_mps2:.3f} m/s² along and {across_mps2:.3f} m/s² across, "
                f"in {state.phase}"
            )


def _continuous_reference(evidence: Evidence) -> Iterator[str]:
    """From tick to tick, the reference moves no farther than its speed takes it."""
    for before, after in pairwise(evidence.states):
        here_m, there_m = before.reference_position_ned_m, after.reference_position_ned_m
        if {before.phase, after.phase} <= _FLYING and here_m is not None and there_m is not None:
            speeds_mps = (
                math.hypot(*(state.reference_velocity_ned_mps or ())) for state in (before, after)
            )
            moved_m, elapsed_s = math.dist(here_m, there_m), after.time_s - before.time_s
            # Half an acceleration's change of speed within the tick on top, generously.
            if moved_m > max(speeds_mps) * elapsed_s + GRAVITY_MPS2 * elapsed_s**2 + _ROUND_OFF:
                yield f"the reference jumps by {moved_m:.3f} m in {elapsed_s:.2f} s"


def _entry_condition(evidence: Evidence) -> Iterator[str]:
    """Pre-condition of an induction step: at most V_cruise ahead, and V_recentring aside."""
    vehicle = evidence.case.scenario.contract.vehicle
    fastest_mps = vehicle.cruise_speed_mps
    aside_mps = vehicle.recentring_speed_mps + _ENTRY_LATERAL_MPS
    for before, after in pairwise(evidence.states):
        if (before.phase, after.phase) == ("cruise", "avoid"):
            velocity_mps = _given(before.reference_velocity_ned_mps)
            along_mps, across_mps = _in_leg(velocity_mps, _given(before.leg_heading_rad))
            if abs(across_mps) > aside_mps or not -1e-6 <= along_mps <= fastest_mps + 1e-6:
                yield f"avoidance entered at {along_mps:.3f} m/s ahead, {across_mps:.3f} aside"


def _entered_in_time(evidence: Evidence) -> Iterator[str]:
    """The region begins where stopping or getting clear is still possible, by stepping it through.

    This is what a wrong formula for the collision set takes away, while the margins for errors
    that do not happen may still cover it up in the flight itself.
    """
    contract, heading_rad = evidence.case.scenario.contract, _heading_rad(evidence)
    if not evidence.undisturbed:
        return
    for plan in evidence.flight.plans:
        corners_m = [_in_leg(corner, heading_rad) for corner in plan.keep_out_ned_m]
        face_m = min(ahead_m for ahead_m, _ in corners_m)
        front_m = min(_in_leg(corner, heading_rad)[0] for corner in plan.region_ned_m)
        width_m = max(aside_m for _, aside_m in corners_m) - min(y_m for _, y_m in corners_m)
        required_m = _room_required_m(contract, width_m)
        if face_m - front_m < required_m - _ROOM_TOLERANCE_M:
            yield (
                f"avoidance begins {face_m - front_m:.3f} m before the obstacle, "
                f"where the worst case takes {required_m:.3f} m"
            )


def _room_required_m(contract: Contract, width_m: float) -> float:
    """Way made, brakes and swerve at their limits, until past the nearer edge or at a stop.

    Passive safety adds to what is required; this is what must be there without it.
    """
    vehicle = contract.vehicle
    brake_mps2 = GRAVITY_MPS2 * math.tan(math.radians(vehicle.pitch_max_deg))
    swerve_mps2 = GRAVITY_MPS2 * math.tan(math.radians(vehicle.roll_max_deg))
    ahead_mps, aside_mps = vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0], 0.0
    ahead_m = ahead_mps * (vehicle.reaction_time_s + vehicle.attitude_lag_s)
    aside_m = 0.0
    while ahead_mps > 0.0 and aside_m < width_m / 2.0:
        ahead_mps -= brake_mps2 * _STEP_S
        aside_mps += swerve_mps2 * _STEP_S
        ahead_m += ahead_mps * _STEP_S
        aside_m += aside_mps * _STEP_S
    return ahead_m


def _exit_condition(evidence: Evidence) -> Iterator[str]:
    """Post-condition of an induction step: out of the region, without lateral speed."""
    plan, plans = None, iter(evidence.flight.plans)
    upcoming = next(plans, None)
    for before, after in pairwise(evidence.states):
        while upcoming is not None and upcoming.time_s <= before.time_s:
            plan, upcoming = upcoming, next(plans, None)
        if (before.phase, after.phase) != ("avoid", "cruise") or plan is None:
            continue
        heading_rad = _given(before.leg_heading_rad)
        _, across_mps = _in_leg(_given(after.reference_velocity_ned_mps), heading_rad)
        ahead_m, _ = _in_leg(_given(after.reference_position_ned_m), heading_rad)
        border_m = max(_in_leg(corner, heading_rad)[0] for corner in plan.region_ned_m)
        if abs(across_mps) > _ENTRY_LATERAL_MPS or ahead_m < border_m - _BORDER_M:
            yield (
                f"avoidance left {border_m - ahead_m:.3f} m before the border of the region, "
                f"at {across_mps:.3f} m/s aside"
            )


def _bounded_memory(evidence: Evidence) -> Iterator[str]:
    known = max((state.obstacles_known for state in evidence.states), default=0)
    if known > KNOWN_OBSTACLES_MAX + _ghosts_max(evidence):
        yield f"{known} obstacles are remembered"


def _ghosts_max(evidence: Evidence) -> int:
    """How many ghosts may have been seen: one in every frame, under a new name each time."""
    scenario, states = evidence.case.scenario, evidence.states
    if not any(fault.kind == "detections_ghost" for fault in scenario.faults):
        return 0
    lasted_s = states[-1].time_s - states[0].time_s
    return math.ceil(lasted_s * sum(sensor.rate_hz for sensor in scenario.plant.sensors))


def _heading_rad(evidence: Evidence) -> float:
    """Direction of the first leg; campaigns have no other, unless the operator changes it."""
    mission = evidence.case.scenario.mission
    north_m, east_m = mission.start_ned_m
    end_north_m, end_east_m = mission.legs[0].end_ned_m
    return math.atan2(end_east_m - east_m, end_north_m - north_m)


def _began_in_standby(evidence: Evidence, fault: Fault) -> bool:
    began_s = _onset_s(evidence, fault.phase, fault.entry, fault.start_s)
    since = (s.phase for s in evidence.states if began_s is not None and s.time_s >= began_s)
    return next(since, "") == "standby"


def _given(value: _Value | None) -> _Value:
    """Return a value that every state has while the service flies."""
    if value is None:
        raise ValueError("a state in flight lacks its reference")
    return value


def _in_leg(vector_ned: Sequence[float], heading_rad: float) -> tuple[float, float]:
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    north, east = vector_ned[:2]
    return cosine * north + sine * east, cosine * east - sine * north


def _detected_in_time(evidence: Evidence) -> Iterator[str]:
    """A broken assumption is noticed within its bound while the vehicle is on its way."""
    for fault in evidence.case.scenario.faults:
        bound = detection_bound(fault, evidence.case.scenario.contract)
        began_s = _onset_s(evidence, fault.phase, fault.entry, fault.start_s)
        if bound is None or began_s is None:
            continue
        names, bound_s = bound
        passing = fault.kind != "tick_stall" and (fault.duration_s or math.inf) <= bound_s
        exposed = [
            state.phase in _FLYING
            for state in evidence.states
            if began_s <= state.time_s <= began_s + bound_s
        ]
        # A flight that ends sooner has not been exposed for long enough.
        whole = evidence.states[-1].time_s >= began_s + bound_s
        if (
            not passing
            and whole
            and all(exposed)
            and not _noticed(evidence, names, began_s + bound_s)
        ):
            what = " or ".join(sorted(names)) or "end of control"
            yield f"{fault.kind} went unnoticed for {bound_s:.2f} s: no {what}"


def _noticed(evidence: Evidence, assumptions: frozenset[str], until_s: float) -> bool:
    """Tell whether one of them was reported; each is reported once, so earlier counts too."""
    return any(
        event.data.get("assumption", event.name) in assumptions and event.time_s <= until_s
        for event in evidence.flight.events
    )


def _onset_s(evidence: Evidence, phase: str | None, entry: int, start_s: float) -> float | None:
    """When a fault began, on the clock of the log; None if it never did."""
    states = evidence.states
    if phase is None:
        return states[0].time_s - TICK_S + start_s
    entries = [b.time_s for a, b in pairwise(states) if a.phase != phase == b.phase]
    return entries[entry - 1] + start_s if len(entries) >= entry else None


Oracle = Callable[[Evidence], Iterator[str]]

ORACLES: Final[dict[str, Oracle]] = {
    "no_collision": _no_collision,
    "no_surprise": _no_surprise,
    "no_exception": _no_exception,
    "plan_not_expired": _plan_not_expired,
    "defined_end": _defined_end,
    "outcome": _outcome,
    "expectation": _expectation,
    "certified_plans": _certified_plans,
    "plans_in_region": _plans_in_region,
    "tracking": _tracking,
    "setpoints_in_limits": _setpoints_in_limits,
    "continuous_reference": _continuous_reference,
    "entry_condition": _entry_condition,
    "entered_in_time": _entered_in_time,
    "exit_condition": _exit_condition,
    "bounded_memory": _bounded_memory,
    "detected_in_time": _detected_in_time,
}
