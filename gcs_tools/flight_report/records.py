"""What a report needs of the records of a log; those that have another shape are left out.

Every key but the time may be missing: a log of another version then shows less, never something
wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gcs_tools.logs.flight_log import Log

Number = Annotated[float, Field(allow_inf_nan=False)]
# From 1970 on, for as long as anybody may fly.
Time = Annotated[float, Field(ge=0.0, le=1e10)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _Record(BaseModel):
    model_config = ConfigDict(strict=True)


class _State(_Record):
    time_s: Time
    phase: str = ""
    armed: bool | None = None
    airborne: bool | None = None
    cruising: bool | None = None
    position_ned_m: Triple | None = None
    velocity_ned_mps: Triple | None = None
    reference_position_ned_m: Triple | None = None
    reference_velocity_ned_mps: Triple | None = None
    roll_rad: Number | None = None
    pitch_rad: Number | None = None
    yaw_rad: Number | None = None
    tracking_error_m: Number | None = None
    velocity_error_mps: Pair | None = None
    detection_age_s: Number | None = None


class _Clause(_Record):
    name: str
    required: Number
    declared: Number
    margin: Number
    unit: str
    holds: bool


class _Margins(_Record):
    time_s: Time
    clauses: list[_Clause]


class _Monitor(_Record):
    measured: Number | None = None


class _Monitors(_Record):
    time_s: Time
    clearance: _Monitor = _Monitor()


class _Obstacle(_Record):
    id: str
    measured_ned_m: list[Pair] = []
    keep_out_ned_m: list[Pair] = []
    region_ned_m: list[Pair] = []
    lane_ned_m: list[Pair] = []
    boundary_ned_m: list[Pair] = []


class _Obstacles(_Record):
    time_s: Time
    obstacles: list[_Obstacle]


class _Plan(_Record):
    time_s: Time
    end_s: Time | None = None
    obstacle: str = ""
    kind: str = ""
    side: str | None = None
    plan_time_ms: Number | None = None
    path_ned_m: list[Triple] = []


class _Event(_Record):
    time_s: Time
    name: str = ""
    severity: str = ""
    text: str = ""
    data: dict[str, Any] = {}


class _Truth(_Record):
    time_unix_s: Time
    position_ned_m: Triple = []
    rpm: list[Number] = []
    clearance_m: Number | None = None
    clearance_min_m: Number | None = None
    collisions: int = 0


_SHAPES: Final[dict[str, type[_Record]]] = {
    "/state": _State,
    "/margins": _Margins,
    "/monitors": _Monitors,
    "/obstacles": _Obstacles,
    "/plan": _Plan,
    "/events": _Event,
    "/truth": _Truth,
}


def drop_malformed(log: Log) -> Log:
    """Return a log without the records that are not what they should be; it says how many."""
    messages, problems = dict(log.messages), list(log.problems)
    for topic, shape in _SHAPES.items():
        records = log.topic(topic)
        messages[topic] = list(_of_shape(records, shape))
        lost = len(records) - len(messages[topic])
        if lost:
            problems.append(f"{lost} of {len(records)} records of {topic} are not understood")
    return replace(log, messages=messages, problems=tuple(problems))


def _of_shape(records: list[Any], shape: type[_Record]) -> Iterator[dict[str, Any]]:
    for record in records:
        try:
            shape.model_validate(record)
        except ValidationError:
            continue
        yield record
