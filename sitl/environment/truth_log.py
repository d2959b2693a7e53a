"""Writes ground truth to an MCAP file: channel ``/truth``, one JSON record per tick.

Its metadata ``field`` has the true obstacles, so that a report can draw what no sensor saw.
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
from onboard.files.truth_record import TruthRecord
from sitl.environment.movers.movers import Movers
from sitl.environment.world import World
from sitl.plant.truth import VehicleTruth

TRUTH_LOG_RATE_HZ = 50
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
