"""The contract: what is required, what is declared, and the verdict.

A contract file states limits and assumptions; `assess` derives the Region of Influence from them
and holds every requirement against what is declared.  Two readings are computed: *nominal*, the
paper's point mass without errors, and *inflated*, with radius, errors, reaction time, attitude lag
and run-on included.  The clauses use the inflated one.  Proofs: THEORY.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic

from onboard.agility import GRAVITY_MPS2, AccelerationLimits, Agility, InputSet
from onboard.config import Contract
from onboard.recentring import Corridor, Drift, drift_of, required_view
from onboard.region import (
    SCALAR,
    Arithmetic,
    Box,
    Dimensions,
    Encounter,
    Q,
    RegionOfInfluence,
    dimensions,
)

# The daemon decides at this period; a silent sensor is noticed up to one tick late.
TICK_S = 0.02


@dataclass(frozen=True)
class Terms(Generic[Q]):
    """Every number of a contract in SI units, as floats or as arrays of one shape."""

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
    wind_max_mps: Q | None = None
    stop: bool = True
    passive_safety: bool = True
    input_set: InputSet = "inner"

    @classmethod
    def of(cls, contract: Contract, input_set: InputSet = "inner") -> Terms[float]:
        """Return the terms of a contract file, angles in radians."""
        vehicle, sensor, environment = contract.vehicle, contract.sensor, contract.environment
        return Terms(
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
            setpoint_loss_timeout_s=vehicle.setpoint_loss_timeout_s,
            setpoint_loss_run_on_m=vehicle.setpoint_loss_run_on_m,
            setpoint_loss_run_on_speed_mps=vehicle.setpoint_loss_run_on_speed_mps,
            recentring_speed_mps=vehicle.recentring_speed_mps,
            tracking_error_z_m=vehicle.tracking_error_z_m,
            heading_error_rad=math.radians(vehicle.heading_error_deg),
            estimator_reset_max_m=vehicle.estimator_reset_max_m,
            drag_per_s=vehicle.drag_per_s,
            wind_max_mps=environment.wind_max_mps,
            detection_range_m=sensor.detection_range_m,
            field_of_view_rad=math.radians(sensor.field_of_view_deg),
            frame_age_max_s=sensor.frame_age_max_s,
            position_error_m=sensor.position_error_m,
            obstacle_size_max_m=environment.obstacle_size_max_m,
            obstacle_size_min_m=environment.obstacle_size_min_m,
            obstacle_separation_min_m=environment.obstacle_separation_min_m,
            stop=contract.requirements.stop,
            passive_safety=contract.requirements.passive_safety,
            input_set=input_set,
        )

    def idealised(self) -> Terms[Q]:
        """Return the paper's idealisation: no size, no errors, no delays."""
        zero = self.cruise_speed_mps * 0.0
        return replace(
            self,
            radius_m=zero,
            tracking_error_m=zero,
            velocity_error_x_mps=zero,
            velocity_error_y_mps=zero,
            reaction_time_s=zero,
            attitude_lag_s=zero,
            position_error_m=zero,
            recentring_speed_mps=zero,
            tracking_error_z_m=zero,
            heading_error_rad=zero,
            passive_safety=False,
        )


@dataclass(frozen=True)
class Derived(Generic[Q]):
    """Quantities derived from the terms for the largest obstacle; lengths in metres.

    Attributes:
        encounter: the worst encounter: largest obstacle, highest speed, all errors.
        region: its Region of Influence.
        margin_m: rho, by which obstacle faces move out (theory B).
        edge_offset_m: lateral distance to the farthest point that must be seen to decide.
        roi_length_m, roi_width_m: L_x, L_y of theory.md, "Separation".
    """

    encounter: Encounter[Q]
    region: Dimensions[Q]
    margin_m: Q
    edge_offset_m: Q
    roi_length_m: Q
    roi_width_m: Q
    required_detection_range_m: Q
    required_separation_m: Q
    stopping_distance_m: Q


@dataclass(frozen=True)
class Clause(Generic[Q]):
    """One requirement; the declared value must exceed it strictly (erratum 13)."""

    name: str
    required: Q
    declared: Q
    unit: str
    reason: str

    @property
    def margin(self) -> Q:
        """Declared less required, in the clause's unit; positive is safe."""
        return self.declared - self.required

    @property
    def holds(self) -> Any:
        """Whether the requirement is met, element by element for arrays."""
        return self.margin > 0.0


def worst_encounter(
    terms: Terms[Q], size_along_m: Q, size_across_m: Q, ops: Arithmetic[Q]
) -> Encounter[Q]:
    """Meet an obstacle of this (already inflated) size under everything that may go wrong."""
    x_mps2 = GRAVITY_MPS2 * ops.tan(terms.pitch_max_rad)
    y_mps2 = GRAVITY_MPS2 * ops.tan(terms.roll_max_rad)
    if terms.input_set == "paper":
        tan_pitch = ops.tan(terms.pitch_max_rad)
        y_mps2 = y_mps2 * ops.sqrt(1.0 + tan_pitch * tan_pitch)
    speed_mps = terms.cruise_speed_mps + terms.velocity_error_x_mps
    run_on_m, coast_time_s = _run_on(terms, speed_mps, x_mps2, ops)
    return Encounter(
        brake_mps2=x_mps2,
        forward_mps2=x_mps2,
        left_mps2=y_mps2,
        right_mps2=y_mps2,
        speed_mps=speed_mps,
        lateral_speed_mps=terms.velocity_error_y_mps + terms.recentring_speed_mps,
        size_along_m=size_along_m,
        size_across_m=size_across_m,
        attitude_lag_s=terms.attitude_lag_s,
        reaction_time_s=terms.reaction_time_s,
        run_on_m=run_on_m,
        coast_time_s=coast_time_s,
        coast_drift_m=terms.recentring_speed_mps * coast_time_s,
    )


def _run_on(terms: Terms[Q], speed_mps: Q, brake_mps2: Q, ops: Arithmetic[Q]) -> tuple[Q, Q]:
    """Forward run [m] and coasting time [s] once the setpoint stream stops (theory H).

    A measured run is read as coasting for the time that, followed by braking, gives that run.
    """
    zero = speed_mps * 0.0
    if not terms.passive_safety:
        return zero, zero
    if terms.setpoint_loss_run_on_m is None:
        coast_time_s = terms.setpoint_loss_timeout_s
        return speed_mps * coast_time_s + speed_mps * speed_mps / (2.0 * brake_mps2), coast_time_s
    run_on_m = terms.setpoint_loss_run_on_m
    braking_time_s = speed_mps / (2.0 * brake_mps2)
    return run_on_m, ops.maximum(zero, run_on_m / speed_mps - braking_time_s)


def derive(terms: Terms[Q], ops: Arithmetic[Q]) -> Derived[Q]:
    """Everything that the clauses compare, for the largest obstacle."""
    body_m = terms.radius_m + terms.tracking_error_m
    margin_m = body_m + 2.0 * terms.position_error_m
    size_m = terms.obstacle_size_max_m + 2.0 * margin_m
    e = worst_encounter(terms, size_m, size_m, ops)
    region = dimensions(e, ops)
    # The border lies farthest behind the centre of the thinnest obstacle (erratum 11), the more so
    # if its front face is measured too far away: only body_m is certain to stand before it.
    thin_m = terms.obstacle_size_min_m + 2.0 * body_m
    behind_m = region.recovery_m - e.run_on_m - thin_m / 2.0
    length_m = region.front_m + size_m / 2.0 + ops.maximum(behind_m, size_m / 2.0)
    width_m = (
        size_m
        + (region.overhang_left_m + region.coast_left_m)
        + (region.overhang_right_m + region.coast_right_m)
    )
    stop_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2)
    late_m = e.speed_mps * (e.reaction_time_s + e.attitude_lag_s)
    return Derived(
        encounter=e,
        region=region,
        margin_m=margin_m,
        edge_offset_m=_edge_offset(e, region, margin_m, ops),
        roi_length_m=length_m,
        roi_width_m=width_m,
        required_detection_range_m=margin_m + region.front_m + terms.tracking_error_m,
        required_separation_m=ops.sqrt(length_m * length_m + width_m * width_m),
        stopping_distance_m=stop_m + late_m,
    )


def _edge_offset(e: Encounter[Q], region: Dimensions[Q], margin_m: Q, ops: Arithmetic[Q]) -> Q:
    """Lateral distance to the farthest point that must be seen in time (erratum 13).

    Where there is room to stop, that is the nearest edge of an obstacle that the vehicle would
    only just meet; where there is not, it is the edge round which it has to pass.
    """
    t_m = region.avoidance_time_s
    grazing_m = margin_m + ops.maximum(region.drift_left_m, region.drift_right_m)
    passing_m = e.lateral_speed_mps * (t_m + e.attitude_lag_s) + (
        ops.maximum(e.right_mps2, e.left_mps2) * t_m * t_m / 2.0
    )
    return ops.where(region.flat, grazing_m, passing_m)


def clauses(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> tuple[Clause[Q], ...]:
    """Every requirement of the contract, in the order in which an operator reads them."""
    separation = Clause(
        "separation",
        derived.required_separation_m,
        terms.obstacle_separation_min_m,
        "m",
        "regions of influence of any two obstacles must not intersect",
    )
    return (
        _agility_clauses(terms, ops)
        + _sensor_clauses(terms, derived, ops)
        + _stopping_clauses(terms, derived)
        + _passive_safety_clauses(terms, derived, ops)
        + _recentring_clauses(terms, derived, ops)
        + (separation,)
    )


def _agility_clauses(terms: Terms[Q], ops: Arithmetic[Q]) -> tuple[Clause[Q], ...]:
    tan_roll, tan_pitch = ops.tan(terms.roll_max_rad), ops.tan(terms.pitch_max_rad)
    corner = ops.sqrt((1.0 + tan_roll * tan_roll) * (1.0 + tan_pitch * tan_pitch))
    return (
        Clause(
            "thrust",
            corner,
            terms.thrust_to_weight,
            "T/W",
            "height must be held at the roll and pitch limits together",
        ),
    )


def _sensor_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    ahead_m = derived.required_detection_range_m - derived.encounter.run_on_m
    return (
        Clause(
            "detection_range",
            ahead_m,
            terms.detection_range_m,
            "m",
            "an obstacle must be seen before the last point where avoiding it is possible",
        ),
        Clause(
            "edge_visibility",
            _slant(ahead_m, derived.edge_offset_m, ops),
            terms.detection_range_m,
            "m",
            "the edge that decides whether and on which side to pass must be seen in time",
        ),
        Clause(
            "field_of_view",
            2.0 * ops.atan2(derived.edge_offset_m, ahead_m) * (180.0 / math.pi),
            terms.field_of_view_rad * (180.0 / math.pi),
            "°",
            "what must be seen ahead must lie within the sensor's field of view",
        ),
    )


def _slant(ahead_m: Q, aside_m: Q, ops: Arithmetic[Q]) -> Q:
    return ops.sqrt(ahead_m * ahead_m + aside_m * aside_m)


def _stopping_clauses(terms: Terms[Q], derived: Derived[Q]) -> tuple[Clause[Q], ...]:
    if not terms.stop:
        return ()
    e = derived.encounter
    fixed_m = derived.margin_m + terms.tracking_error_m
    stop_m = e.speed_mps * e.speed_mps / (2.0 * e.brake_mps2) + e.speed_mps * e.attitude_lag_s
    return (
        Clause(
            "stop",
            fixed_m + stop_m + e.speed_mps * e.reaction_time_s,
            terms.detection_range_m,
            "m",
            "braking to hover before an obstacle must be possible once it is seen",
        ),
        Clause(
            "sensor_silence",
            fixed_m + stop_m + e.speed_mps * (terms.frame_age_max_s + TICK_S),
            terms.detection_range_m,
            "m",
            "when the sensor falls silent, braking must end within what was last seen",
        ),
    )


def _passive_safety_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    if not terms.passive_safety:
        return ()
    return (
        Clause(
            "passive_safety",
            _slant(derived.required_detection_range_m, derived.edge_offset_m, ops),
            terms.detection_range_m,
            "m",
            "an obstacle must be seen early enough that even a dead daemon does no harm",
        ),
    )


def recentring_drift(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Drift[Q]:
    """Return the drift back to the leg line: its slope, and the room that it needs (theory F)."""
    silent_s = terms.frame_age_max_s + TICK_S
    return drift_of(
        derived.encounter,
        speed_min_mps=terms.cruise_speed_mps - terms.velocity_error_x_mps,
        margin_m=derived.margin_m + terms.tracking_error_m,
        notice_s=ops.maximum(terms.reaction_time_s, silent_s),
        ops=ops,
    )


def _recentring_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    wanted = terms.recentring_speed_mps > 0.0
    if not ops.anywhere(wanted):
        return ()
    view_rad = required_view(recentring_drift(terms, derived, ops), terms.detection_range_m, ops)
    return (
        Clause(
            "recentring",
            ops.where(wanted, view_rad, view_rad * 0.0) * (180.0 / math.pi),
            terms.field_of_view_rad * (180.0 / math.pi),
            "°",
            "what the vehicle drifts towards on its way back to the leg must have been seen before",
        ),
    )


@dataclass(frozen=True)
class Assessment:
    """A contract's verdict and everything behind it.

    Attributes:
        contract: what was assessed.
        terms: its numbers in SI units.
        limits: admissible accelerations.
        nominal: the paper's idealisation.
        inflated: with all errors; what the clauses use.
        clauses: every requirement.
    """

    contract: Contract
    terms: Terms[float]
    limits: AccelerationLimits
    nominal: Derived[float]
    inflated: Derived[float]
    clauses: tuple[Clause[float], ...]

    @property
    def compliant(self) -> bool:
        """Whether every clause holds."""
        return all(clause.holds for clause in self.clauses)

    @property
    def binding(self) -> Clause[float]:
        """The clause that takes up the largest part of what is declared for it."""
        return max(self.clauses, key=lambda clause: clause.required / clause.declared)

    @cached_property
    def agility(self) -> Agility:
        """Roll, pitch and thrust limits."""
        return Agility(
            self.terms.roll_max_rad, self.terms.pitch_max_rad, self.terms.thrust_to_weight
        )

    @cached_property
    def corridor(self) -> Corridor | None:
        """What has to be free for a drift back to the leg line; None where none is to be flown."""
        if not (self.compliant and self.terms.recentring_speed_mps > 0.0):
            return None
        drift = recentring_drift(self.terms, self.inflated, SCALAR)
        return Corridor.of(drift, self.terms.field_of_view_rad)

    def region_around(self, obstacle: Box, position_error_m: float) -> RegionOfInfluence:
        """Region of Influence of a measured obstacle, inflated as a plan needs it (theory B).

        Args:
            obstacle: the measured box, leg frame.
            position_error_m: of each face; at least the contract's is used.
        """
        terms = self.terms
        error_m = max(position_error_m, terms.position_error_m)
        inflated = obstacle.inflated(terms.radius_m + terms.tracking_error_m + error_m)
        return RegionOfInfluence.around(inflated, worst_encounter(terms, *inflated.size_m, SCALAR))


def assess(contract: Contract, input_set: InputSet = "inner") -> Assessment:
    """Hold a contract's requirements against what it declares.

    Args:
        contract: the contract.
        input_set: ``"inner"`` (sound) or ``"paper"`` (Eq. 7 as printed).
    """
    return assess_terms(contract, Terms.of(contract, input_set))


def assess_terms(contract: Contract, terms: Terms[float]) -> Assessment:
    """Hold a contract's requirements against other terms than it declares: what is seen in flight.

    Args:
        contract: the contract that the terms come from.
        terms: its numbers, some of them replaced.
    """
    inflated = derive(terms, SCALAR)
    agility = Agility(terms.roll_max_rad, terms.pitch_max_rad, terms.thrust_to_weight)
    return Assessment(
        contract=contract,
        terms=terms,
        limits=agility.acceleration_limits(terms.input_set),
        nominal=derive(terms.idealised(), SCALAR),
        inflated=inflated,
        clauses=clauses(terms, inflated, SCALAR),
    )
