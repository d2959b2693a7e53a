"""Scenario file: what one flight against the bundled SITL needs, and its expected outcome."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, Discriminator, Field, Tag

from onboard.files.contract_file import Contract, FrozenSetpoint
from onboard.files.daemon_config import FilePath
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField, ObstacleList, load_field
from onboard.files.sensor_sources import AnySource, with_files_in
from onboard.files.yaml_file import FileError, FileModel, load_yaml, read_mapping, validate
from onboard.mavlink.profiles.registry import profile_named
from onboard.perception.movers.permitted_sources import check_permitted
from sitl.autopilot.flavours.parameters import ideal_gains
from sitl.autopilot.flavours.px4_parameters import GAINS, PARAMETERS
from sitl.config import SitlConfig, VehicleConfig
from sitl.environment.sensor import OVER_MAVLINK, Format, SensorConfig
from sitl.virtual.faults.detections import CHANGES_JSON, KINDS
from sitl.virtual.faults.schema import FAULTS, Fault, Target

# Keys of an earlier version, with the keys that replaced them.
_RENAMED_KEYS: Final = MappingProxyType({"force": "fly_outside_contract"})

Outcome = Literal["arrived", "held", "collided", "aborted"]

ModelT = TypeVar("ModelT", bound=BaseModel)


def _file_or_inline(value: Any) -> str:
    return "file" if isinstance(value, str | Path) else "inline"


# A path relative to the scenario file, or the content itself.
AnyContract = Annotated[
    Annotated[FilePath, Tag("file")] | Annotated[Contract, Tag("inline")],
    Discriminator(_file_or_inline),
]
AnyMission = Annotated[
    Annotated[FilePath, Tag("file")] | Annotated[Mission, Tag("inline")],
    Discriminator(_file_or_inline),
]
AnyField = Annotated[
    Annotated[FilePath, Tag("file")] | Annotated[ObstacleList, Tag("inline")],
    Discriminator(_file_or_inline),
]


class Plant(VehicleConfig):
    """What is simulated: every key of the SITL's vehicle, and its sensors."""

    sensors: Annotated[tuple[SensorConfig, ...], Field(strict=False, min_length=1)] = (
        SensorConfig(),
    )


class Expectation(FileModel):
    """The outcome that a scenario expects; keys that are null are not checked."""

    outcome: Outcome = "arrived"
    reason: str | None = Field(None, description="occurs in the reason of the result")
    collisions: Annotated[int, Field(ge=0)] = 0
    obstacles_avoided: Annotated[int, Field(ge=0)] | None = None


class ScenarioFile(FileModel):
    """The content of a scenario file (scenario.yaml)."""

    contract: AnyContract = Field(description="contract file, or its content")
    field: AnyField = Field(description="obstacle field file (YAML or CSV), or its content")
    mission: AnyMission = Field(description="mission file, or its content")
    sitl: Plant = Field(default_factory=Plant, description="what is simulated")
    faults: Annotated[tuple[Fault, ...], Field(strict=False)] = Field(
        (), description="faults to inject, in virtual time"
    )
    sources: Annotated[tuple[AnySource, ...], Field(strict=False)] = Field(
        (), description="of the daemon: its sensors besides those that publish detections as JSON"
    )
    field_known: bool = Field(True, description="the pre-flight check knows the field")
    fly_outside_contract: bool = Field(
        False, description="fly even if the pre-flight check refuses; for tests"
    )
    expect: Expectation = Field(default_factory=lambda: Expectation.model_validate({}))


@dataclass(frozen=True)
class Scenario:
    """A scenario with the content of every file that it names.

    Attributes:
        name: of the file, without its suffix.
        contract, mission: what the daemon is given.
        obstacles: the field.
        plant: what is simulated.
        faults: injected in virtual time.
        field_known: whether the pre-flight check knows the field.
        fly_outside_contract: fly even if the pre-flight check refuses.
        expect: the expected outcome.
        sources: sensors of the daemon besides those that publish JSON.
    """

    name: str
    contract: Contract
    mission: Mission
    obstacles: ObstacleField
    plant: Plant
    faults: tuple[Fault, ...]
    field_known: bool
    fly_outside_contract: bool
    expect: Expectation
    sources: tuple[AnySource, ...] = ()

    def sitl_config(self, **live: Any) -> SitlConfig:
        """Return the SITL's configuration; ``live`` are the keys that the plant does not have.

        Unless the scenario says otherwise, the autopilot has the mission's take-off altitude, where
        that is a parameter, and the contract's setpoint-loss timeout; the plant's tracking error,
        where it is pinned, is the contract's.
        """
        plant = self.plant.model_dump()
        profile = profile_named(self.plant.flavour)
        parameters: dict[str, float] = {}
        if (height_parameter := profile.take_off.height_parameter) is not None:
            parameters[height_parameter] = self.mission.altitude_m
        if profile.parameters is not None:
            timeout_s = self.contract.vehicle.setpoint_loss_timeout_s
            parameters[profile.parameters.setpoint_timeout] = timeout_s
        plant["parameters"] = parameters | self.plant.parameters
        if plant["tracking"]["error_m"] is None:
            plant["tracking"]["error_m"] = self.contract.vehicle.tracking_error_m
        return SitlConfig.model_validate({**plant, **live})


def load_scenario(path: Path) -> Scenario:
    """Read a scenario and the files that it names, relative to its own place.

    Raises:
        FileError: one of the files is missing or not usable.
    """
    document = read_mapping(path)
    for old, new in _RENAMED_KEYS.items():
        if old in document:
            raise FileError(f"{path}: {old} was renamed: use {new}")
    written = validate(document, ScenarioFile, source=str(path))
    base = path.parent
    scenario = Scenario(
        name=path.stem,
        contract=with_run_on(_loaded(written.contract, base, Contract), written.sitl),
        mission=_loaded(written.mission, base, Mission),
        obstacles=_loaded_field(written.field, base),
        plant=written.sitl,
        faults=written.faults,
        field_known=written.field_known,
        fly_outside_contract=written.fly_outside_contract,
        expect=written.expect,
        sources=with_files_in(base, written.sources),
    )
    check_permitted(scenario.sources, scenario.contract, str(path))
    _require_mission_start(scenario, path)
    _require_frames_to_change(scenario, path)
    return scenario


def with_run_on(contract: Contract, plant: Plant) -> Contract:
    """Return a contract that says how the simulated vehicle runs on when the stream stops.

    A PX4 flies on to the last setpoint; where passive safety counts on that and the contract says
    nothing of it, the gains are those of the simulated vehicle.
    """
    vehicle = contract.vehicle
    stated = vehicle.setpoint_loss is not None or vehicle.setpoint_loss_run_on_m is not None
    frozen = profile_named(plant.flavour).after_setpoint_loss == "frozen"
    if stated or not frozen or not contract.requirements.passive_safety:
        return contract
    values = {spec.name: spec.default for spec in PARAMETERS}
    if plant.realism == "ideal":
        values |= ideal_gains(GAINS)
    values |= plant.parameters
    loss = FrozenSetpoint(
        model="frozen",
        gain_per_s=values[GAINS.position],
        velocity_gain_per_s=values[GAINS.velocity],
    )
    vehicle = vehicle.model_copy(update={"setpoint_loss": loss})
    return contract.model_copy(update={"vehicle": vehicle})


def _require_mission_start(scenario: Scenario, path: Path) -> None:
    north_m, east_m, down_m = scenario.plant.start.position_ned_m
    if (north_m, east_m) != scenario.mission.start_ned_m or -down_m not in (
        0.0,
        scenario.mission.altitude_m,
    ):
        raise FileError(
            f"{path}: sitl.start.position_ned_m = {[north_m, east_m, down_m]} must be on the "
            f"ground, or at mission.altitude_m = {scenario.mission.altitude_m:g} m above it, at "
            f"mission.start_ned_m = {list(scenario.mission.start_ned_m)} m"
        )


def _require_frames_to_change(scenario: Scenario, path: Path) -> None:
    """Refuse faults of detections that no sensor sends."""
    sent = {sensor.publishes for sensor in scenario.plant.sensors}
    for index, fault in enumerate(scenario.faults):
        if fault.kind not in KINDS or FAULTS[fault.kind].targets != (Target.DETECTIONS,):
            continue
        needs = {"json"} if fault.kind in CHANGES_JSON else set(get_args(Format)) - OVER_MAVLINK
        if not sent & needs:
            raise FileError(
                f"{path}: faults[{index}].kind = {fault.kind} changes what sensors publish as "
                f"{', '.join(sorted(needs))}; sitl.sensors publish {', '.join(sorted(sent))}"
            )


def _loaded(written: Path | ModelT, base: Path, model: type[ModelT]) -> ModelT:
    return load_yaml(base / written, model) if isinstance(written, Path) else written


def _loaded_field(written: Path | ObstacleList, base: Path) -> ObstacleField:
    if isinstance(written, Path):
        return load_field(base / written)
    return ObstacleField.of(written.root)


def obstacle_list(field: ObstacleField) -> list[Obstacle]:
    """Return a field as it would be written in YAML."""
    columns = (field.center_ned_m, 2.0 * field.half_size_m, np.degrees(field.yaw_rad))
    rows = zip(field.ids, *(column.tolist() for column in columns), _downs(field), strict=True)
    return [
        Obstacle(id=name, center_ned_m=center_m, size_m=size_m, yaw_deg=yaw_deg, down_m=down_m)
        for name, center_m, size_m, yaw_deg, down_m in rows
    ]


def _downs(field: ObstacleField) -> list[tuple[float | None, float | None] | None]:
    """Return top and bottom of each obstacle as they would be written."""
    if field.down_m is None:
        return [None] * len(field)
    stated = [
        (top_m if math.isfinite(top_m) else None, bottom_m if math.isfinite(bottom_m) else None)
        for top_m, bottom_m in field.down_m.tolist()
    ]
    return [None if each == (None, None) else each for each in stated]
