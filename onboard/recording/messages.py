"""The records of a flight: one definition for the log, Zenoh, and every program that reads them.

Each record is a dataclass that pydantic turns into JSON and back.  A writer fills every field; a
reader of an older log finds the default where a field did not exist yet.  Only the fields without
a default are needed to make sense of a record.

All times are Unix times in seconds; positions are NED in metres, plan views are [north, east].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from pydantic import TypeAdapter

from onboard.events import EventData
from onboard.files.record_schema import (
    Number,
    Schema,
    UnixTime,
    Vector2,
    Vector3,
    record_schema,
)
from onboard.recording.mover_record import MoversRecord

# Four corners of a rectangle in order, the first side along the leg; or a line.
Outline = list[Vector2]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRecord:
    """What one detection source last sent.

    Attributes:
        age_s: since the newest stamp; None before the first frame.
        heard_age_s: since the last frame arrived.
        stamp_ahead_s: by how much its stamps are ahead of the service's clock.
        refused: messages of a sensor of the daemon's file that were dropped, by reason.
    """

    age_s: Number | None = None
    heard_age_s: Number | None = None
    stamp_ahead_s: Number | None = None
    refused: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class DropCounters:
    """How much input was dropped since the service started, by reason."""

    mavlink_garbage_bytes: int = 0
    mavlink_malformed: int = 0
    mavlink_foreign: int = 0
    mavlink_refused: int = 0
    frames_malformed: int = 0
    frames_unplaced: int = 0
    frames_dropped: int = 0
    clearances_malformed: int = 0
    missions_malformed: int = 0
    commands_refused: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class StateRecord:
    """The service in one tick.

    Attributes:
        time_s: of the tick.
        phase: of the automaton, as `onboard.guidance.phases.Phase` names it.
        state: of the automaton, finer than the phase (`onboard.guidance.phases.FlightState`).
        mode: of the autopilot, as its firmware names it.
        armed, airborne: as the autopilot reports; None while unknown.
        position_ned_m, velocity_ned_mps, roll_rad, pitch_rad, yaw_rad: newest pose.
        reference_position_ned_m, reference_velocity_ned_mps, reference_acceleration_ned_mps2: what
            is flown; None in STANDBY.
        tracking_error_m: horizontal distance from the reference.
        tracking_error_z_m: vertical distance from the reference.
        velocity_error_mps: along and across the leg.
        cruising: whether the vehicle cruises outside every region of influence.
        leg_heading_rad: direction of the leg, clockwise from north.
        detection_age_s: of the oldest sensor's newest frame.
        telemetry_age_s: of the newest pose.
        sensors: by source.
        position_doubt: why the position is not trusted; None while it is.
        link_doubt: why signatures keep the MAVLink link from working; None while they do not.
        mission: that was read from the vehicle, for people; empty where a file states it.
        mission_doubt: why it may not be the one to fly; None while it is.
        resumable: where a flight was left that may go on, while none is under way.
        progress: ``guaranteed`` or ``best_effort``, as this flight or the next is flown.
        cleared: whether a valid flight authorization is present, or none is required.
        log_ended: whether the service flies on without a log.
        virtual_obstacles: whether a sensor shows obstacles that are not there.
        obstacles_known: size of the map.
        free_cells: number of cells around the vehicle that have been seen free.
        rest_certified: whether the way to rest that is held is certified in the space seen free;
            None where none is held.
        rest_margin_m: by how much, in steps, the body could be larger there; None where no way is
            held, or where the way that is held is not certified.
        pauses: on this leg.
        goal_ned_m: where the mission ends, north and east.
        battery_charge: of the emptiest battery, from 0 to 1; None while unknown.
        dropped: input that was not used.
    """

    time_s: UnixTime
    phase: str = ""
    state: str = ""
    mode: str | None = None
    armed: bool | None = None
    airborne: bool | None = None
    position_ned_m: Vector3 | None = None
    velocity_ned_mps: Vector3 | None = None
    roll_rad: Number | None = None
    pitch_rad: Number | None = None
    yaw_rad: Number | None = None
    reference_position_ned_m: Vector3 | None = None
    reference_velocity_ned_mps: Vector3 | None = None
    reference_acceleration_ned_mps2: Vector3 | None = None
    tracking_error_m: Number | None = None
    tracking_error_z_m: Number | None = None
    velocity_error_mps: Vector2 | None = None
    cruising: bool | None = None
    leg_heading_rad: Number | None = None
    detection_age_s: Number | None = None
    telemetry_age_s: Number | None = None
    sensors: dict[str, SensorRecord] = field(default_factory=dict)
    position_doubt: str | None = None
    link_doubt: str | None = None
    mission: str = ""
    mission_doubt: str | None = None
    resumable: str | None = None
    progress: str = ""
    cleared: bool | None = None
    log_ended: bool = False
    virtual_obstacles: bool = False
    obstacles_known: int = 0
    free_cells: int = 0
    rest_certified: bool | None = None
    rest_margin_m: Number | None = None
    pauses: int = 0
    goal_ned_m: Vector2 | None = None
    battery_charge: Number | None = None
    dropped: DropCounters = field(default_factory=DropCounters)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClauseMargin:
    """One clause of the contract; ``margin`` is declared less required."""

    name: str
    required: Number
    declared: Number
    margin: Number
    unit: str
    holds: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Every clause of the contract as it is flown now; ``binding`` names the tightest."""

    time_s: UnixTime
    compliant: bool | None = None
    binding: str = ""
    clauses: list[ClauseMargin]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A monitored quantity: measured (None while unknown), limit (None: none stated), unit."""

    measured: Number | None = None
    limit: Number | None = None
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Monitors:
    """What is monitored in flight, at a rate for people.

    ``clearance`` is the distance of the vehicle's centre from the nearest known face, less the
    radius; its limit is a lower one, all others are upper ones.
    """

    time_s: UnixTime
    tracking_error: Reading = Reading()
    velocity_error_along: Reading = Reading()
    velocity_error_across: Reading = Reading()
    detection_age: Reading = Reading()
    telemetry_age: Reading = Reading()
    heartbeat_age: Reading = Reading()
    clearance: Reading = Reading()


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownObstacle:
    """One obstacle of the map, and what surrounds it, seen from above.

    Attributes:
        id: source and the source's own id.
        measured_ned_m, keep_out_ned_m, region_ned_m, lane_ned_m: corners of the measured box, of
            the box that the reference keeps out of, of the region of influence, of the lane.
        boundary_ned_m: points of the collision set boundary, from left to right.
        down_m: heights that it may fill, top and bottom in local NED, errors included; None for a
            face that is unknown, and for a pillar as a whole.
    """

    id: str
    measured_ned_m: Outline = field(default_factory=list)
    keep_out_ned_m: Outline = field(default_factory=list)
    region_ned_m: Outline = field(default_factory=list)
    lane_ned_m: Outline = field(default_factory=list)
    boundary_ned_m: Outline = field(default_factory=list)
    down_m: tuple[Number | None, Number | None] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacles:
    """The map, whenever it changes.

    Attributes:
        height_m: at which the leg is flown.
        obstacles: all that is in the way at that height.
        passed_over: what is known and is not, since it is lower or higher; without regions.
    """

    time_s: UnixTime
    height_m: Number | None = None
    obstacles: list[KnownObstacle]
    passed_over: list[KnownObstacle] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateRecord:
    """Whether a plan was certified, and which clauses failed."""

    valid: bool = False
    failures: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRecord:
    """A plan that is flown from now on.

    Attributes:
        time_s: of the tick that decided it.
        obstacle: id of the obstacle that it avoids.
        kind: ``qp``, ``vertex`` or ``brake``.
        side: on which the obstacle is passed.
        cost: of the objective; None where the kind has none.
        certificate: of the certifier.
        plan_time_ms: how long planning took; None in virtual time.
        start_s, end_s: of the trajectory.
        keep_out_ned_m, region_ned_m: corners, of the obstacle at that time; the region is where the
            plan may swerve.
        path_ned_m: points of the trajectory.
    """

    time_s: UnixTime
    obstacle: str = ""
    kind: str = ""
    side: str | None = None
    cost: Number | None = None
    certificate: CertificateRecord = CertificateRecord()
    plan_time_ms: Number | None = None
    start_s: UnixTime | None = None
    end_s: UnixTime | None = None
    keep_out_ned_m: Outline = field(default_factory=list)
    region_ned_m: Outline = field(default_factory=list)
    path_ned_m: list[Vector3] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenSpace:
    """The space that was seen free, and what is held in it; whenever it changes, at most 2 Hz.

    Runs of free cells, row by row: cell (i, j) reaches from (i, j) to (i + 1, j + 1) times
    ``cell_m``, along and across the leg, from the corner on.

    Attributes:
        height_m: at which the leg is flown.
        corner_ned_m: of the grid.
        heading_rad: of the leg, clockwise from north.
        cell_m: edge of a cell.
        row, column_from, column_to: of each run; ``column_to`` is the one after its last.
        way_to_rest_ned_m: points of the way to rest that is held; empty while none is.
        guide_ned_m: points of the way to try; empty where no way leads on.
        pause: why the vehicle pauses; None while it does not.
    """

    time_s: UnixTime
    height_m: Number | None = None
    corner_ned_m: Vector2 = (0.0, 0.0)
    heading_rad: Number = 0.0
    cell_m: Number = 0.0
    row: list[int] = field(default_factory=list)
    column_from: list[int] = field(default_factory=list)
    column_to: list[int] = field(default_factory=list)
    way_to_rest_ned_m: Outline = field(default_factory=list)
    guide_ned_m: Outline = field(default_factory=list)
    pause: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    """Something that happened; ``data`` are the numbers behind ``text``.

    ``name`` is a member of `onboard.events.EventName`; a log of another version may have others.
    """

    time_s: UnixTime
    name: str = ""
    severity: str = ""
    text: str = ""
    data: EventData = field(default_factory=EventData)


Record = (
    StateRecord
    | Margins
    | Monitors
    | Obstacles
    | PlanRecord
    | SeenSpace
    | MoversRecord
    | EventRecord
)

# Topic of the log, without its leading slash, by the type of its records.
TOPICS: Final[dict[type[Record], str]] = {
    StateRecord: "state",
    Margins: "margins",
    Monitors: "monitors",
    Obstacles: "obstacles",
    PlanRecord: "plan",
    SeenSpace: "seen_space",
    MoversRecord: "movers",
    EventRecord: "events",
}
# Key on Zenoh under ``clearway/<vehicle>/``, by the type of its records.
ZENOH_KEYS: Final[dict[type[Record], str]] = {
    StateRecord: "status",
    Margins: "margins",
    Monitors: "monitors",
    Obstacles: "map",
    PlanRecord: "plan",
    SeenSpace: "seen_space",
    MoversRecord: "movers",
    EventRecord: "events",
}
# Records that hold until the next one of their type.
LASTING: Final[tuple[type[Record], ...]] = (
    *(Margins, Obstacles, PlanRecord),
    *(SeenSpace, MoversRecord),
)


# Convert records from and to JSON.
ADAPTERS: Final[dict[type[Record], TypeAdapter[Any]]] = {
    record_type: TypeAdapter(record_type) for record_type in TOPICS
}
# Without the adapter's own overhead, which is half as much as its work: the log is written often.
_SERIALIZERS: Final = {record_type: each.serializer for record_type, each in ADAPTERS.items()}


def as_json(record: Record) -> bytes:
    """Return a record in UTF-8; a number that is not finite is null."""
    return _SERIALIZERS[type(record)].to_json(record)


def schema_of(record_type: type[Record]) -> Schema:
    """Return the JSON Schema of a record type, titled as the log announces it."""
    return record_schema(record_type, f"clearway.{TOPICS[record_type]}")
