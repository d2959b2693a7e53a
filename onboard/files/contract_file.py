"""The contract as an operator states it (contract.yaml): frozen and validated.

Angles are in degrees here, as in the file, and in radians everywhere else
(`onboard.contract.terms`).
"""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from onboard.files.contract_terms.heights import RADIUS_Z, height_objection
from onboard.files.contract_terms.later_keys import LATER_KEYS
from onboard.files.contract_terms.mover_terms import (
    Declared,
    MoverClass,
    MoversLevel,
    check_movers,
    movers_objection,
)
from onboard.files.yaml_file import (
    FileError,
    FileModel,
    load_yaml,
    parse_value,
    read_mapping,
    validate,
)

InputSet = Literal["inner", "paper"]
Progress = Literal["guaranteed", "best_effort"]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
AcuteAngle = Annotated[float, Field(gt=0.0, lt=90.0)]
AcuteAngles = Annotated[tuple[AcuteAngle, AcuteAngle], Field(strict=False)]
# YAML has lists only; the numbers inside stay strict.
NonNegativePair = Annotated[tuple[NonNegative, NonNegative], Field(strict=False)]
PositivePair = Annotated[tuple[Positive, Positive], Field(strict=False)]


def pinned_run_on_speed(vehicle: dict[str, Any], speed_mps: Any) -> dict[str, Any]:
    """Return the keys of a vehicle with the speed at which the run-on was measured stated."""
    key = "setpoint_loss_run_on_speed_mps"
    # A value that is not a speed is reported once, under the key where it is written.
    usable = isinstance(speed_mps, int | float) and math.isfinite(speed_mps) and speed_mps > 0.0
    stated = vehicle.get(key) is not None
    return vehicle if stated or not usable else vehicle | {key: float(speed_mps)}


class FrozenSetpoint(FileModel):
    """The autopilot keeps flying to the last setpoint after a loss of the stream, as PX4 does."""

    model: Literal["frozen"]
    gain_per_s: Positive = Field(description="of the position controller; PX4: MPC_XY_P")
    velocity_gain_per_s: Positive = Field(
        description="of the velocity controller; PX4: MPC_XY_VEL_P_ACC"
    )


class CoastingSetpoint(FileModel):
    """The autopilot integrates the last setpoint, then brakes, as ArduPilot does."""

    model: Literal["coast"]
    timeout_s: NonNegative | None = Field(
        None, description="until it brakes; replaces setpoint_loss_timeout_s"
    )


SetpointLoss = Annotated[FrozenSetpoint | CoastingSetpoint, Field(discriminator="model")]


class VehicleTerms(FileModel):
    """What the vehicle guarantees."""

    roll_max_deg: AcuteAngle = Field(description="roll available to the planner (phi_max)")
    pitch_max_deg: AcuteAngle = Field(description="pitch available to the planner (theta_max)")
    thrust_to_weight: Annotated[float, Field(gt=1.0)] = Field(description="T_max / (m g)")
    cruise_speed_mps: Positive = Field(description="V_cruise")
    radius_m: NonNegative = Field(description="of the circle around the vehicle, rotors included")
    tracking_error_m: NonNegative = Field(description="E_tr: reference to actual position")
    velocity_error_mps: NonNegativePair = Field(description="dV_x, dV_y")
    reaction_time_s: NonNegative = Field(description="object within range to changed setpoint")
    attitude_lag_s: NonNegative = Field(description="T_e: setpoint to acceleration")
    setpoint_loss_timeout_s: NonNegative = Field(
        1.0, description="the autopilot coasts this long when the stream stops"
    )
    setpoint_loss_run_on_m: NonNegative | None = Field(
        None, description="measured forward run after the stream stops; replaces the model"
    )
    setpoint_loss_run_on_speed_mps: Positive | None = Field(
        None,
        description="speed at which the run-on was measured; null: the file's cruise speed",
    )
    setpoint_loss: SetpointLoss | None = Field(
        None, description="how the vehicle runs on when the stream stops; null: it coasts"
    )
    recentring_speed_mps: NonNegative = Field(
        0.0, description="lateral speed of the way back to the leg line after an avoidance; 0: none"
    )
    tracking_error_z_m: NonNegative = Field(
        1.0, description="vertical distance between reference and actual position"
    )
    heading_error_deg: Annotated[float, Field(ge=0.0, lt=45.0)] = Field(
        0.0, description="estimated heading to true heading; displaces what the body sees"
    )
    estimator_reset_max_m: NonNegative = Field(
        0.0, description="estimator jumps up to this shift what is remembered; 0: each one holds"
    )
    drag_per_s: NonNegative = Field(
        0.45, description="deceleration per airspeed: how much tilt a steady wind takes (trim)"
    )
    position_drift_mps: NonNegative = Field(
        0.0, description="horizontal, of the local frame; needs requirements.flight_time_max_s"
    )

    @model_validator(mode="before")
    @classmethod
    def _loss_has_one_timeout(cls, data: Any) -> Any:
        """Move the timeout of a coasting autopilot to the key that has always held it."""
        loss = data.get("setpoint_loss") if isinstance(data, dict) else None
        if not isinstance(loss, dict) or loss.get("model") != "coast":
            return data
        timeout_s = loss.get("timeout_s")
        if timeout_s is None:
            return data
        stated_s = data.get("setpoint_loss_timeout_s", timeout_s)
        if stated_s != timeout_s:
            raise ValueError(
                f"setpoint_loss.timeout_s = {timeout_s} s contradicts setpoint_loss_timeout_s = "
                f"{stated_s} s; state one of them"
            )
        moved = {key: value for key, value in loss.items() if key != "timeout_s"}
        return data | {"setpoint_loss": moved, "setpoint_loss_timeout_s": timeout_s}

    clearance_wish_m: NonNegative = Field(
        0.0,
        description="preferred distance to obstacles with best effort, never required; 0: none",
    )
    radius_z_m: Positive | None = Field(
        None,
        description="of the body above and below its centre, rotors and greatest tilt included; "
        "null: obstacles count as pillars of any height",
    )
    height_drift_m: NonNegative | None = Field(
        None,
        description="of the estimated height, from the sight of an obstacle to its passing; "
        "null: obstacles count as pillars of any height",
    )
    height_drift_flight_m: NonNegative | None = Field(
        None, description="of the estimated height, over a whole flight; needed to fly over movers"
    )
    rest_settle_s: NonNegative = Field(
        0.0, description="reference at rest to vehicle at rest, measured; needed against movers"
    )
    rest_speed_mps: Positive = Field(
        0.2, description="a vehicle no faster than this is at rest; monitored against movers"
    )
    setpoint_loss_run_time_s: Positive | None = Field(
        None, description="last setpoint to rest, measured; null: by the model, if that coasts"
    )

    @model_validator(mode="before")
    @classmethod
    def _run_on_has_a_speed(cls, data: Any) -> Any:
        """State the speed of a measured run, so that a change of the cruise speed leaves it."""
        if isinstance(data, dict) and data.get("setpoint_loss_run_on_m") is not None:
            return pinned_run_on_speed(data, data.get("cruise_speed_mps"))
        return data


class Requirements(FileModel):
    """Clauses that may be switched off."""

    stop: bool = Field(True, description="braking to hover is always available")
    passive_safety: bool = Field(True, description="no collision even if the daemon dies")
    progress: Progress = Field(
        "guaranteed",
        description="best_effort: fly where passing every obstacle is not guaranteed, safely",
    )
    flight_time_max_s: Positive | None = Field(
        None, description="since take-off; then the vehicle holds, to be landed; null: no limit"
    )
    movers: MoversLevel = Field(
        "none", description="passive: at rest before any contact with what moves as declared"
    )
    yield_max_s: Positive | None = Field(
        None, description="longest wait for movers at rest, then the vehicle holds; null: no limit"
    )


class SensorTerms(FileModel):
    """What is assumed of the obstacle sensor."""

    detection_range_m: Positive = Field(description="D_od")
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)]
    frame_age_max_s: Positive = Field(description="older or missing frames are a sensor failure")
    position_error_m: NonNegative = Field(
        description="of each face of a detected obstacle, as placed with the pose at its stamp"
    )
    thinnest_obstacle_m: Positive | None = Field(
        None, description="seen for certain at detection_range_m; null: not declared"
    )
    no_return_is_free_to_m: Positive | None = Field(
        None, description="how far a null in free_range_m shows free space; null: it shows none"
    )
    position_error_z_m: NonNegative | None = Field(
        None,
        description="of top and bottom of a detected obstacle, levelling at full range included; "
        "null: obstacles count as pillars of any height",
    )
    vertical_field_of_view_deg: AcuteAngles | None = Field(
        None,
        description="[up, down] from the level of the body; null: obstacles count as pillars of "
        "any height",
    )
    all_round_range_m: NonNegative = Field(
        0.0, description="of a sensor with a view of 360 degrees besides; 0: there is none"
    )


class EnvironmentTerms(FileModel):
    """What is assumed of the obstacle field."""

    obstacle_size_max_m: Positive = Field(description="S_max, both extents, in the leg frame")
    obstacle_size_min_m: NonNegative = Field(description="smallest extent along the leg, or 0")
    obstacle_separation_min_m: Positive | PositivePair = Field(
        description="D_sep, centre to centre; or [along, across] the leg: apart by one of the two"
    )
    wind_max_mps: NonNegative | None = Field(
        None, description="steady wind, horizontally; null: not declared, and not monitored"
    )
    terrain_max_m: float = Field(
        0.0, ge=-9000.0, description="highest ground below the mission, above the local origin"
    )
    terrain_error_m: NonNegative = Field(0.0, description="of terrain_max_m")
    movers: Annotated[tuple[MoverClass, ...], Field(strict=False)] = Field(
        (), description="classes of what moves; empty: none is declared"
    )

    @model_validator(mode="after")
    def _movers_are_consistent(self) -> Self:
        check_movers(self.movers)
        return self

    @model_validator(mode="after")
    def _sizes_are_ordered(self) -> Self:
        if self.obstacle_size_min_m > self.obstacle_size_max_m:
            raise ValueError(
                f"obstacle_size_min_m = {self.obstacle_size_min_m} m exceeds "
                f"obstacle_size_max_m = {self.obstacle_size_max_m} m"
            )
        return self

    @property
    def separation_box_m(self) -> tuple[float, float] | None:
        """The pair [along, across] in metres; None where one number holds in every direction."""
        stated = self.obstacle_separation_min_m
        return stated if isinstance(stated, tuple) else None

    @property
    def separation_any_way_m(self) -> float:
        """Distance in metres at which two obstacles keep to what is assumed, in any direction."""
        stated = self.obstacle_separation_min_m
        return math.hypot(*stated) if isinstance(stated, tuple) else stated


class Contract(FileModel):
    """What the vehicle guarantees, as long as what it assumes holds (contract.yaml)."""

    vehicle: VehicleTerms
    requirements: Requirements = Requirements(stop=True, passive_safety=True)
    sensor: SensorTerms
    environment: EnvironmentTerms

    @model_validator(mode="after")
    def _run_on_covers_the_speed(self) -> Self:
        vehicle = self.vehicle
        measured_mps = vehicle.setpoint_loss_run_on_speed_mps
        counted_on = self.requirements.passive_safety and vehicle.setpoint_loss_run_on_m is not None
        if counted_on and measured_mps is not None and vehicle.cruise_speed_mps > measured_mps:
            raise ValueError(
                f"vehicle.cruise_speed_mps = {vehicle.cruise_speed_mps:g} m/s exceeds "
                f"vehicle.setpoint_loss_run_on_speed_mps = {measured_mps:g} m/s, at which "
                f"setpoint_loss_run_on_m = {vehicle.setpoint_loss_run_on_m:g} m was measured; "
                "cruise no faster, or measure the run at the higher speed and state both"
            )
        return self

    @model_validator(mode="after")
    def _drift_has_an_end(self) -> Self:
        drift_mps = self.vehicle.position_drift_mps
        if drift_mps > 0.0 and self.requirements.flight_time_max_s is None:
            raise ValueError(
                f"vehicle.position_drift_mps = {drift_mps:g} m/s needs "
                "requirements.flight_time_max_s [s], which bounds what it adds up to"
            )
        return self

    @model_validator(mode="after")
    def _heights_are_whole(self) -> Self:
        vehicle, sensor = self.vehicle, self.sensor
        stated = {
            RADIUS_Z: vehicle.radius_z_m,
            "vehicle.height_drift_m [m]": vehicle.height_drift_m,
            "sensor.position_error_z_m [m]": sensor.position_error_z_m,
            "sensor.vertical_field_of_view_deg [deg]": sensor.vertical_field_of_view_deg,
        }
        tilts_deg = (vehicle.roll_max_deg, vehicle.pitch_max_deg)
        objection = height_objection(
            stated, vehicle.radius_m, tilts_deg, stop=self.requirements.stop
        )
        if objection is not None:
            raise ValueError(objection)
        return self

    @model_validator(mode="after")
    def _movers_can_be_required(self) -> Self:
        vehicle, requirements, sensor = self.vehicle, self.requirements, self.sensor
        frozen = isinstance(vehicle.setpoint_loss, FrozenSetpoint)
        declared = Declared(
            movers=self.environment.movers,
            stop=requirements.stop,
            best_effort=requirements.progress == "best_effort",
            rest_settle_s=vehicle.rest_settle_s,
            sees_all_round=sensor.all_round_range_m > 0.0 or sensor.field_of_view_deg >= 360.0,
            run_time_known=not (requirements.passive_safety and frozen)
            or vehicle.setpoint_loss_run_time_s is not None,
            as_pillars=vehicle.radius_z_m is None,
            drifts_m=(vehicle.height_drift_m, vehicle.height_drift_flight_m),
        )
        objection = movers_objection(requirements.movers, declared)
        if objection is not None:
            raise ValueError(objection)
        return self

    @property
    def sha256(self) -> str:
        """Hash of the terms themselves: comments, key order and notation do not change it.

        A key of `LATER_KEYS` counts only where it differs from its default, so contracts written
        before the key existed keep their hash.
        """
        terms = self.model_dump(mode="json")
        for section, keys in LATER_KEYS.items():
            fields = type(getattr(self, section)).model_fields
            for key in keys:
                # JSON has lists only.
                default = fields[key].default
                if terms[section][key] == (list(default) if default == () else default):
                    del terms[section][key]
        for mover in terms["environment"].get("movers", ()):
            if mover["top_max_m"] is None:  # a later key, too
                del mover["top_max_m"]
        # By default a run was measured at the cruise speed.
        vehicle = terms["vehicle"]
        if vehicle.get("setpoint_loss_run_on_speed_mps") == vehicle["cruise_speed_mps"]:
            del vehicle["setpoint_loss_run_on_speed_mps"]
        canonical = json.dumps(terms, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()


def load_contract(path: Path, overrides: tuple[str, ...] = ()) -> Contract:
    """Read a contract; ``overrides`` are ``dotted.key=value`` as given to ``--set``.

    Raises:
        FileError: the file or an override is not usable.
    """
    if not overrides:
        return load_yaml(path, Contract)
    data = read_mapping(path)
    stated = data.get("vehicle")
    cruise_speed_mps = stated.get("cruise_speed_mps") if isinstance(stated, dict) else None
    for override in overrides:
        _override(data, override)
    vehicle = data.get("vehicle")
    # The run was measured at the speed of the file, not at the one that is tried.
    if isinstance(vehicle, dict) and vehicle.get("setpoint_loss_run_on_m") is not None:
        data["vehicle"] = pinned_run_on_speed(vehicle, cruise_speed_mps)
    return validate(data, Contract, source=f"{path} with --set {' '.join(overrides)}")


def _override(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    *parents, last = key.split(".")
    if not equals or not all(parents) or not last:
        raise FileError(f"--set {override}: write dotted.key=value")
    target: Any = data
    for parent in parents:
        target = target.setdefault(parent, {})
        if not isinstance(target, dict):
            raise FileError(f"--set {override}: {parent} holds a value, not keys")
    target[last] = parse_value(text, source=f"--set {override}")
