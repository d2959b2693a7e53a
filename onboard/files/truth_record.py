"""The records of the simulation's ground truth: what ``truth.mcap`` holds of vehicle and movers."""

from __future__ import annotations

from dataclasses import dataclass, field

from onboard.files.record_schema import Number, UnixTime, Vector2, Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthRecord:
    """Where the simulated vehicle really is.

    Attributes:
        time_unix_s: Unix time of the record.
        position_ned_m: of the vehicle's centre.
        velocity_ned_mps: over ground.
        acceleration_ned_mps2: without gravity.
        attitude_quaternion: body from NED, w x y z.
        rpm: of each rotor.
        clearance_m: vehicle centre to the nearest face, less the radius; None in open space.
        clearance_min_m: smallest clearance so far; None in open space.
        collisions: how often contact with an obstacle has begun, or with a mover in motion.
        contacts_at_rest: how often a mover has touched the vehicle at rest.
    """

    time_unix_s: UnixTime
    position_ned_m: Vector3
    velocity_ned_mps: Vector3 | None = None
    acceleration_ned_mps2: Vector3 | None = None
    attitude_quaternion: tuple[Number, Number, Number, Number] | None = None
    rpm: tuple[Number, ...] = ()
    clearance_m: Number | None = None
    clearance_min_m: Number | None = None
    collisions: int = 0
    contacts_at_rest: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueMover:
    """Where one simulated mover really is, seen from above.

    Attributes:
        id: of the scenario.
        kind: its class.
        position_ned_m: of its centre, north and east.
        half_m: half of its edge, along north and east.
    """

    id: str
    kind: str = ""
    position_ned_m: Vector2
    half_m: Number = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueMoversRecord:
    """Where all simulated movers really are, ten times a second; without any there is none.

    Attributes:
        time_unix_s: Unix time of the record.
        movers: all of them.
    """

    time_unix_s: UnixTime
    movers: list[TrueMover] = field(default_factory=list)
