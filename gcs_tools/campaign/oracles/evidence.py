"""The evidence of one flight that oracles read, and conversions that several of them use."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeVar

from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.held_ways import HeldWay
from gcs_tools.logs.flight_log import Log
from gcs_tools.logs.result import Result
from onboard.contract.assessment import TICK_S
from onboard.guidance.phases import FLYING_PHASES
from onboard.recording.messages import StateRecord

ROUND_OFF: Final = 1e-6

_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Evidence:
    """The records of one flight.

    Attributes:
        case: the scenario and the outcomes that count as success.
        result: outcome and measured errors.
        flight: the service's records.
        truth: the simulation's, one per tick of the service.
        at_rest: the vehicle came to rest and was told to land within the time limit.
        ways: every way to rest that was held in flight.
    """

    case: FlightCase
    result: Result
    flight: Log
    truth: Log
    at_rest: bool
    ways: Sequence[HeldWay] = ()

    @property
    def undisturbed(self) -> bool:
        """Whether no fault was injected and the service reported no violation."""
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
                if state.phase in FLYING_PHASES and state.reference_position_ned_m is not None
            ),
            default=0.0,
        )


def given(value: _Value | None) -> _Value:
    """Return a value that every state has while the service flies.

    Raises:
        ValueError: it is missing.
    """
    if value is None:
        raise ValueError("a state in flight lacks its reference")
    return value


def in_leg(vector_ned: Sequence[float], heading_rad: float) -> tuple[float, float]:
    """Turn north and east into along and across a leg; further components are ignored."""
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    north, east = vector_ned[:2]
    return cosine * north + sine * east, cosine * east - sine * north


def onset_s(evidence: Evidence, phase: str | None, entry: int, start_s: float) -> float | None:
    """Return when a fault began, on the clock of the log; None if it never began.

    Args:
        evidence: the flight.
        phase: that triggers the fault; None counts from the start of the flight.
        entry: for which entry into the phase, from 1.
        start_s: after the trigger.
    """
    states = evidence.states
    if phase is None:
        return states[0].time_s - TICK_S + start_s
    entries = [b.time_s for a, b in pairwise(states) if a.phase != phase == b.phase]
    return entries[entry - 1] + start_s if len(entries) >= entry else None
