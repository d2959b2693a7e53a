"""The numbers of a contract in SI units, as floats or as arrays for a surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Generic, Literal

from onboard.files.contract_file import (
    Contract,
    EnvironmentTerms,
    FrozenSetpoint,
    InputSet,
    VehicleTerms,
)
from onboard.files.contract_terms.mover_terms import MoverClass, MoversLevel
from onboard.geometry.frames import Q


@dataclass(frozen=True)
class Terms(Generic[Q]):
    """Every number of a contract in SI units, as floats or as arrays of one shape.

    `mission_altitude_m`, the lowest height of the mission above the local origin, is not a key of a
    contract; where it is None, the clause about it is left out.  `separation_shares` are along and
    across the leg, of `obstacle_separation_min_m`; None where that holds in every direction.  What
    only `onboard.contract.heights` uses is None where obstacles count as pillars of any height.
    """

    roll_max_rad: Q
    pitch_max_rad: Q
    thrust_to_weight: Q
    cruise_speed_mps: Q
    radius_m: Q
    tracking_error_m: Q
    velocity_error_x_mps: Q
    velocity_error_y_mps: Q
    reaction_time_s: Q
    attitude_lag_s: Q
    setpoint_loss_timeout_s: Q
    detection_range_m: Q
    field_of_view_rad: Q
    frame_age_max_s: Q
    position_error_m: Q
    obstacle_size_max_m: Q
    obstacle_size_min_m: Q
    obstacle_separation_min_m: Q
    recentring_speed_mps: Q
    tracking_error_z_m: Q
    heading_error_rad: Q
    estimator_reset_max_m: Q
    drag_per_s: Q
    setpoint_loss_run_on_m: Q | None = None
    setpoint_loss_run_on_speed_mps: Q | None = None
    setpoint_loss_model: Literal["coast", "frozen"] = "coast"
    setpoint_gain_per_s: Q | None = None
    setpoint_velocity_gain_per_s: Q | None = None
    separation_shares: tuple[float, float] | None = None
    wind_max_mps: Q | None = None
    position_drift_mps: Q | None = None
    flight_time_max_s: Q | None = None
    thinnest_obstacle_m: Q | None = None
    no_return_is_free_to_m: Q | None = None
    mission_altitude_m: Q | None = None
    terrain_max_m: Q | None = None
    terrain_error_m: Q | None = None
    radius_z_m: Q | None = None
    height_drift_m: Q | None = None
    height_drift_flight_m: Q | None = None
    position_error_z_m: Q | None = None
    view_up_rad: Q | None = None
    view_down_rad: Q | None = None
    all_round_range_m: Q | None = None
    setpoint_loss_run_time_s: Q | None = None
    rest_settle_s: float = 0.0
    movers: tuple[MoverClass, ...] = ()
    movers_level: MoversLevel = "none"
    best_effort: bool = False
    stop: bool = True
    passive_safety: bool = True
    input_set: InputSet = "inner"

    @classmethod
    def of(
        cls,
        contract: Contract,
        input_set: InputSet = "inner",
        mission_altitude_m: float | None = None,
    ) -> Terms[float]:
        """Return the terms of a contract file, angles in radians."""
        vehicle, sensor, environment = contract.vehicle, contract.sensor, contract.environment
        return _made(
            roll_max_rad=math.radians(vehicle.roll_max_deg),
            pitch_max_rad=math.radians(vehicle.pitch_max_deg),
            thrust_to_weight=vehicle.thrust_to_weight,
            cruise_speed_mps=vehicle.cruise_speed_mps,
            radius_m=vehicle.radius_m,
            tracking_error_m=vehicle.tracking_error_m,
            velocity_error_x_mps=vehicle.velocity_error_mps[0],
            velocity_error_y_mps=vehicle.velocity_error_mps[1],
            reaction_time_s=vehicle.reaction_time_s,
            attitude_lag_s=vehicle.attitude_lag_s,
            **_setpoint_loss(vehicle),
            separation_shares=_separation_shares(environment),
            recentring_speed_mps=vehicle.recentring_speed_mps,
            tracking_error_z_m=vehicle.tracking_error_z_m,
            heading_error_rad=math.radians(vehicle.heading_error_deg),
            estimator_reset_max_m=vehicle.estimator_reset_max_m,
            drag_per_s=vehicle.drag_per_s,
            wind_max_mps=environment.wind_max_mps,
            position_drift_mps=vehicle.position_drift_mps,
            thinnest_obstacle_m=sensor.thinnest_obstacle_m,
            no_return_is_free_to_m=sensor.no_return_is_free_to_m,
            **_terrain(environment),
            **_heights(contract),
            detection_range_m=sensor.detection_range_m,
            field_of_view_rad=math.radians(sensor.field_of_view_deg),
            frame_age_max_s=sensor.frame_age_max_s,
            position_error_m=sensor.position_error_m,
            obstacle_size_max_m=environment.obstacle_size_max_m,
            obstacle_size_min_m=environment.obstacle_size_min_m,
            obstacle_separation_min_m=environment.separation_any_way_m,
            mission_altitude_m=mission_altitude_m,
            **_requirements(contract),
            input_set=input_set,
        )

    @property
    def body_m(self) -> Q:
        """R + E: how far a part of the vehicle may be from the reference (theory B).

        With what the local frame may have drifted since take-off, when the map was begun.
        """
        return self.radius_m + self.tracking_error_m + self.drift_m

    @property
    def drift_m(self) -> Q:
        """How far the local frame may drift in the longest flight; 0 where it does not."""
        if self.position_drift_mps is None or self.flight_time_max_s is None:
            return self.cruise_speed_mps * 0.0
        return self.position_drift_mps * self.flight_time_max_s

    @property
    def map_error_m(self) -> Q:
        """How far a face may be off in the local frame at any time of the flight, but for heading.

        A frame by itself is as exact as `position_error_m`; the map keeps it until the landing.
        """
        return self.position_error_m + self.drift_m

    @property
    def trim_mps2(self) -> Q:
        """Acceleration that holds a place in the strongest wind declared (theory J); 0 without."""
        if self.wind_max_mps is None:
            return self.cruise_speed_mps * 0.0
        return self.drag_per_s * self.wind_max_mps

    @property
    def sure_view_rad(self) -> Q:
        """Part of the field of view that is ahead whatever the heading error (theory I)."""
        return self.field_of_view_rad - 2.0 * self.heading_error_rad

    @property
    def movers_meet(self) -> bool:
        """Whether what moves may be at the height of the flight; else it is flown over."""
        return self.movers_level != "none" and self.radius_z_m is None

    @property
    def stops(self) -> bool:
        """Whether regions are those of stopping and sidestepping; else those of the paper."""
        return self.stop and self.input_set == "inner"

    def idealised(self) -> Terms[Q]:
        """Return the paper's idealisation: it swerves, with no size, errors, delays or wind."""
        zero = self.cruise_speed_mps * 0.0
        ideal = {
            "radius_m": zero,
            "tracking_error_m": zero,
            "velocity_error_x_mps": zero,
            "velocity_error_y_mps": zero,
            "reaction_time_s": zero,
            "attitude_lag_s": zero,
            "position_error_m": zero,
            "recentring_speed_mps": zero,
            "tracking_error_z_m": zero,
            "heading_error_rad": zero,
            "wind_max_mps": None,
            "stop": False,
            "position_drift_mps": None,
            "passive_safety": False,
            "radius_z_m": None,
        }
        return _made(**vars(self) | ideal)


def _made(**fields: Any) -> Terms[Any]:
    """Return terms of these fields, as `Terms` does.

    That sets each of forty fields by a call, in a tenth of the time that a contract takes.
    """
    terms = object.__new__(Terms)
    object.__setattr__(terms, "__dict__", fields)
    return terms


def _setpoint_loss(vehicle: VehicleTerms) -> dict[str, Any]:
    """Return the terms about what the autopilot does without setpoints."""
    loss = vehicle.setpoint_loss
    measured = {
        "setpoint_loss_timeout_s": vehicle.setpoint_loss_timeout_s,
        "setpoint_loss_run_on_m": vehicle.setpoint_loss_run_on_m,
        "setpoint_loss_run_on_speed_mps": vehicle.setpoint_loss_run_on_speed_mps,
    }
    if not isinstance(loss, FrozenSetpoint):
        return {**measured, "setpoint_loss_model": "coast"}
    return {
        **measured,
        "setpoint_loss_model": "frozen",
        "setpoint_gain_per_s": loss.gain_per_s,
        "setpoint_velocity_gain_per_s": loss.velocity_gain_per_s,
    }


def _heights(contract: Contract) -> dict[str, Any]:
    """Return the terms about heights; none where obstacles count as pillars."""
    vehicle, sensor = contract.vehicle, contract.sensor
    if sensor.vertical_field_of_view_deg is None:
        return {}
    up_deg, down_deg = sensor.vertical_field_of_view_deg
    return {
        "radius_z_m": vehicle.radius_z_m,
        "height_drift_m": vehicle.height_drift_m,
        "height_drift_flight_m": vehicle.height_drift_flight_m,
        "position_error_z_m": sensor.position_error_z_m,
        "view_up_rad": math.radians(up_deg),
        "view_down_rad": math.radians(down_deg),
    }


def _terrain(environment: EnvironmentTerms) -> dict[str, Any]:
    """Return the terms about the ground; none where it is the plane of the local origin."""
    if environment.terrain_max_m == environment.terrain_error_m == 0.0:
        return {}
    return {
        "terrain_max_m": environment.terrain_max_m,
        "terrain_error_m": environment.terrain_error_m,
    }


def _requirements(contract: Contract) -> dict[str, Any]:
    """Return the terms about what is required, of movers and else."""
    requirements = contract.requirements
    return {
        "flight_time_max_s": requirements.flight_time_max_s,
        "stop": requirements.stop,
        "passive_safety": requirements.passive_safety,
        **_mover_terms(contract),
    }


def _mover_terms(contract: Contract) -> dict[str, Any]:
    """Return the terms about what moves."""
    vehicle, requirements = contract.vehicle, contract.requirements
    return {
        "all_round_range_m": contract.sensor.all_round_range_m,
        "setpoint_loss_run_time_s": vehicle.setpoint_loss_run_time_s,
        "rest_settle_s": vehicle.rest_settle_s,
        "movers": contract.environment.movers,
        "movers_level": requirements.movers,
        "best_effort": requirements.progress == "best_effort",
    }


def _separation_shares(environment: EnvironmentTerms) -> tuple[float, float] | None:
    """Return what a stated pair [along, across] is of its diagonal; None without one."""
    if environment.separation_box_m is None:
        return None
    along_m, across_m = environment.separation_box_m
    diagonal_m = environment.separation_any_way_m
    return along_m / diagonal_m, across_m / diagonal_m
