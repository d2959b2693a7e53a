"""The induction automaton (Fig. 14): states, what moves between them, and under which conditions.

The paper's argument is an induction over obstacles: cruise until the *pre-condition* of an obstacle
of interest holds, fly one avoidance that stays in its Region of Influence, and arrive at the
*post-condition*, which is the pre-condition of cruising on.  `TRANSITIONS` is the whole automaton;
a pair that is not in it is a programming error, and raises.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique
from types import MappingProxyType
from typing import Final

from onboard.contract.region import RegionOfInfluence
from onboard.motion.trajectory import State


@unique
class Phase(StrEnum):
    """What the service is doing."""

    STANDBY = "standby"
    CRUISE = "cruise"
    AVOID = "avoid"
    ARRIVED = "arrived"
    HOLD = "hold"


@unique
class Trigger(StrEnum):
    """What may end a phase."""

    CONTROL_GRANTED = "control granted"
    CONTROL_TAKEN = "control taken"
    PRE_CONDITION = "pre-condition"
    POST_CONDITION = "post-condition"
    LEG_FLOWN = "leg flown"
    MISSION_FLOWN = "mission flown"
    ASSUMPTION_FAILED = "assumption failed"


_P, _T = Phase, Trigger
TRANSITIONS: Final = MappingProxyType(
    {
        (_P.STANDBY, _T.CONTROL_GRANTED): _P.CRUISE,
        (_P.CRUISE, _T.PRE_CONDITION): _P.AVOID,
        (_P.CRUISE, _T.LEG_FLOWN): _P.CRUISE,
        (_P.CRUISE, _T.MISSION_FLOWN): _P.ARRIVED,
        (_P.CRUISE, _T.ASSUMPTION_FAILED): _P.HOLD,
        (_P.CRUISE, _T.CONTROL_TAKEN): _P.STANDBY,
        (_P.AVOID, _T.POST_CONDITION): _P.CRUISE,
        (_P.AVOID, _T.ASSUMPTION_FAILED): _P.HOLD,
        (_P.AVOID, _T.CONTROL_TAKEN): _P.STANDBY,
        (_P.ARRIVED, _T.CONTROL_TAKEN): _P.STANDBY,
        (_P.HOLD, _T.CONTROL_TAKEN): _P.STANDBY,
    }
)


class IllegalTransitionError(RuntimeError):
    """A trigger that the current phase does not know."""


def next_phase(phase: Phase, trigger: Trigger) -> Phase:
    """Return the phase after ``trigger``.

    Raises:
        IllegalTransitionError: the automaton has no such transition.
    """
    try:
        return TRANSITIONS[phase, trigger]
    except KeyError:
        raise IllegalTransitionError(f"{trigger} in {phase}") from None


@dataclass(frozen=True)
class Condition:
    """A pre- or post-condition held against a state: empty ``failures`` means that it holds."""

    failures: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether the condition holds."""
        return not self.failures


def pre_condition(
    state: State, region: RegionOfInfluence, *, speed_max_mps: float, late_m: float
) -> Condition:
    """Hold a state against the pre-condition of an obstacle of interest (before Eq. 17).

    The vehicle flies along the leg towards the obstacle, at most at the contract's speed, drifts
    sideways at most as the contract allows, and is at the front of the region or late by no more
    than its reaction time covers.

    PAPER: "for any state on the boundary" is false for a lateral speed (erratum 12); here the
    drift that the region was built for is the bound, tests/onboard/guidance/test_phases.py.
    """
    x_m, y_m, _ = state.position_leg_m
    speed_mps, lateral_mps, _ = state.velocity_leg_mps
    late_by_m = x_m - region.extent.x_min_m
    return Condition(
        _failures(
            (region.lies_ahead(x_m, y_m), f"y = {y_m:.2f} m does not meet the obstacle"),
            (0.0 <= speed_mps <= speed_max_mps, f"speed {speed_mps:.2f} > {speed_max_mps:.2f} m/s"),
            (
                abs(lateral_mps) <= region.lateral_speed_mps,
                f"lateral speed {lateral_mps:.2f} > {region.lateral_speed_mps:.2f} m/s",
            ),
            (late_by_m <= late_m, f"first planned {late_by_m:.2f} > {late_m:.2f} m late"),
        )
    )


def post_condition(
    state: State, region: RegionOfInfluence, *, exit_speed_mps: float, tolerance_mps: float = 1e-3
) -> Condition:
    """Check a state against the post-condition (Eq. 14): past the border, cruising as planned."""
    x_m, y_m, _ = state.position_leg_m
    speed_mps, lateral_mps, _ = state.velocity_leg_mps
    return Condition(
        _failures(
            (x_m >= region.x_pob_m - 1e-3, f"x = {x_m:.2f} m is not past the border"),
            (
                abs(speed_mps - exit_speed_mps) <= tolerance_mps,
                f"speed {speed_mps:.3f} is not the exit speed {exit_speed_mps:.3f} m/s",
            ),
            (abs(lateral_mps) <= tolerance_mps, f"lateral speed {lateral_mps:.3f} m/s"),
            (region.lane_left_m <= y_m <= region.lane_right_m, f"y = {y_m:.2f} m is off the lane"),
        )
    )


def _failures(*checks: tuple[bool, str]) -> tuple[str, ...]:
    return tuple(text for passed, text in checks if not passed)
