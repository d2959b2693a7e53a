"""The configuration of the daemon (`clearway-onboard --config F`): frozen and validated."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, field_validator, model_validator

from onboard.files.contract_file import InputSet, NonNegative, Positive
from onboard.files.mission_file import EnergyBudget
from onboard.files.sensor_sources import (
    AnySource,
    DistanceSensorSource,
    FieldFileSource,
    ObstacleDistanceSource,
    Topic,
    excludes_real_sensors,
    with_files_in,
)
from onboard.files.yaml_file import FileModel, load_yaml, refuse_renamed_keys
from onboard.files.zenoh_endpoints import ZenohEndpoints

FilePath = Annotated[Path, Field(strict=False)]


PORT_MAX: Final = 65_535
Rate = Annotated[float, Field(gt=0.0, le=10.0)]


class ObstacleDistanceOutput(FileModel):
    """MAVLink OBSTACLE_DISTANCE, which ground stations draw.

    An autopilot takes it for a sensor: see docs/sensors.md before it goes through one.
    """

    url: str | None = Field(
        None, description="link to a ground station, such as udpout://192.168.1.20:14550"
    )
    through_autopilot: bool = Field(
        False, description="send it on the vehicle's link instead; its own avoidance may act on it"
    )
    rate_hz: Rate = 2.0

    @model_validator(mode="after")
    def _goes_one_way(self) -> ObstacleDistanceOutput:
        if (self.url is None) is not self.through_autopilot:
            raise ValueError("expected either url or through_autopilot: true")
        return self


class MarkerOutput(FileModel):
    """visualization_msgs/MarkerArray for RViz and Foxglove, over Zenoh.

    Attributes:
        frame_id: of the boxes: east, north, up from the origin of the autopilot's local frame.
    """

    topic: Topic = "/clearway/obstacles"
    middleware: Literal["rmw_zenoh", "zenoh-bridge-ros2dds"] = "rmw_zenoh"
    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    frame_id: Annotated[str, Field(min_length=1, max_length=64)] = "map"
    rate_hz: Rate = 2.0


class ObstacleOutputs(FileModel):
    """Both are off unless stated."""

    obstacle_distance: ObstacleDistanceOutput | None = None
    markers: MarkerOutput | None = None


class MetricsOutput(FileModel):
    """The daemon's metrics for Prometheus, read over HTTP without a password."""

    listen: str = Field("127.0.0.1:9464", description="HOST:PORT; 0.0.0.0 lets others read, too")

    @field_validator("listen")
    @classmethod
    def _is_host_and_port(cls, listen: str) -> str:
        host, _, port = listen.rpartition(":")
        number = int(port) if port.isascii() and port.isdecimal() and len(port) <= 5 else 0
        bracketed = host.startswith("[") and host.endswith("]")
        if not host or not host.isprintable() or (":" in host and not bracketed):
            raise ValueError(f"{listen!r}: expected HOST:PORT, such as 127.0.0.1:9464")
        if not 1 <= number <= PORT_MAX:
            raise ValueError(f"{listen!r}: the port is not a number from 1 to {PORT_MAX}")
        return listen

    @property
    def address(self) -> tuple[str, int]:
        """Host, without brackets, and port."""
        host, _, port = self.listen.rpartition(":")
        return host.strip("[]"), int(port)


class SigningConfig(FileModel):
    """MAVLink 2 signing of the daemon's link: what is not signed alike is refused."""

    key_file: FilePath = Field(description="one line of 64 hexadecimal digits; mode 0600 or 0640")
    link_id: Annotated[int, Field(ge=0, le=255)] = Field(
        0, description="of this link; another one for each program that signs as this component"
    )


class MavlinkLink(FileModel):
    """The daemon's MAVLink link."""

    url: str = Field("udpin://127.0.0.1:14540", description="as in MAVSDK")
    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    telemetry_timeout_s: Positive = Field(0.5, description="telemetry older than this is ignored")
    signing: SigningConfig | None = Field(
        None, description="sign what is sent, and refuse what is not signed; null: neither"
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_renamed_keys(cls, data: Any) -> Any:
        return refuse_renamed_keys(data, {"stale_after_s": "telemetry_timeout_s"})


class FleetSettings(FileModel):
    """The fleet that the vehicle flies in, by leave of the others."""

    file: FilePath = Field(description="fleet.yaml, the same for all vehicles of the fleet")
    name: Annotated[str, Field(min_length=1, max_length=32)] = Field(
        description="of this vehicle in it"
    )
    key_file: FilePath | None = Field(
        None, description="of the whole fleet, 64 hexadecimal digits, mode 0600 or 0640; null: none"
    )


# In place of a mission file: what the autopilot keeps on board.
FROM_VEHICLE: Final = "from_vehicle"


class VehicleMission(FileModel):
    """What a mission on board does not state; the keys are those of a mission file."""

    altitude_m: Positive | None = Field(
        None, description="fly all legs at this height above the local origin; null: the items' own"
    )
    target_half_width_m: Positive = 5.0
    corridor_half_width_m: Positive | None = None
    climb_max_m: NonNegative = 0.0
    heading: Literal["leg", "path"] = "leg"
    start_clear_m: Positive | None = None
    start_clear_of_movers_m: Positive | None = None
    on_end: Literal["hover", "return"] = "hover"
    energy: EnergyBudget | None = None


class DaemonConfig(FileModel):
    """The daemon's configuration; paths are relative to the file."""

    vehicle: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] = "vehicle"
    contract: FilePath
    mission: FilePath = Field(
        description="mission file; from_vehicle: the mission and the geofence on board"
    )
    vehicle_mission: VehicleMission | None = Field(
        None, description="with mission: from_vehicle, what that mission does not state"
    )
    geofence: FilePath | None = Field(
        None, description="areas that every flight stays within; null: none of ours"
    )
    fleet: FleetSettings | None = Field(
        None, description="fly only by leave of the other vehicles of a fleet; null: of no fleet"
    )
    input_set: InputSet = "inner"
    mavlink: MavlinkLink = MavlinkLink(
        url="udpin://127.0.0.1:14540", system_id=1, telemetry_timeout_s=0.5, signing=None
    )
    zenoh: ZenohEndpoints = ZenohEndpoints(connect=(), listen=())
    sources: Annotated[tuple[AnySource, ...], Field(strict=False)] = Field(
        (), description="sensors besides those that publish detections as JSON"
    )
    outputs: ObstacleOutputs = Field(
        ObstacleOutputs(obstacle_distance=None, markers=None),
        description="where the obstacles in use are shown besides",
    )
    metrics: MetricsOutput | None = Field(
        None, description="serve metrics for Prometheus over HTTP; null: none"
    )
    log_directory: FilePath | None = Field(
        None,
        description="one log a flight, named by date; null: flights beside this file, or in the "
        "state directory of systemd",
    )
    log_quota_mb: Annotated[int, Field(ge=200)] | None = Field(
        None, description="of log_directory: the oldest flights are removed beyond it; null: none"
    )
    log_file: FilePath | None = Field(
        None,
        description="one log for all flights, in place of log_directory; a number is added where "
        "it exists",
    )
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = Field("text", description="of the daemon's messages")
    accept_mission_updates: bool = Field(
        False,
        description="fly a mission received on the Zenoh key `mission` instead, even in flight",
    )
    operator_key_file: FilePath | None = Field(
        None,
        description="clearances, missions and resuming only if signed with this key; 64 "
        "hexadecimal digits, mode 0600 or 0640; null: taken from every process on the bus",
    )
    fly_outside_contract: bool = Field(
        False, description="leave STANDBY although the contract does not comply; for tests"
    )
    require_preflight: bool = Field(
        False, description="leave STANDBY only with a recent, passed live check of this contract"
    )
    preflight_age_max_s: Positive = Field(
        900.0, description="a live check older than this does not count"
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_renamed_keys(cls, data: Any) -> Any:
        return refuse_renamed_keys(data, {"mission_changes": "accept_mission_updates"})

    @field_validator("sources")
    @classmethod
    def _each_has_a_name(cls, sources: tuple[AnySource, ...]) -> tuple[AnySource, ...]:
        names = [source.name for source in sources]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{names.count(name)} sensors are called '{name}'")
        return sources

    @property
    def mission_from_vehicle(self) -> bool:
        """Whether the mission is read from the autopilot, rather than from a file."""
        return str(self.mission) == FROM_VEHICLE

    @model_validator(mode="after")
    def _mission_is_stated_once(self) -> DaemonConfig:
        if self.vehicle_mission is not None and not self.mission_from_vehicle:
            raise ValueError(
                f"vehicle_mission: belongs to mission: {FROM_VEHICLE}, but mission = {self.mission}"
            )
        return self

    @model_validator(mode="after")
    def _virtual_obstacles_are_alone(self) -> DaemonConfig:
        real = [each.name for each in self.sources if not isinstance(each, FieldFileSource)]
        if real and excludes_real_sensors(self.sources):
            raise ValueError(
                f"sources: virtual obstacles (field_file) beside the real sensor '{real[0]}': "
                "remove one of them, or state beside_real_sensors: true"
            )
        return self

    @model_validator(mode="after")
    def _reads_no_output_of_its_own(self) -> DaemonConfig:
        shown = self.outputs.obstacle_distance
        ranging = ObstacleDistanceSource | DistanceSensorSource
        reading = [each.name for each in self.sources if isinstance(each, ranging)]
        if shown is not None and shown.through_autopilot and reading:
            raise ValueError(
                "outputs.obstacle_distance.through_autopilot: the sensor "
                f"'{reading[0]}' would read it back"
            )
        return self


def load_daemon_config(path: Path) -> DaemonConfig:
    """Read a daemon's file; the files of its sensors are then found from anywhere.

    Raises:
        FileError: the file cannot be used.
    """
    config = load_yaml(path, DaemonConfig)
    return config.model_copy(update={"sources": with_files_in(path.parent, config.sources)})


def log_directory(base: Path, config: DaemonConfig, environment: Mapping[str, str]) -> Path:
    """Return the directory of flight logs.

    Args:
        base: directory of the configuration.
        config: the configuration.
        environment: of the daemon; a service's STATE_DIRECTORY is where it may write.
    """
    if config.log_directory is not None:
        return base / config.log_directory
    return state_directory(base, environment) / "flights"


def state_directory(base: Path, environment: Mapping[str, str]) -> Path:
    """Return the directory of what outlives the daemon.

    Args:
        base: directory of the configuration.
        environment: of the daemon; a service's STATE_DIRECTORY is where it may write.
    """
    # Several directories are separated by colons.
    state, _, _ = environment.get("STATE_DIRECTORY", "").partition(":")
    return Path(state) if state else base
