"""The induction automaton (Fig. 14): its states, its transitions and their conditions.

The paper's argument is an induction over obstacles: cruise until the *pre-condition* of an obstacle
of interest holds, fly one avoidance that stays in its Region of Influence, and arrive at the
*post-condition*, which is the pre-condition of the next cruise.

`TRANSITIONS` is the whole automaton: no other variable decides what a trigger leads to.
`docs/state_chart.md` is generated from it (``python -m tests.tools.state_chart``).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique
from types import MappingProxyType
from typing import Final, NamedTuple

from onboard.contract.region import RegionOfInfluence
from onboard.motion.trajectory import State


@unique
class Phase(StrEnum):
    """What the service is doing, as published: a group of states."""

    STANDBY = "standby"
    CRUISE = "cruise"
    AVOID = "avoid"
    THREAD = "thread"
    PAUSE = "pause"
    YIELD = "yield"
    ARRIVED = "arrived"
    HOLD = "hold"


@unique
class FlightState(StrEnum):
    """The state of the automaton."""

    STANDBY = "standby"
    ALIGNING = "aligning"
    CRUISING = "cruising"
    RECENTRING = "recentring"
    AVOIDING = "avoiding"
    STOPPING_UNALIGNED = "stopping_unaligned"
    STOPPING = "stopping"
    AVOIDING_THEN_STOPPING = "avoiding_then_stopping"
    THREADING = "threading"
    LOOKING = "looking"
    YIELDING = "yielding"
    RESTING = "resting"
    ARRIVED = "arrived"
    HOLDING = "holding"

    @property
    def phase(self) -> Phase:
        """The published phase that this state belongs to."""
        return STATES[self].phase

    @property
    def flying(self) -> bool:
        """Whether the vehicle flies its mission, so that the guarantee applies."""
        return self.phase in (Phase.CRUISE, Phase.AVOID) or self.in_seen_space

    @property
    def in_seen_space(self) -> bool:
        """Whether the vehicle holds a way to rest in the space that was seen free."""
        return self.phase in (Phase.THREAD, Phase.PAUSE, Phase.YIELD)

    @property
    def cruising_freely(self) -> bool:
        """Whether the vehicle cruises along its leg, outside every Region of Influence."""
        return self in (FlightState.CRUISING, FlightState.RECENTRING, FlightState.STOPPING)

    @property
    def changes_mission(self) -> bool:
        """Whether the vehicle stops as soon as it can, to fly another mission from there."""
        stopping = self in (FlightState.STOPPING, FlightState.STOPPING_UNALIGNED)
        return stopping or self in (FlightState.AVOIDING_THEN_STOPPING, FlightState.RESTING)


@unique
class Trigger(StrEnum):
    """What may end a state."""

    CONTROL_GRANTED = "control granted"
    BEST_EFFORT_GRANTED = "best effort granted"
    RESUMED = "resumed"
    BEST_EFFORT_RESUMED = "best effort resumed"
    CONTROL_TAKEN = "control taken"
    ALIGNED = "aligned"
    CORRIDOR_FREE = "corridor free"
    CORRIDOR_BLOCKED = "corridor blocked"
    CRUISE_REPLANNED = "cruise replanned"
    PRE_CONDITION = "pre-condition"
    POST_CONDITION = "post-condition"
    WAY_FOUND = "way found"
    NO_WAY = "no way"
    MOVER_NEAR = "mover near"
    NO_LEAVE = "no leave"
    WAY_CLEAR = "way clear"
    START_UNSEEN = "start unseen"
    START_SEEN = "start seen"
    BACK_TO_CRUISE = "back to cruise"
    MISSION_CHANGED = "mission changed"
    LEG_FLOWN = "leg flown"
    MISSION_FLOWN = "mission flown"
    ASSUMPTION_FAILED = "assumption failed"


class StateFacts(NamedTuple):
    """The published phase of a state, and what the vehicle does in it."""

    phase: Phase
    meaning: str


_P, _S, _T = Phase, FlightState, Trigger

STATES: Final = MappingProxyType(
    {
        _S.STANDBY: StateFacts(_P.STANDBY, "the pilot flies; Clearway commands a hover at most"),
        _S.ALIGNING: StateFacts(_P.CRUISE, "brake to hover, turn the nose along the leg and look"),
        _S.CRUISING: StateFacts(_P.CRUISE, "fly along the leg and stop at its end"),
        _S.RECENTRING: StateFacts(_P.CRUISE, "cruise and drift back to the leg line (theory F)"),
        _S.AVOIDING: StateFacts(_P.AVOID, "fly the certified avoidance of one obstacle"),
        _S.STOPPING_UNALIGNED: StateFacts(
            _P.CRUISE, "brake to hover for another mission, before the nose is aligned"
        ),
        _S.STOPPING: StateFacts(_P.CRUISE, "stop along the leg for another mission"),
        _S.AVOIDING_THEN_STOPPING: StateFacts(
            _P.AVOID, "finish the avoidance, then stop for another mission"
        ),
        _S.THREADING: StateFacts(
            _P.THREAD, "fly the newest way to rest that certifies in the space seen free"
        ),
        _S.LOOKING: StateFacts(
            _P.PAUSE, "stay on the way to rest, turn the nose and look until a better one certifies"
        ),
        _S.YIELDING: StateFacts(
            _P.YIELD, "rest, or come to rest, for a mover or for leave; go on once the way is clear"
        ),
        _S.RESTING: StateFacts(_P.THREAD, "come to rest on the way held, for another mission"),
        _S.ARRIVED: StateFacts(_P.ARRIVED, "hover at the end of the mission"),
        _S.HOLDING: StateFacts(
            _P.HOLD, "brake to hover and stay until the pilot takes over, or the operator resumes"
        ),
    }
)

TRIGGERS: Final = MappingProxyType(
    {
        _T.CONTROL_GRANTED: "the pilot hands over and every departure check passes",
        _T.BEST_EFFORT_GRANTED: "the same, where the contract does not guarantee to pass obstacles",
        _T.RESUMED: "the operator's `clearway resume` or `clearway return`, and all that failed"
        " holds again",
        _T.BEST_EFFORT_RESUMED: "the same, where the vehicle flies in the space seen free",
        _T.CONTROL_TAKEN: "the pilot, a failsafe or a silent autopilot ends our control",
        _T.ALIGNED: "at rest with the nose along the leg for as long as the sensor needs to look",
        _T.CORRIDOR_FREE: "beside the leg line, and no known obstacle in the corridor towards it",
        _T.CORRIDOR_BLOCKED: "an obstacle is in the corridor, or the speed is about to change",
        _T.CRUISE_REPLANNED: "an estimator reset or an adapted contract asks for a new cruise",
        _T.PRE_CONDITION: "at the region of an obstacle of interest, with a certified plan",
        _T.POST_CONDITION: "the avoidance has ended at the post-obstacle border",
        _T.WAY_FOUND: "a way to rest certifies that leads on from where the vehicle is",
        _T.NO_WAY: "nothing that leads on certifies: neither what cruise or avoidance intend, nor,"
        " at rest or for long without progress, a better way to rest",
        _T.MOVER_NEAR: "what leads on is free but for movers, which may be there before the vehicle"
        " could rest",
        _T.NO_LEAVE: "what leads on is free, but others of the fleet have given no leave for it",
        _T.WAY_CLEAR: "a way to rest that leads on certifies against movers again, and has leave",
        _T.START_UNSEEN: "aligned, but the place where the vehicle hovers is not seen free",
        _T.START_SEEN: "it has been looked at all round, and a way to rest is held",
        _T.BACK_TO_CRUISE: "a leg has been threaded to its end, and the next one is cruised again;"
        " or a cruise is clear again, and has leave",
        _T.MISSION_CHANGED: "the operator has sent another mission",
        _T.LEG_FLOWN: "at rest at the leg's end, or stopped for another mission; a leg follows",
        _T.MISSION_FLOWN: "the same, and no leg follows",
        _T.ASSUMPTION_FAILED: "an assumption of the contract failed, and no adapted contract helps",
    }
)

# fmt: off
TRANSITIONS: Final = MappingProxyType(
    {
        (_S.STANDBY, _T.CONTROL_GRANTED): _S.ALIGNING,
        (_S.STANDBY, _T.BEST_EFFORT_GRANTED): _S.LOOKING,
        (_S.STANDBY, _T.MISSION_CHANGED): _S.STANDBY,

        (_S.ALIGNING, _T.ALIGNED): _S.CRUISING,
        (_S.ALIGNING, _T.START_UNSEEN): _S.LOOKING,
        (_S.ALIGNING, _T.MISSION_CHANGED): _S.STOPPING_UNALIGNED,
        (_S.ALIGNING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.ALIGNING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.CRUISING, _T.CORRIDOR_FREE): _S.RECENTRING,
        (_S.CRUISING, _T.CRUISE_REPLANNED): _S.CRUISING,
        (_S.CRUISING, _T.PRE_CONDITION): _S.AVOIDING,
        (_S.CRUISING, _T.NO_WAY): _S.LOOKING,
        (_S.CRUISING, _T.MOVER_NEAR): _S.YIELDING,
        (_S.CRUISING, _T.NO_LEAVE): _S.YIELDING,
        (_S.CRUISING, _T.MISSION_CHANGED): _S.STOPPING,
        (_S.CRUISING, _T.LEG_FLOWN): _S.ALIGNING,
        (_S.CRUISING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.CRUISING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.CRUISING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.RECENTRING, _T.CORRIDOR_BLOCKED): _S.CRUISING,
        (_S.RECENTRING, _T.CRUISE_REPLANNED): _S.CRUISING,
        (_S.RECENTRING, _T.NO_WAY): _S.LOOKING,
        (_S.RECENTRING, _T.MOVER_NEAR): _S.YIELDING,
        (_S.RECENTRING, _T.NO_LEAVE): _S.YIELDING,
        (_S.RECENTRING, _T.PRE_CONDITION): _S.AVOIDING,
        (_S.RECENTRING, _T.MISSION_CHANGED): _S.STOPPING,
        (_S.RECENTRING, _T.LEG_FLOWN): _S.ALIGNING,
        (_S.RECENTRING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.RECENTRING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.RECENTRING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.AVOIDING, _T.POST_CONDITION): _S.CRUISING,
        (_S.AVOIDING, _T.NO_WAY): _S.LOOKING,
        (_S.AVOIDING, _T.MOVER_NEAR): _S.YIELDING,
        (_S.AVOIDING, _T.NO_LEAVE): _S.YIELDING,
        (_S.AVOIDING, _T.MISSION_CHANGED): _S.AVOIDING_THEN_STOPPING,
        (_S.AVOIDING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.AVOIDING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.STOPPING_UNALIGNED, _T.MISSION_CHANGED): _S.STOPPING_UNALIGNED,
        (_S.STOPPING_UNALIGNED, _T.LEG_FLOWN): _S.ALIGNING,
        (_S.STOPPING_UNALIGNED, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.STOPPING_UNALIGNED, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.STOPPING_UNALIGNED, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.STOPPING, _T.CRUISE_REPLANNED): _S.STOPPING,
        (_S.STOPPING, _T.PRE_CONDITION): _S.AVOIDING_THEN_STOPPING,
        (_S.STOPPING, _T.NO_WAY): _S.RESTING,
        (_S.STOPPING, _T.MISSION_CHANGED): _S.STOPPING,
        (_S.STOPPING, _T.LEG_FLOWN): _S.ALIGNING,
        (_S.STOPPING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.STOPPING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.STOPPING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.AVOIDING_THEN_STOPPING, _T.POST_CONDITION): _S.STOPPING,
        (_S.AVOIDING_THEN_STOPPING, _T.NO_WAY): _S.RESTING,
        (_S.AVOIDING_THEN_STOPPING, _T.MISSION_CHANGED): _S.AVOIDING_THEN_STOPPING,
        (_S.AVOIDING_THEN_STOPPING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.AVOIDING_THEN_STOPPING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.THREADING, _T.NO_WAY): _S.LOOKING,
        (_S.THREADING, _T.MOVER_NEAR): _S.YIELDING,
        (_S.THREADING, _T.NO_LEAVE): _S.YIELDING,
        (_S.THREADING, _T.MISSION_CHANGED): _S.RESTING,
        (_S.THREADING, _T.LEG_FLOWN): _S.LOOKING,
        (_S.THREADING, _T.BACK_TO_CRUISE): _S.ALIGNING,
        (_S.THREADING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.THREADING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.THREADING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.LOOKING, _T.WAY_FOUND): _S.THREADING,
        (_S.LOOKING, _T.NO_WAY): _S.LOOKING,
        (_S.LOOKING, _T.MOVER_NEAR): _S.YIELDING,
        (_S.LOOKING, _T.NO_LEAVE): _S.YIELDING,
        (_S.LOOKING, _T.START_SEEN): _S.ALIGNING,
        (_S.LOOKING, _T.MISSION_CHANGED): _S.RESTING,
        (_S.LOOKING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.LOOKING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.YIELDING, _T.WAY_CLEAR): _S.THREADING,
        (_S.YIELDING, _T.BACK_TO_CRUISE): _S.ALIGNING,
        (_S.YIELDING, _T.NO_WAY): _S.LOOKING,
        (_S.YIELDING, _T.MISSION_CHANGED): _S.RESTING,
        (_S.YIELDING, _T.LEG_FLOWN): _S.LOOKING,
        (_S.YIELDING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.YIELDING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.YIELDING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.RESTING, _T.MISSION_CHANGED): _S.RESTING,
        (_S.RESTING, _T.LEG_FLOWN): _S.LOOKING,
        (_S.RESTING, _T.BACK_TO_CRUISE): _S.ALIGNING,
        (_S.RESTING, _T.MISSION_FLOWN): _S.ARRIVED,
        (_S.RESTING, _T.ASSUMPTION_FAILED): _S.HOLDING,
        (_S.RESTING, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.ARRIVED, _T.RESUMED): _S.ALIGNING,
        (_S.ARRIVED, _T.BEST_EFFORT_RESUMED): _S.LOOKING,
        (_S.ARRIVED, _T.MISSION_CHANGED): _S.ARRIVED,
        (_S.ARRIVED, _T.CONTROL_TAKEN): _S.STANDBY,

        (_S.HOLDING, _T.RESUMED): _S.ALIGNING,
        (_S.HOLDING, _T.BEST_EFFORT_RESUMED): _S.LOOKING,
        (_S.HOLDING, _T.MISSION_CHANGED): _S.HOLDING,
        (_S.HOLDING, _T.CONTROL_TAKEN): _S.STANDBY,
    }
)
# fmt: on


# Published phases in which the vehicle flies its mission.
FLYING_PHASES: Final = frozenset(state.phase for state in FlightState if state.flying)


class IllegalTransitionError(RuntimeError):
    """The automaton has no transition for a trigger in its current state: a programming error."""


def next_state(state: FlightState, trigger: Trigger) -> FlightState:
    """Return the state after a trigger.

    Raises:
        IllegalTransitionError: the table has no such transition.
    """
    try:
        return TRANSITIONS[state, trigger]
    except KeyError:
        allowed = ", ".join(f"'{known}'" for source, known in TRANSITIONS if source is state)
        text = f"no transition for trigger '{trigger}' in state '{state}' (expected {allowed})"
        raise IllegalTransitionError(text) from None


@dataclass(frozen=True)
class Condition:
    """The outcome of checking a state against a pre- or post-condition.

    Attributes:
        failures: one sentence for each part that does not hold.
    """

    failures: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether the condition holds."""
        return not self.failures


def pre_condition(
    state: State, region: RegionOfInfluence, *, speed_max_mps: float, late_m: float
) -> Condition:
    """Check a state against the pre-condition of an obstacle of interest (before Eq. 17).

    The vehicle flies along the leg towards the obstacle, at most at the contract's speed, drifts
    sideways at most as the contract allows, and is at the front of the region, or beyond it by no
    more than its reaction time covers.

    PAPER: "for any state on the boundary" is false for a lateral speed (erratum 12); here the
    drift that the region was built for is the bound, tests/onboard/guidance/test_phases.py.

    Args:
        state: where the avoidance starts, leg frame.
        region: the Region of Influence of the obstacle.
        speed_max_mps: greatest speed along the leg.
        late_m: greatest distance beyond the front of the region.
    """
    x_m, y_m, _ = state.position_leg_m
    speed_mps, lateral_mps, _ = state.velocity_leg_mps
    late_by_m, drift_mps = x_m - region.approach_x_m, region.lateral_speed_mps
    band = "conflict band {:.2f} to {:.2f} m".format(*region.conflict_band_y_m)
    off_course = f"y = {y_m:.2f} m is not on a collision course ({band})"
    fast = f"speed {speed_mps:.2f} m/s (expected 0 to {speed_max_mps:.2f} m/s)"
    drifting = f"lateral speed {lateral_mps:.2f} m/s (limit {drift_mps:.2f} m/s)"
    late = f"avoidance started {late_by_m:.2f} m late (limit {late_m:.2f} m)"
    return _condition(
        (region.on_collision_course(x_m, y_m), off_course),
        (0.0 <= speed_mps <= speed_max_mps, fast),
        (abs(lateral_mps) <= drift_mps, drifting),
        (late_by_m <= late_m, late),
    )


def post_condition(
    state: State, region: RegionOfInfluence, *, exit_speed_mps: float, tolerance_mps: float = 1e-3
) -> Condition:
    """Check a state against the post-condition (Eq. 14): past the border, cruising as planned.

    Args:
        state: where the avoidance ends, leg frame.
        region: the Region of Influence of the obstacle.
        exit_speed_mps: the planned speed along the leg at the end.
        tolerance_mps: of the speed along and across the leg.
    """
    x_m, y_m, _ = state.position_leg_m
    speed_mps, lateral_mps, _ = state.velocity_leg_mps
    border_m, left_m, right_m = region.x_pob_m, region.lane_left_m, region.lane_right_m
    short = f"x = {x_m:.2f} m is before the post-obstacle border at {border_m:.2f} m"
    differs = f"speed {speed_mps:.3f} m/s (expected the exit speed {exit_speed_mps:.3f} m/s)"
    drifting = f"lateral speed {lateral_mps:.3f} m/s (limit {tolerance_mps:.3f} m/s)"
    outside = f"y = {y_m:.2f} m is outside the lane ({left_m:.2f} to {right_m:.2f} m)"
    return _condition(
        (x_m >= border_m - 1e-3, short),
        (abs(speed_mps - exit_speed_mps) <= tolerance_mps, differs),
        (abs(lateral_mps) <= tolerance_mps, drifting),
        (left_m <= y_m <= right_m, outside),
    )


def _condition(*checks: tuple[bool, str]) -> Condition:
    return Condition(tuple(text for passed, text in checks if not passed))
