"""Writes ground truth to an MCAP file: channel ``/truth``, one JSON record per tick.

Its metadata ``field`` has the true obstacles, so that a report can draw what no sensor saw, and its
channel ``/truth/movers`` the movers, if there are any.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import Writer
from pydantic import TypeAdapter

from onboard.files.obstacle_field import ObstacleField
from onboard.files.record_schema import record_schema
from onboard.files.truth_record import TrueMover, TrueMoversRecord, TruthRecord
from sitl.environment.movers.movers import Movers
from sitl.environment.world import World
from sitl.plant.truth import VehicleTruth

TRUTH_LOG_RATE_HZ = 50
# Movers are drawn, not judged by: fewer records are enough.
_MOVERS_PERIOD_S = 0.1
# Larger fields are not written: no picture shows them.
_OBSTACLES_MAX = 20_000
# Without the two clearances: viewers refuse a topic with properties that may be null.
_SCHEMA = {
    "title": "clearway.truth",
    "type": "object",
    "properties": {
        "time_unix_s": {"type": "number"},
        "position_ned_m": {"type": "array", "items": {"type": "number"}},
        "velocity_ned_mps": {"type": "array", "items": {"type": "number"}},
        "acceleration_ned_mps2": {"type": "array", "items": {"type": "number"}},
        "attitude_quaternion": {"type": "array", "items": {"type": "number"}},
        "rpm": {"type": "array", "items": {"type": "number"}},
        "collisions": {"type": "integer"},
        "contacts_at_rest": {"type": "integer"},
    },
}

_ADAPTER = TypeAdapter(TruthRecord)
_MOVERS_ADAPTER = TypeAdapter(TrueMoversRecord)


class TruthLog:
    """Writes ground truth to a file; equal flights give equal bytes.

    Args:
        path: the file, overwritten.
        start_unix_s: Unix time at simulation time zero.
        field: the true obstacles; None leaves them out.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, start_unix_s: float, field: ObstacleField | None = None) -> None:
        self._start_unix_s = start_unix_s
        self._file = path.open("wb")
        # This writer also writes offsets of groups that are empty, which is not in the format.
        self._writer = Writer(self._file, use_summary_offsets=False)
        self._writer.start(profile="clearway", library="clearway")
        schema = self._writer.register_schema(
            "clearway.truth", "jsonschema", json.dumps(_SCHEMA).encode()
        )
        self._channel = self._writer.register_channel("/truth", "json", schema)
        self._movers_channel: int | None = None
        self._movers_due_s = -math.inf
        if field is not None and 0 < len(field) <= _OBSTACLES_MAX:
            self._writer.add_metadata("field", _described(field))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, truth: VehicleTruth, world: World, movers: Movers | None = None) -> None:
        """Append the state of this instant."""
        record = truth_record(truth, world, self._start_unix_s, movers)
        time_ns = round(record.time_unix_s * 1e9)
        self._writer.add_message(
            self._channel,
            log_time=time_ns,
            publish_time=time_ns,
            data=_ADAPTER.dump_json(record),
        )
        if movers is not None and movers.all and truth.time_s >= self._movers_due_s - 1e-9:
            self._movers_due_s = truth.time_s + _MOVERS_PERIOD_S
            self._write_movers(movers, record.time_unix_s, time_ns)

    def _write_movers(self, movers: Movers, time_unix_s: float, time_ns: int) -> None:
        if self._movers_channel is None:
            schema = record_schema(TrueMoversRecord, "clearway.true_movers")
            schema_id = self._writer.register_schema(
                "clearway.true_movers", "jsonschema", json.dumps(schema).encode()
            )
            self._movers_channel = self._writer.register_channel("/truth/movers", "json", schema_id)
        each = [
            TrueMover(
                id=mover.config.id,
                kind=mover.config.kind,
                position_ned_m=mover.position_ned_m,
                half_m=mover.half_m,
            )
            for mover in movers.all
        ]
        self._writer.add_message(
            self._movers_channel,
            log_time=time_ns,
            publish_time=time_ns,
            data=_MOVERS_ADAPTER.dump_json(TrueMoversRecord(time_unix_s=time_unix_s, movers=each)),
        )

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # untyped in its own source
        self._file.close()


def _described(field: ObstacleField) -> dict[str, str]:
    """Return the arrays of a field by name, as JSON."""
    arrays = {
        "center_ned_m": field.center_ned_m,
        "half_size_m": field.half_size_m,
        "yaw_rad": field.yaw_rad,
    }
    return {name: json.dumps(array.round(4).tolist()) for name, array in arrays.items()}


def truth_record(
    truth: VehicleTruth, world: World, start_unix_s: float, movers: Movers | None = None
) -> TruthRecord:
    """Return the ground truth of this instant; clearances are None in open space.

    A contact with a mover is a collision if the vehicle moves; at rest it is counted apart.
    """
    touched = 0 if movers is None else movers.contacts_moving
    return TruthRecord(
        time_unix_s=start_unix_s + truth.time_s,
        position_ned_m=truth.position_ned_m,
        velocity_ned_mps=truth.velocity_ned_mps,
        acceleration_ned_mps2=truth.acceleration_ned_mps2,
        attitude_quaternion=truth.attitude_quaternion,
        rpm=truth.rotor_speeds_rpm,
        clearance_m=_finite(world.clearance_m),
        clearance_min_m=_finite(world.clearance_min_m),
        collisions=world.collisions + touched,
        contacts_at_rest=0 if movers is None else movers.contacts_at_rest,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
