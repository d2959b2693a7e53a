"""Which sensors of a recording are read, and by which contract: of a daemon's file, or all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gcs_tools.console.errors import CommandError
from gcs_tools.replay.poses import POSE_TYPES
from gcs_tools.replay.recording import MAVLINK
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig, load_daemon_config
from onboard.files.mission_file import Mission
from onboard.files.sensor_sources import AnySource
from onboard.files.yaml_file import load_yaml, validate
from onboard.perception.sources.registry import TYPE_NAMES

# What `clearway init` begins with.
_BEGIN: Final = Path(__file__).parents[1] / "setup" / "files" / "px4"
AT_REST: Final = "none"
_UNCERTAINTY_M: Final = 0.1
# Of kinds that say less than the file would have to: a camera's or spinning lidar's view, a grid
# around the vehicle.
_STATED: Final[Mapping[str, Mapping[str, Any]]] = {
    "laserscan": {},
    "range": {},
    "pointcloud2": {"view_deg": (360.0, 60.0)},
    "detection3d": {"view_deg": (360.0, 60.0)},
}


@dataclass(frozen=True)
class Setup:
    """What a recording is read with.

    Attributes:
        config: the daemon's file; of its sources only those count that the recording may contain.
        contract, mission: that it names.
        pose_topic: whose messages tell where the body was; None for one at rest, or where raw
            MAVLink tells it.
        raw_mavlink: whether the recording is a flight log with the vehicle's own telemetry.
    """

    config: DaemonConfig
    contract: Contract
    mission: Mission
    pose_topic: str | None
    raw_mavlink: bool = False

    @property
    def sources(self) -> tuple[AnySource, ...]:
        """The sensors."""
        return self.config.sources


def setup_of(
    topics: Mapping[str, str], config: Path | None, range_m: float, pose_topic: str | None
) -> Setup:
    """Return what to read a recording with.

    Args:
        topics: of the recording, with their types.
        config: a daemon's file; None for every topic that can be read.
        range_m: of the sensors, where no file states it.
        pose_topic: as given; None to choose one.

    Raises:
        FileError: a file cannot be used.
        CommandError: the recording has no topic of a sensor, or not the topic of poses.
    """
    if config is None:
        contract, mission = _BEGIN / "contract.yaml", _BEGIN / "mission.yaml"
        document = {
            "contract": str(contract),
            "mission": str(mission),
            "sources": list(_sources(topics, range_m)),
        }
        daemon = validate(document, DaemonConfig, source="the topics of the recording")
    else:
        daemon = load_daemon_config(config)
        if daemon.mission_from_vehicle:
            raise CommandError(f"{config}: mission = from_vehicle: a replay needs a mission file")
        contract, mission = config.parent / daemon.contract, config.parent / daemon.mission
    if not daemon.sources:
        listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items())) or "none"
        where = "the recording has" if config is None else f"{config}: has no `sources`; topics:"
        raise CommandError(f"{where} no topic of a sensor that can be read: {listed}")
    return Setup(
        daemon,
        load_yaml(contract, Contract),
        load_yaml(mission, Mission),
        _pose_topic(topics, pose_topic),
        raw_mavlink=MAVLINK in topics.values(),
    )


def _sources(topics: Mapping[str, str], range_m: float) -> Iterator[dict[str, Any]]:
    """Yield the keys of a source for each topic that a sensor may publish."""
    kinds = {TYPE_NAMES[kind]: kind for kind in _STATED}
    for topic, type_name in sorted(topics.items()):
        kind = kinds.get(type_name)
        if kind is not None:
            yield {
                "kind": kind,
                "name": topic.strip("/").replace("/", "_")[:64],
                "topic": topic,
                "range_m": range_m,
                "uncertainty_m": _UNCERTAINTY_M,
                **_STATED[kind],
            }
    if MAVLINK in topics.values():
        stated = {"range_m": range_m, "uncertainty_m": _UNCERTAINTY_M}
        yield {"kind": "obstacle_distance", "name": "obstacle_distance", **stated}


def _pose_topic(topics: Mapping[str, str], given: str | None) -> str | None:
    if given == AT_REST:
        return None
    if given is not None:
        kind = topics.get(given)
        if kind not in POSE_TYPES:
            has = "is not in the recording" if kind is None else f"carries {kind}"
            usable = sorted(name for name, each in topics.items() if each in POSE_TYPES)
            listed = ", ".join((*usable, AT_REST))
            raise CommandError(f"--pose {given}: {has}; expected one of: {listed}")
        return given
    if MAVLINK in topics.values():
        return None
    for kind in POSE_TYPES:
        # Transforms that stand still tell no pose.
        names = sorted(
            name for name, each in topics.items() if each == kind and not name.endswith("_static")
        )
        if names:
            return names[0]
    return None
