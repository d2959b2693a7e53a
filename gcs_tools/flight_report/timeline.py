"""What a flight did over time, in seconds since departure: path, phases, obstacles, plans."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import groupby

from gcs_tools.flight_report.columns import Columns
from gcs_tools.flight_report.flight import Document
from onboard.files.truth_record import TruthRecord
from onboard.guidance.phases import FLYING_PHASES
from onboard.recording.messages import (
    KnownObstacle,
    Monitors,
    Obstacles,
    PlanRecord,
    Record,
    SeenSpace,
    StateRecord,
)

# The report shows this much before arming and after disarming.
_GROUND_S = 1.0
# The age of detections is a saw-tooth: shown is its maximum over this many ticks, 0.4 s.
_AGE_TICKS = 20
_CORNER_DIGITS = 3
SEEN_SPACES_MAX = 150


def since(record: Record, start_s: float) -> float:
    """Return a record's time in seconds since departure."""
    return round(record.time_s - start_s, 3)


def flight_states(states: Sequence[StateRecord]) -> Sequence[StateRecord]:
    """Return the states without waiting on the ground; all states if the vehicle never left it."""
    # Autopilots report to be airborne only after they have climbed.
    flown = [state for state in states if state.armed or state.airborne]
    if not flown:
        return states
    begin_s, end_s = flown[0].time_s - _GROUND_S, flown[-1].time_s + _GROUND_S
    # Times that run backwards would leave no state.
    return [state for state in states if begin_s <= state.time_s <= end_s] or states


def monitors_during(monitors: Sequence[Monitors], states: Sequence[StateRecord]) -> list[Monitors]:
    """Return the records between the first and the last state."""
    begin_s, end_s = states[0].time_s, states[-1].time_s
    return [record for record in monitors if begin_s <= record.time_s <= end_s]


def truths_during(
    truths: Sequence[TruthRecord], states: Sequence[StateRecord]
) -> list[TruthRecord]:
    """Return the ground truth between the first and the last state."""
    begin_s, end_s = states[0].time_s, states[-1].time_s
    return [truth for truth in truths if begin_s <= truth.time_unix_s <= end_s]


def departure_s(states: Sequence[StateRecord]) -> float:
    """Return the Unix time when the daemon took control, or that of the first state."""
    flying = (state.time_s for state in states if state.phase != "standby")
    return next(flying, states[0].time_s)


def height_m(states: Sequence[StateRecord]) -> float:
    """Return the greatest height above the origin [m]; 0 if no position is known."""
    known = [state.position_ned_m[2] for state in states if state.position_ned_m]
    return -min(known, default=0.0)


def path_columns(states: Sequence[StateRecord], start_s: float) -> Document:
    """Return the columns of measured and commanded motion, all of the same length."""
    columns = Columns(states)
    return {
        "time_s": columns.of(lambda state: state.time_s - start_s, 2),
        "north_m": columns.vector(lambda s: s.position_ned_m, 0),
        "east_m": columns.vector(lambda s: s.position_ned_m, 1),
        "height_m": columns.vector(lambda s: s.position_ned_m, 2, scale=-1.0),
        "yaw_rad": columns.of(lambda state: state.yaw_rad),
        "north_mps": columns.vector(lambda s: s.velocity_ned_mps, 0),
        "east_mps": columns.vector(lambda s: s.velocity_ned_mps, 1),
        "up_mps": columns.vector(lambda s: s.velocity_ned_mps, 2, scale=-1.0),
        "roll_deg": columns.angle_deg(lambda s: s.roll_rad),
        "pitch_deg": columns.angle_deg(lambda s: s.pitch_rad),
        "yaw_deg": columns.angle_deg(lambda s: s.yaw_rad),
        "reference_north_m": columns.vector(lambda s: s.reference_position_ned_m, 0),
        "reference_east_m": columns.vector(lambda s: s.reference_position_ned_m, 1),
        "reference_height_m": columns.vector(lambda s: s.reference_position_ned_m, 2, scale=-1.0),
        "reference_north_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 0),
        "reference_east_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 1),
        "reference_up_mps": columns.vector(lambda s: s.reference_velocity_ned_mps, 2, scale=-1.0),
        "velocity_error_along_mps": columns.peaks(_velocity_error(0), 4),
        "velocity_error_across_mps": columns.peaks(_velocity_error(1), 4),
        # Outside these phases the daemon repeats its last value.
        "tracking_error_m": columns.peaks(
            lambda state: state.tracking_error_m if state.phase in FLYING_PHASES else None,
            4,
        ),
        "detection_age_s": columns.peaks(lambda state: state.detection_age_s, back=_AGE_TICKS),
    }


def _velocity_error(axis: int) -> Callable[[StateRecord], float | None]:
    def read(state: StateRecord) -> float | None:
        # The contract limits it before an avoidance begins, not during one.
        error_mps = state.velocity_error_mps if state.cruising else None
        return None if error_mps is None else abs(error_mps[axis])

    return read


def known_columns(monitors: Sequence[Monitors], start_s: float) -> Document:
    """Return the clearance that the daemon measured."""
    columns = Columns(monitors)
    return {
        "time_s": columns.of(lambda record: record.time_s - start_s, 2),
        "clearance_m": columns.of(lambda record: record.clearance.measured),
    }


def truth_columns(truths: Sequence[TruthRecord], start_s: float) -> Document:
    """Return the columns of ground truth: clearance and rotor speeds."""
    columns = Columns(truths)
    return {
        "time_s": columns.of(lambda truth: truth.time_unix_s - start_s, 2),
        "clearance_m": columns.of(lambda truth: truth.clearance_m),
        "rpm": [columns.of(_rotor(index), 0) for index in range(4)] if truths else [],
    }


def _rotor(index: int) -> Callable[[TruthRecord], float | None]:
    def read(truth: TruthRecord) -> float | None:
        return truth.rpm[index] if index < len(truth.rpm) else None

    return read


def phase_spans(states: Sequence[StateRecord], start_s: float) -> list[Document]:
    """Return each phase with its begin and end."""
    found: list[Document] = []
    for phase, group in groupby(states, key=lambda state: state.phase):
        begin_s = since(next(group), start_s)
        if found:
            found[-1]["end_s"] = begin_s
        found.append({"start_s": begin_s, "end_s": since(states[-1], start_s), "phase": phase})
    return found


def obstacle_spans(messages: Sequence[Obstacles], start_s: float) -> list[Document]:
    """Return every obstacle as the daemon knew it, and from when until when (null: to the end)."""
    every: list[Document] = []
    current: dict[str, Document] = {}
    for message in messages:
        time_s = since(message, start_s)
        every_one = (*message.passed_over, *message.obstacles)
        known = {obstacle.id: _corners(obstacle) for obstacle in every_one}
        for obstacle_id, before in list(current.items()):
            if known.get(obstacle_id) != before["corners"]:
                before["until_s"] = time_s
                del current[obstacle_id]
        for obstacle_id, corners in known.items():
            if obstacle_id not in current:
                current[obstacle_id] = {
                    "id": obstacle_id,
                    "since_s": time_s,
                    "until_s": None,
                    "corners": corners,
                }
                every.append(current[obstacle_id])
    return [{**obstacle.pop("corners"), **obstacle} for obstacle in every]


def _corners(obstacle: KnownObstacle) -> Document:
    return {
        "measured_ned_m": _rounded_points(obstacle.measured_ned_m),
        "keep_out_ned_m": _rounded_points(obstacle.keep_out_ned_m),
        "region_ned_m": _rounded_points(obstacle.region_ned_m),
        "lane_ned_m": _rounded_points(obstacle.lane_ned_m),
        "boundary_ned_m": _rounded_points(obstacle.boundary_ned_m),
        "down_m": _rounded_heights(obstacle),
    }


def _rounded_heights(obstacle: KnownObstacle) -> list[float | None] | None:
    if obstacle.down_m is None:
        return None
    return [each if each is None else round(each, _CORNER_DIGITS) for each in obstacle.down_m]


def _rounded_points(points_m: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[round(value, _CORNER_DIGITS) for value in point] for point in points_m]


def plan_paths(plans: Sequence[PlanRecord], start_s: float) -> list[Document]:
    """Return each plan with its path and duration."""
    return [
        {
            "time_s": since(plan, start_s),
            "end_s": (plan.end_s or plan.time_s) - start_s,
            "plan_time_ms": plan.plan_time_ms,
            "path_ned_m": _rounded_points(plan.path_ned_m),
        }
        for plan in plans
    ]


def seen_spaces(records: Sequence[SeenSpace], start_s: float) -> list[Document]:
    """Return each record of the seen-free set as the map draws it.

    A page cannot hold hundreds of them: of a long flight every n-th is kept, and the last one.
    """
    step = max(1, math.ceil(len(records) / SEEN_SPACES_MAX))
    kept = [*records[:-1:step], *records[-1:]]
    return [
        {
            **asdict(record),
            "time_s": since(record, start_s),
            "way_to_rest_ned_m": _rounded_points(record.way_to_rest_ned_m),
            "guide_ned_m": _rounded_points(record.guide_ned_m),
        }
        for record in kept
    ]
