"""Random faults of every kind, and what a flight with each kind must still achieve."""

from __future__ import annotations

import math
import random
from typing import Final, get_args

from gcs_tools.campaign.generator.airframes import airframe_of
from gcs_tools.campaign.generator.plants import noise_max_m
from gcs_tools.scenario import Scenario
from sitl.virtual.faults.schema import Fault, FaultKind

# Not drawn: what an operator does in answer to another fault.
_ANSWERS: Final[frozenset[FaultKind]] = frozenset({"operator_resumes"})
FAULT_KINDS: Final[tuple[FaultKind, ...]] = tuple(
    kind for kind in get_args(FaultKind) if kind not in _ANSWERS
)
# A single sensor that reports a clear view and is wrong beyond its declared error cannot be
# detected: nothing is promised, and collisions are only counted.  Boxes declared in the wrong frame
# are such reports; the service does not check whether they move with the vehicle.
UNDETECTABLE: Final[frozenset[FaultKind]] = frozenset(
    {"detections_hidden", "detections_wrong_frame"}
)
# These move the vehicle off its path and no companion computer can prevent it: physics, or another
# commander's setpoints.  A collision is excused only if an alarm precedes it.
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
# With these the service is misled about what is where, for the moment that it takes to notice: what
# it calls free then is the fault's error, not the service's.
MISLEADING: Final[frozenset[FaultKind]] = UNDETECTABLE | {
    "detections_stuck",
    "detections_wrong_units",
    "detections_swapped",
    "sensor_clock_ahead",
    "sensor_clock_skewed",
    "telemetry_corrupted",
    "link_corrupting",
    "position_reset",
    "position_misreported",
    "attitude_stuck",
    "gps_lost",
}
# The contract covers these, or they do not concern it: the mission must be flown to its end.
TOLERATED: Final[frozenset[FaultKind]] = frozenset(
    {"detections_shifted", "link_duplicating", "solver_limited", "disk_full"}
)

# Ranges of amounts, in the units of `sitl.virtual.faults.schedule.AMOUNTS`; other kinds have no
# amount, or one that depends on the contract.
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
_UNITS: Final = (0.001, 0.01, 0.3048)  # millimetres, centimetres and feet read as metres
# These always end: after an endless stall or takeover there would be nothing to observe.
_PASSING_S: Final[dict[str, tuple[float, float]]] = {
    "tick_stall": (0.04, 1.0),
    "operator_takes_over": (1.0, 4.0),
}
_DURATION_S: Final = (0.2, 4.0)
# Every transition of the automaton: the phase that it enters, and for which time (from 1).
_TRANSITIONS: Final = (
    ("cruise", 1),
    ("avoid", 1),
    ("cruise", 2),
    ("arrived", 1),
    ("hold", 1),
    ("standby", 2),
)
# The same of a flight with best effort.
_BEST_EFFORT_TRANSITIONS: Final = (
    ("pause", 1),
    ("thread", 1),
    ("pause", 2),
    ("thread", 2),
    ("arrived", 1),
    ("hold", 1),
    ("standby", 2),
)


def drawn_fault(draw: random.Random, kind: FaultKind, scenario: Scenario) -> Fault:
    """Draw a fault that begins at any time, some time into a phase, or on a transition into one."""
    best_effort = _flies_best_effort(scenario)
    phase, entry = draw.choice(_BEST_EFFORT_TRANSITIONS if best_effort else _TRANSITIONS)
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


def leading_faults(draw: random.Random, fault: Fault, scenario: Scenario) -> tuple[Fault, ...]:
    """Draw the fault that brings the service into a phase that nominal flights never enter."""
    best_effort = _flies_best_effort(scenario)
    phases = ("pause", "thread") if best_effort else ("cruise", "avoid")
    at = {"phase": draw.choice(phases), "start_s": draw.uniform(0.5, 3.0)}
    match fault.phase:
        case "hold" if best_effort:  # a silent sensor is waited for
            leading = {"kind": "telemetry_lost", "duration_s": 1.0, **at}
        case "hold":
            leading = {"kind": "detections_off", "duration_s": None, **at}
        case "standby":
            leading = {"kind": "operator_takes_over", "duration_s": 2.0, **at}
        case _:
            return ()
    # The schedule applies only one of two faults of the same kind.
    return () if leading["kind"] == fault.kind else (Fault.model_validate(leading),)


def _flies_best_effort(scenario: Scenario) -> bool:
    return scenario.contract.requirements.progress == "best_effort"


def _drawn_amount(draw: random.Random, kind: FaultKind, scenario: Scenario) -> float | None:
    sensor = scenario.contract.sensor
    match kind:
        case "detections_short_range" | "detections_hidden":
            return sensor.detection_range_m * draw.uniform(0.3, 1.0)
        case "detections_shifted":
            # Undeclared, yet together with the noise within the contract's position error.
            (each,) = scenario.plant.sensors
            wander_m = airframe_of(scenario.plant).wander_m
            free_m = noise_max_m(scenario.contract, each.frame, wander_m) - each.noise_m
            return draw.random() * free_m * math.sqrt(2.0)
        case "detections_wrong_units":
            return draw.choice(_UNITS)
        case _ if kind in _AMOUNT_RANGES:
            return draw.uniform(*_AMOUNT_RANGES[kind])
        case _:
            return None


def all_tolerated(scenario: Scenario) -> bool:
    """Tell whether every fault of a scenario is one that the mission must survive."""
    return all(fault.kind in TOLERATED for fault in scenario.faults)
