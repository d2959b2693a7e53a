"""Faults as a scenario file states them: kind, window and amount; what each kind means.

To add a fault, add its name to the group of kinds that it belongs to and one entry to ``FAULTS``,
then one entry to the table of the module that applies it (see `Target`).  A test checks that every
kind has both.
"""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from onboard.files.yaml_file import FileModel
from onboard.guidance.phases import Phase

DetectionKind = Literal[
    "detections_off",
    "detections_stuck",
    "detections_garbage",
    "detections_nan",
    "detections_late",
    "detections_intermittent",
    "detections_slow",
    "detections_short_range",
    "detections_narrow_view",
    "detections_uncertain",
    "detections_shifted",
    "detections_oversized",
    "detections_wrong_units",
    "detections_ghost",
    "detections_renamed",
    "detections_hidden",
    "detections_split",
    "detections_merged",
    "detections_swapped",
    "detections_wrong_frame",
    "detections_out_of_order",
    "sensor_clock_ahead",
    "sensor_clock_skewed",
]
LinkKind = Literal[
    "telemetry_lost",
    "telemetry_corrupted",
    "heartbeats_lost",
    "setpoints_lost",
    "link_partitioned",
    "link_lossy",
    "link_duplicating",
    "link_reordering",
    "link_corrupting",
    "second_commander",
]
VehicleKind = Literal[
    "position_reset",
    "position_misreported",
    "height_reset",
    "attitude_stuck",
    "gps_lost",
    "mode_rejected",
    "parameter_changed",
    "gust",
    "thrust_lost",
    "attitude_slow",
    "motor_failed",
]
ProcessKind = Literal["tick_stall", "solver_limited", "daemon_dead", "disk_full"]
OperatorKind = Literal["operator_takes_over", "mission_changed", "operator_resumes"]
# The order is that of campaigns, which draw kinds from it by seed.
FaultKind = Literal[DetectionKind, LinkKind, VehicleKind, ProcessKind, OperatorKind]


class Target(Enum):
    """What a fault changes; each target has one module that applies its faults."""

    DETECTIONS = "detections"
    MAVLINK = "mavlink"
    VEHICLE = "vehicle"
    SERVICE = "service"


class Meaning(NamedTuple):
    """What one kind of fault does.

    Attributes:
        effect: one clause for the schema's description.
        targets: what it changes.
        amount: the default; meaningless where ``unit`` is empty.
        unit: unit of the amount; empty for kinds that have none.
    """

    effect: str
    targets: tuple[Target, ...]
    amount: float = 0.0
    unit: str = ""


_DETECTIONS: Final = (Target.DETECTIONS,)
_MAVLINK: Final = (Target.MAVLINK,)
_VEHICLE: Final = (Target.VEHICLE,)
_SERVICE: Final = (Target.SERVICE,)
_BOTH_WAYS: Final = "share of datagrams, either way"

FAULTS: Final[dict[FaultKind, Meaning]] = {
    "detections_off": Meaning("no frame arrives", _DETECTIONS),
    "detections_stuck": Meaning("the same frame arrives again and again", _DETECTIONS),
    "detections_garbage": Meaning("random bytes arrive instead of frames", _DETECTIONS),
    "detections_nan": Meaning("the declared range is NaN", _DETECTIONS),
    "detections_late": Meaning("frames arrive late", _DETECTIONS, 0.25, "seconds"),
    "detections_intermittent": Meaning("frames are lost", _DETECTIONS, 0.5, "share of frames"),
    "detections_slow": Meaning(
        "one frame in so many arrives", _DETECTIONS, 4.0, "frames, whole number"
    ),
    "detections_short_range": Meaning("the declared range shrinks", _DETECTIONS, 5.0, "metres"),
    "detections_narrow_view": Meaning(
        "the declared field of view shrinks", _DETECTIONS, 60.0, "degrees"
    ),
    "detections_uncertain": Meaning("the declared uncertainty grows", _DETECTIONS, 0.15, "metres"),
    "detections_shifted": Meaning("boxes are misplaced, undeclared", _DETECTIONS, 0.03, "metres"),
    "detections_oversized": Meaning("boxes grow", _DETECTIONS, 3.0, "factor on their size"),
    "detections_wrong_units": Meaning(
        "lengths are in another unit, by default millimetres", _DETECTIONS, 0.001, "factor"
    ),
    "detections_ghost": Meaning(
        "an obstacle that does not exist is reported ahead", _DETECTIONS, 9.0, "metres ahead"
    ),
    "detections_renamed": Meaning("identifiers change every five frames", _DETECTIONS),
    "detections_hidden": Meaning(
        "obstacles are first reported within this distance, undeclared", _DETECTIONS, 6.0, "metres"
    ),
    "detections_split": Meaning("every box is reported as two halves", _DETECTIONS),
    "detections_merged": Meaning("all boxes are reported as one", _DETECTIONS),
    "detections_swapped": Meaning("obstacles exchange their identifiers", _DETECTIONS),
    "detections_wrong_frame": Meaning("the declared coordinate frame is wrong", _DETECTIONS),
    "detections_out_of_order": Meaning(
        "frames arrive after the next one", _DETECTIONS, 0.5, "share of frames"
    ),
    "sensor_clock_ahead": Meaning("the sensor's clock is ahead", _DETECTIONS, 5.0, "seconds"),
    "sensor_clock_skewed": Meaning(
        "the sensor's clock runs fast", _DETECTIONS, 0.05, "seconds per second"
    ),
    "telemetry_lost": Meaning("the service receives no telemetry", _MAVLINK),
    "telemetry_corrupted": Meaning(
        "one bit of the telemetry changes", _MAVLINK, 0.2, "share of datagrams"
    ),
    "heartbeats_lost": Meaning("the service receives no heartbeats", _MAVLINK),
    "setpoints_lost": Meaning("the vehicle receives no setpoints", _MAVLINK),
    "link_partitioned": Meaning("nothing passes the link, either way", _MAVLINK),
    "link_lossy": Meaning("datagrams are lost", _MAVLINK, 0.3, _BOTH_WAYS),
    "link_duplicating": Meaning("datagrams arrive twice", _MAVLINK, 0.3, _BOTH_WAYS),
    "link_reordering": Meaning("later datagrams may overtake", _MAVLINK, 0.3, _BOTH_WAYS),
    "link_corrupting": Meaning("one byte of a datagram changes", _MAVLINK, 0.2, _BOTH_WAYS),
    "second_commander": Meaning("another companion sends setpoints as well", _MAVLINK),
    "position_reset": Meaning(
        "the estimate that is reported and flown by jumps to the east",
        (Target.MAVLINK, Target.DETECTIONS),
        3.0,
        "metres",
    ),
    "position_misreported": Meaning(
        "the reported position drifts to the east at 0.5 m/s, unlike the one that is flown by",
        _MAVLINK,
        0.3,
        "metres",
    ),
    "height_reset": Meaning(
        "the estimate that is reported and flown by jumps upwards", _VEHICLE, 4.0, "metres"
    ),
    "attitude_stuck": Meaning("the reported attitude is level", _MAVLINK),
    "gps_lost": Meaning("the autopilot loses GPS", _VEHICLE),
    "mode_rejected": Meaning("the autopilot refuses every change of mode", _VEHICLE),
    "parameter_changed": Meaning(
        "the autopilot's tilt limit changes in flight", _VEHICLE, 20.0, "degrees"
    ),
    "gust": Meaning("a gust blows to the east for 3 s", _VEHICLE, 6.0, "metres per second"),
    "thrust_lost": Meaning("rotors are slower than commanded", _VEHICLE, 0.9, "share of speed"),
    "attitude_slow": Meaning("the attitude feedback is low", _VEHICLE, 3.0, "1/s"),
    "motor_failed": Meaning("the first rotor stops", _VEHICLE),
    "tick_stall": Meaning("the service misses its ticks", _SERVICE),
    "solver_limited": Meaning("the QP solver reaches its iteration limit", _SERVICE),
    "daemon_dead": Meaning("the service dies; it starts again when the fault ends", _SERVICE),
    "disk_full": Meaning("the service cannot write its log", _SERVICE),
    "operator_takes_over": Meaning("the operator switches to hold", _SERVICE),
    "mission_changed": Meaning(
        "the operator sends a mission whose remaining leg turns right", _SERVICE, 30.0, "degrees"
    ),
    "operator_resumes": Meaning(
        "the operator waits in a hold, and commands to resume once", _SERVICE
    ),
}


def _described() -> str:
    """Return one line for each kind: effect, unit and default amount."""
    lines = []
    for kind, meaning in FAULTS.items():
        amount = f" (amount: {meaning.unit}, {meaning.amount:g})" if meaning.unit else ""
        lines.append(f"- {kind}: {meaning.effect}{amount}")
    return "What happens:\n" + "\n".join(lines)


class Fault(FileModel):
    """One fault.

    Attributes:
        kind: what happens; see ``FAULTS``.
        start_s: begins this long after the simulation, or after the phase, began.
        duration_s: lasts this long; to the end of the flight when null.
        phase: count from the service's entry into this phase instead.
        entry: from which entry into it, the first being 1.
        amount: severity, in the kind's unit; null for the kind's default.
    """

    kind: Annotated[FaultKind, Field(description=_described())]
    start_s: Annotated[float, Field(ge=0.0)] = 0.0
    duration_s: Annotated[float, Field(gt=0.0)] | None = None
    phase: Annotated[Phase, Field(strict=False)] | None = None
    entry: Annotated[int, Field(ge=1)] = 1
    amount: float | None = None

    @property
    def value(self) -> float:
        """The amount, or the kind's default."""
        return FAULTS[self.kind].amount if self.amount is None else self.amount
