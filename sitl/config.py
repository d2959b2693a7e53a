"""What ``clearway-sitl --config F`` reads: every key has a default that flies."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from onboard.files.yaml_file import FileError, FileModel, load_yaml
from onboard.files.zenoh_endpoints import Endpoints, ZenohEndpoints
from sitl.environment.movers.config import MoverConfig
from sitl.environment.sensor import SensorConfig
from sitl.plant.battery import BatteryConfig
from sitl.plant.estimator import EstimatorProfile
from sitl.plant.multirotor import MultirotorParameters, quadrotor
from sitl.plant.wind import WindConfig

_KEY: Final = r"[0-9a-fA-F]{64}"
SigningKey = Annotated[str, Field(pattern=f"^{_KEY}$")]
FilePath = Annotated[Path, Field(strict=False)]
Positive = Annotated[float, Field(gt=0.0)]
VehicleName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]


class MultirotorConfig(FileModel):
    """The vehicle's body."""

    mass_kg: Positive = 1.5
    thrust_to_weight: Annotated[float, Field(gt=1.0)] = 2.0
    radius_m: Positive = 0.30
    half_height_m: Positive = 0.08
    arm_length_m: Positive = 0.22
    inertia_kgm2: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)] = (
        0.022,
        0.022,
        0.040,
    )
    rotor_time_constant_s: Annotated[float, Field(ge=0.005)] = 0.035
    rotor_speed_max_rpm: Positive = 9000.0
    rotor_drag_n_per_mps: Annotated[float, Field(ge=0.0)] = 0.15
    drag_area_m2: Annotated[float, Field(ge=0.0)] = 0.015

    def parameters(self) -> MultirotorParameters:
        """Return the physical model's parameters."""
        return quadrotor(
            mass_kg=self.mass_kg,
            thrust_to_weight=self.thrust_to_weight,
            arm_length_m=self.arm_length_m,
            inertia_kgm2=self.inertia_kgm2,
            rotor_time_constant_s=self.rotor_time_constant_s,
            rotor_speed_max_rpm=self.rotor_speed_max_rpm,
            rotor_drag_n_per_mps=self.rotor_drag_n_per_mps,
            drag_area_m2=self.drag_area_m2,
        )


class StartConfig(FileModel):
    """Where the vehicle is when the simulation begins.

    Attributes:
        position_ned_m: above the ground (negative down) it starts armed, hovering in hold.
    """

    position_ned_m: Annotated[tuple[float, float, float], Field(strict=False)] = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @model_validator(mode="after")
    def _require_above_ground(self) -> StartConfig:
        if self.position_ned_m[2] > 0.0:
            raise ValueError("the vehicle cannot start below the ground (down > 0 m)")
        return self


class HomeConfig(FileModel):
    """Geographic position of the local NED origin, on the ground."""

    latitude_deg: Annotated[float, Field(ge=-85.0, le=85.0)] = 47.397742
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 8.545594
    altitude_m: float = 488.0


class TrackingConfig(FileModel):
    """How the plant deviates from its reference.

    Attributes:
        toward_obstacle: pin the tracking error toward the nearest obstacle.
        error_m: its size; null in a scenario: the contract's tracking error.
        kinematic: fly the adversary's plant in place of rotors and controller
            (`sitl.plant.kinematic`).
        velocity_error_mps: of that plant, along the nose, and across it toward the obstacle.
        seen_late_s: the service judges the position by telemetry that is this much older than it
            takes it for; the pinned error leaves room for that, so that none is reported.
    """

    toward_obstacle: bool = False
    error_m: Annotated[float, Field(ge=0.0)] | None = None
    kinematic: bool = False
    velocity_error_mps: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)
    seen_late_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class EstimatorConfig(FileModel):
    """Greatest errors of the estimate; null leaves the value of ``realism``.

    Attributes:
        position_m, velocity_mps: along each horizontal axis.
        height_m: of the height.
        heading_deg: of the heading.
        at_bound: errors reach their bounds (`sitl.plant.estimator.EstimatorProfile`).
    """

    position_m: Annotated[float, Field(ge=0.0)] | None = None
    velocity_mps: Annotated[float, Field(ge=0.0)] | None = None
    height_m: Annotated[float, Field(ge=0.0)] | None = None
    heading_deg: Annotated[float, Field(ge=0.0, le=180.0)] | None = None
    at_bound: bool | None = None

    def applied_to(self, profile: EstimatorProfile) -> EstimatorProfile:
        """Return a profile with what is stated here."""
        stated = self.model_dump(exclude_none=True)
        heading_deg = stated.pop("heading_deg", None)
        if heading_deg is not None:
            stated["heading_rad"] = math.radians(heading_deg)
        return replace(profile, **stated)


class VehicleConfig(FileModel):
    """Body, autopilot and surroundings of one simulated vehicle.

    Attributes:
        system_id: MAVLink system id.
        flavour: which autopilot it behaves like.
        parameters: autopilot parameters that differ from the defaults, by the flavour's names.
        signing_passphrase: makes the key that signs every message; only messages signed alike
            are accepted.
        signing_key_hex: that key itself, in place of a passphrase: 64 hexadecimal digits.
        realism: ``field`` as measured on real autopilots, or ``ideal``: exact estimates and echoes.
        estimator: how the autopilot's estimate deviates from the truth.
        tracking: how the plant deviates from its reference.
        movers: what moves around it; sensors with message_version 2 report them.
        physics_rate_hz: integration steps per second, a multiple of the vehicle's 100 ticks.
    """

    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    flavour: Literal["px4", "ardupilot"] = "px4"
    multirotor: MultirotorConfig = MultirotorConfig()
    battery: BatteryConfig = BatteryConfig()
    wind: WindConfig = WindConfig()
    start: StartConfig = StartConfig()
    home: HomeConfig = HomeConfig()
    parameters: dict[str, float] = Field(default_factory=dict)
    signing_passphrase: Annotated[str, Field(min_length=1)] | None = None
    signing_key_hex: SigningKey | None = Field(None, repr=False)
    realism: Literal["field", "ideal"] = "field"
    estimator: EstimatorConfig = EstimatorConfig()
    tracking: TrackingConfig = TrackingConfig()
    movers: Annotated[tuple[MoverConfig, ...], Field(strict=False)] = ()
    physics_rate_hz: Annotated[int, Field(ge=400, le=4000, multiple_of=100)] = 400

    @model_validator(mode="after")
    def _has_one_key(self) -> Self:
        if self.signing_key_hex is not None and self.signing_passphrase is not None:
            raise ValueError("signing_passphrase and signing_key_hex: state one of them")
        return self


class SitlEndpoints(ZenohEndpoints):
    """How the simulator joins Zenoh; by default it listens where the daemon connects."""

    listen: Endpoints = ("tcp/127.0.0.1:7447",)


class FleetMember(FileModel):
    """One more vehicle: the keys in which it differs from the file's own."""

    vehicle: VehicleName
    system_id: Annotated[int, Field(ge=1, le=255)]
    mavlink: Annotated[tuple[str, ...], Field(strict=False)]
    start: StartConfig = StartConfig()


class SitlConfig(VehicleConfig):
    """The whole file.

    Attributes:
        vehicle: name in Zenoh keys, ``clearway/<vehicle>/...``.
        mavlink: connection URLs, one link each.
        signing_key_file: file of signing_key_hex; the daemon may name the same one.
        field: obstacle file; null for open space.
        truth_log: MCAP file to write ground truth to; further vehicles add their name to it.
        speed_factor: seconds of simulation in one of real time; time stamps follow the simulation.
        fleet: further vehicles in the same process, alike but for the keys given there; they do
            not see one another.
    """

    vehicle: VehicleName = "vehicle"
    mavlink: Annotated[tuple[str, ...], Field(strict=False)] = (
        "udpout://127.0.0.1:14540",
        "udpout://127.0.0.1:14550",
    )
    zenoh: SitlEndpoints = SitlEndpoints()
    sensors: Annotated[tuple[SensorConfig, ...], Field(strict=False)] = (SensorConfig(),)
    signing_key_file: FilePath | None = None
    field: FilePath | None = None
    seed: int = 0
    truth_log: FilePath | None = None
    speed_factor: Annotated[float, Field(gt=0.0, le=50.0)] = 1.0
    fleet: Annotated[tuple[FleetMember, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _require_tracking_error(self) -> SitlConfig:
        if self.tracking.toward_obstacle and self.tracking.error_m is None:
            raise ValueError("tracking.toward_obstacle needs tracking.error_m [m]")
        return self

    @model_validator(mode="after")
    def _require_distinct_sources(self) -> SitlConfig:
        sources = [sensor.source for sensor in self.sensors]
        if len(set(sources)) < len(sources):
            raise ValueError("two sensors have the same source name")
        return self

    @model_validator(mode="after")
    def _require_distinct_vehicles(self) -> SitlConfig:
        for key in ("vehicle", "system_id"):
            values = [getattr(one, key) for one in (self, *self.fleet)]
            if len(set(values)) < len(values):
                raise ValueError(f"two vehicles have the same {key}")
        return self

    def each(self) -> tuple[SitlConfig, ...]:
        """Return one configuration for each vehicle, the file's own first."""
        return (self.model_copy(update={"fleet": ()}), *map(self._member, self.fleet))

    def _member(self, member: FleetMember) -> SitlConfig:
        update: dict[str, Any] = {key: getattr(member, key) for key in type(member).model_fields}
        if self.truth_log is not None:
            name = f"{self.truth_log.stem}-{member.vehicle}"
            update["truth_log"] = self.truth_log.with_stem(name)
        return self.model_copy(update={**update, "fleet": ()})


def load_sitl_config(path: Path) -> SitlConfig:
    """Read a configuration file; the paths in it are relative to the file.

    Raises:
        FileError: names the file, key, value and unit.
    """
    config = load_yaml(path, SitlConfig)
    named = {"field": config.field, "truth_log": config.truth_log}
    absolute: dict[str, Any] = {
        key: path.parent / name for key, name in named.items() if name is not None
    }
    absolute["zenoh"] = config.zenoh.relative_to(path.parent)
    if config.signing_key_file is not None:
        if config.signing_passphrase is not None or config.signing_key_hex is not None:
            raise FileError(f"{path}: signing_key_file and another key of signing: state one")
        absolute["signing_key_hex"] = _key_digits(path.parent / config.signing_key_file)
    return config.model_copy(update=absolute)


def _key_digits(path: Path) -> str:
    """Read the digits of a key.

    Raises:
        FileError: the file cannot be read, or is not a key; the message does not tell its content.
    """
    try:
        digits = path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeError) as error:
        raise FileError(f"{path}: cannot be read as a key: {error.__class__.__name__}") from error
    if re.fullmatch(_KEY, digits) is None:
        raise FileError(f"{path}: not a key (expected one line of 64 hexadecimal digits)")
    return digits
