"""Oracles about how a flight ends: collisions, its outcome, exceptions, memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from gcs_tools.campaign.generator.faults import DISPLACING
from gcs_tools.campaign.oracles.evidence import Evidence, onset_s
from onboard.events import EventName
from sitl.virtual.faults.schema import Fault

# Without a motor a quadrotor falls; no software can bring it to a defined end.
FALLING: Final = frozenset({"motor_failed"})
# More than any generated field has, split and renamed obstacles included.
KNOWN_OBSTACLES_MAX: Final = 200


def no_collision(evidence: Evidence) -> Iterator[str]:
    """A covered flight has no collision."""
    if evidence.case.covered and evidence.result.collisions:
        yield f"{evidence.result.collisions} collision(s)"


def no_surprise(evidence: Evidence) -> Iterator[str]:
    """Where a fault may push the vehicle into an obstacle, an alarm precedes the collision."""
    case, result = evidence.case, evidence.result
    if case.covered or case.variant not in DISPLACING or not result.collisions:
        return
    faults = case.scenario.faults
    if faults and all(_began_in_standby(evidence, fault) for fault in faults):
        return  # the service was not in control, and monitored nothing
    ticks = zip(evidence.states, evidence.truth.truths, strict=True)
    hit_s = next(state.time_s for state, truth in ticks if truth.collisions)
    alarmed = any(
        event.name in {EventName.VIOLATION, EventName.SUSPICION} and event.time_s <= hit_s
        for event in evidence.flight.events
    )
    if not alarmed:
        yield f"{result.collisions} collision(s) without an alarm before"


def _began_in_standby(evidence: Evidence, fault: Fault) -> bool:
    """Tell whether a fault began while the service was not in control."""
    began_s = onset_s(evidence, fault.phase, fault.entry, fault.start_s)
    since = (s.phase for s in evidence.states if began_s is not None and s.time_s >= began_s)
    return next(since, "") == "standby"


def no_exception(evidence: Evidence) -> Iterator[str]:
    """The service catches its own defects and holds; a campaign reports each.

    A motion of its own that does not certify counts, too, unless nothing is promised of the flight.
    A process that a fault suspends for longer than the autopilot waits does not count.
    """
    suspended = any(fault.kind == "tick_stall" for fault in evidence.case.scenario.faults)
    for event in evidence.flight.events:
        if event.name != EventName.VIOLATION or event.data["assumption"] != "self_check":
            continue
        if suspended and event.data["unit"] == "s":
            continue
        if event.data["unit"] == "exceptions" or evidence.case.covered:
            yield f"exception in the service: {event.text}"


def defined_end(evidence: Evidence) -> Iterator[str]:
    """Every flight ends at rest within the time limit."""
    cut_off = evidence.case.time_limit_s is not None
    if not evidence.at_rest and not cut_off and evidence.case.variant not in FALLING:
        yield "the vehicle did not come to rest within the time limit"


def allowed_outcome(evidence: Evidence) -> Iterator[str]:
    """A covered flight ends with one of its case's outcomes."""
    result, allowed = evidence.result, evidence.case.outcomes
    if evidence.case.covered and result.outcome not in allowed:
        yield f"{result.outcome} ({result.reason}), expected {' or '.join(allowed)}"


def met_expectation(evidence: Evidence) -> Iterator[str]:
    """A flight from a scenario file meets the file's ``expect``."""
    scenario = evidence.case.scenario
    if evidence.case.expectation and not evidence.result.meets(scenario.expect):
        yield f"{evidence.result.outcome}: {evidence.result.reason}"


def bounded_memory(evidence: Evidence) -> Iterator[str]:
    """The service does not accumulate obstacles without bound."""
    known = max((state.obstacles_known for state in evidence.states), default=0)
    limit = KNOWN_OBSTACLES_MAX + _ghosts_max(evidence)
    if known > limit:
        yield f"{known} obstacles are remembered, expected at most {limit}"


def _ghosts_max(evidence: Evidence) -> int:
    """Return how many ghosts a fault may have shown: one per frame, each with a new name."""
    scenario, states = evidence.case.scenario, evidence.states
    if not any(fault.kind == "detections_ghost" for fault in scenario.faults):
        return 0
    lasted_s = states[-1].time_s - states[0].time_s
    return math.ceil(lasted_s * sum(sensor.rate_hz for sensor in scenario.plant.sensors))
