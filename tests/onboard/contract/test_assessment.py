"""The clauses hold what they promise.

The numbers are derived a second time here, from the sentences of THEORY.md, for the boxes that a
contract file can describe; the promises are tried out on random obstacle fields.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onboard.contract import agility as agility_module
from onboard.contract.agility import AccelerationLimits, tilt_limits
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.assessment import Assessment, Terms, assess, assess_terms, clauses, derive
from onboard.files.contract_file import Contract, InputSet
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray

GRAVITY_MPS2 = 9.80665

DOCUMENT: dict[str, dict[str, Any]] = {
    "vehicle": {
        "roll_max_deg": 15.0,
        "pitch_max_deg": 15.0,
        "thrust_to_weight": 2.0,
        "cruise_speed_mps": 2.8,
        "radius_m": 0.30,
        "tracking_error_m": 0.25,
        "velocity_error_mps": [0.20, 0.10],
        "reaction_time_s": 0.15,
        "attitude_lag_s": 0.15,
        "setpoint_loss_timeout_s": 0.5,
        "setpoint_loss_run_on_m": None,
        "setpoint_loss_run_on_speed_mps": None,
        "setpoint_loss": None,
        "recentring_speed_mps": 0.0,
        "tracking_error_z_m": 1.0,
        "heading_error_deg": 0.0,
        "estimator_reset_max_m": 0.0,
        "drag_per_s": 0.45,
        "position_drift_mps": 0.0,
        "clearance_wish_m": 0.0,
        "rest_settle_s": 0.0,
        "rest_speed_mps": 0.2,
        "setpoint_loss_run_time_s": None,
        "radius_z_m": None,
        "height_drift_m": None,
        "height_drift_flight_m": None,
    },
    "requirements": {"stop": True, "passive_safety": True},
    "sensor": {
        "detection_range_m": 12.0,
        "field_of_view_deg": 120.0,
        "frame_age_max_s": 0.30,
        "position_error_m": 0.05,
        "thinnest_obstacle_m": None,
        "no_return_is_free_to_m": None,
        "all_round_range_m": 0.0,
        "position_error_z_m": None,
        "vertical_field_of_view_deg": None,
    },
    "environment": {
        "obstacle_size_max_m": 4.0,
        "obstacle_size_min_m": 0.0,
        "obstacle_separation_min_m": 20.0,
        "wind_max_mps": None,
        "terrain_max_m": 0.0,
        "terrain_error_m": 0.0,
        "movers": (),
    },
}


def contract(**changes: Any) -> Contract:
    """Return the example with some keys, which are unique among the sections, changed."""
    sections = {
        name: section | {key: changes.pop(key) for key in list(changes) if key in section}
        for name, section in DOCUMENT.items()
    }
    assert not changes, changes
    return Contract.model_validate(sections)


IDEAL: dict[str, Any] = {
    "radius_m": 0.0,
    "tracking_error_m": 0.0,
    "velocity_error_mps": [0.0, 0.0],
    "reaction_time_s": 0.0,
    "attitude_lag_s": 0.0,
    "position_error_m": 0.0,
    "heading_error_deg": 0.0,
    "wind_max_mps": None,
    "passive_safety": False,
}


@st.composite
def contracts(draw: st.DrawFn, stop: bool | None = None) -> Contract:
    size_max_m, speed_mps = draw(st.floats(0.2, 8.0)), draw(st.floats(0.3, 12.0))
    measured_faster = draw(st.none() | st.floats(1.0, 4.0))
    return contract(
        roll_max_deg=draw(st.floats(3.0, 45.0)),
        pitch_max_deg=draw(st.floats(3.0, 45.0)),
        cruise_speed_mps=speed_mps,
        radius_m=draw(st.floats(0.0, 1.0)),
        tracking_error_m=draw(st.floats(0.0, 1.0)),
        velocity_error_mps=[draw(st.floats(0.0, 0.8)), draw(st.floats(0.0, 0.8))],
        reaction_time_s=draw(st.floats(0.0, 0.5)),
        attitude_lag_s=draw(st.floats(0.0, 0.4)),
        setpoint_loss_timeout_s=draw(st.floats(0.0, 2.0)),
        setpoint_loss_run_on_m=draw(st.none() | st.floats(0.1, 8.0)),
        setpoint_loss_run_on_speed_mps=measured_faster and measured_faster * speed_mps,
        heading_error_deg=draw(st.just(0.0) | st.floats(0.0, 30.0)),
        drag_per_s=draw(st.floats(0.0, 1.0)),
        wind_max_mps=draw(st.none() | st.floats(0.0, 12.0)),
        position_error_m=draw(st.floats(0.0, 0.3)),
        frame_age_max_s=draw(st.floats(0.05, 1.0)),
        detection_range_m=draw(st.floats(1.0, 60.0)),
        obstacle_size_max_m=size_max_m,
        obstacle_size_min_m=draw(st.floats(0.0, size_max_m)),
        stop=draw(st.booleans()) if stop is None else stop,
        passive_safety=draw(st.booleans()),
    )


def face_error_m(terms: Contract) -> float:
    """e': the error of a corner, and the chord by which a heading error turns the farthest one."""
    corner_m = terms.sensor.detection_range_m
    corner_m += math.hypot(*[terms.environment.obstacle_size_max_m] * 2)
    half_rad = math.radians(terms.vehicle.heading_error_deg) / 2.0
    turned_m = 2.0 * corner_m * math.sin(half_rad)
    return math.sqrt(2.0) * terms.sensor.position_error_m + turned_m


INPUT_SETS: st.SearchStrategy[InputSet] = st.sampled_from(["inner", "paper"])


class Expected:
    """What follows for a contract that swerves, from the theory without looking at the code."""

    def __init__(self, terms: Contract, input_set: InputSet) -> None:
        vehicle, sensor, world = terms.vehicle, terms.sensor, terms.environment
        slope_x = math.tan(math.radians(vehicle.pitch_max_deg))
        slope_y = math.tan(math.radians(vehicle.roll_max_deg))
        self.x_mps2 = b = GRAVITY_MPS2 * slope_x
        self.y_mps2 = u = GRAVITY_MPS2 * slope_y
        if input_set == "paper":
            self.y_mps2 = u = u / math.cos(math.radians(vehicle.pitch_max_deg))
        wind_mps = world.wind_max_mps
        self.trim_mps2 = 0.0 if wind_mps is None else vehicle.drag_per_s * wind_mps
        self.still_mps2 = min(b, u)
        if self.trim_mps2 < self.still_mps2:
            self.x_mps2, self.y_mps2 = b, u = b - self.trim_mps2, u - self.trim_mps2
        self.speed_mps = v = vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0]
        w, lag_s = vehicle.velocity_error_mps[1], vehicle.attitude_lag_s
        body_m = vehicle.radius_m + vehicle.tracking_error_m
        self.margin_m = body_m + 2.0 * face_error_m(terms)
        size_m = world.obstacle_size_max_m + 2.0 * self.margin_m
        clear_s = math.sqrt(size_m / u)
        if w > u * clear_s:
            clear_s = (math.sqrt(2.0 * w * w + 2.0 * u * size_m) - w) / u
        self.flat = v / b <= clear_s
        t_m = v / b if self.flat else clear_s
        self.depth_m = v * t_m - b * t_m * t_m / 2.0
        stopping_m = v * v / (2.0 * b)

        self.run_m, self.coast_s = run_m, _ = self.run_on(terms, b, v)
        front_m = run_m + self.depth_m + v * (vehicle.reaction_time_s + lag_s)
        crossing_mps = math.sqrt((w + u * t_m) ** 2 + 2.0 * u * w * lag_s)
        peak_mps = crossing_mps + u * lag_s
        overhang_m = max(
            crossing_mps * lag_s + u * lag_s**2 / 2.0 + peak_mps**2 / (2.0 * u),
            2.0 * w * lag_s + w * w / u,
        )
        self.lane_m = overhang_m + peak_mps * self.coast_s
        swerving_m = swerving_distance_m(v, b, w / u / 2.0, t_m + lag_s)
        recovery_m = max(stopping_m, swerving_m) + 2.0 * v * lag_s
        self.pob_m = max(size_m, recovery_m - run_m)
        behind_m = recovery_m - run_m - (world.obstacle_size_min_m / 2.0 + body_m)
        self.length_m = front_m + size_m / 2.0 + max(behind_m, size_m / 2.0)
        self.width_m = size_m + 2.0 * self.lane_m

        before_m = self.margin_m + vehicle.tracking_error_m
        ahead_m = before_m + front_m - run_m
        self.detection_m = ahead_m + run_m
        # The far corner of a front that it would only just touch.
        edge_m = self.margin_m + world.obstacle_size_max_m + w * lag_s + w * w / (2.0 * u)
        self.stopping_m = stopping_m + v * (vehicle.reaction_time_s + lag_s)
        silent_s = sensor.frame_age_max_s + 0.02 + lag_s
        self.required = {
            "thrust": math.hypot(1.0, slope_x, slope_y, slope_x * slope_y),
            "detection_range": ahead_m,
            "edge_visibility": math.hypot(ahead_m, edge_m),
            "field_of_view": 2.0
            * (
                math.degrees(math.asin(min(1.0, edge_m / sensor.detection_range_m)))
                + vehicle.heading_error_deg
            ),
            "separation": math.hypot(self.length_m, self.width_m),
        }
        if wind_mps is not None:
            self.required["wind"] = self.trim_mps2
        if terms.requirements.stop:
            self.required |= {
                "stop": before_m + self.stopping_m,
                "sensor_silence": before_m + stopping_m + v * silent_s,
                "seen_free_view": 90.0 + 2.0 * vehicle.heading_error_deg,
            }
        if terms.requirements.passive_safety:
            self.required["passive_safety"] = math.hypot(self.detection_m, edge_m)

    @staticmethod
    def run_on(terms: Contract, b: float, v: float) -> tuple[float, float]:
        """Run after the stream is lost, and the time for which the autopilot coasts."""
        vehicle, timeout_s = terms.vehicle, terms.vehicle.setpoint_loss_timeout_s
        measured_m = vehicle.setpoint_loss_run_on_m
        if not terms.requirements.passive_safety:
            return 0.0, 0.0
        if measured_m is None:
            return v * timeout_s + v * v / (2.0 * b), timeout_s
        then_mps = vehicle.setpoint_loss_run_on_speed_mps
        assert then_mps is not None
        then_mps += vehicle.velocity_error_mps[0]
        coast_s = max(0.0, (measured_m - then_mps**2 / (2.0 * b)) / then_mps)
        # Held acceleration from rest, lag, braking; the rest of the run goes with speed.
        gained_mps = b * timeout_s
        rest_m = gained_mps * (timeout_s / 2.0 + vehicle.attitude_lag_s)
        rest_m = min(rest_m + gained_mps**2 / (2.0 * b), measured_m)
        return rest_m + (measured_m - rest_m) * v / then_mps, coast_s


def swerving_distance_m(
    speed_mps: float, brake_mps2: float, more_s: float, longest_s: float
) -> float:
    """Way behind the front face: brake for t before and ``more_s`` after it, speed up; worst t."""
    stop_s = speed_mps / brake_mps2
    before_s = np.linspace(0.0, min(stop_s, longest_s), 2001)
    before_s = np.append(before_s, np.clip(stop_s - 2.0 * more_s, 0.0, longest_s))
    crossed_m, braked_m = (
        speed_mps * braked_s - brake_mps2 * braked_s**2 / 2.0
        for braked_s in (np.minimum(before_s, stop_s), np.minimum(before_s + more_s, stop_s))
    )
    return float((2.0 * braked_m - crossed_m).max())


@given(contracts(), INPUT_SETS)
def test_everything_derived_again(terms: Contract, input_set: InputSet) -> None:
    """The published form, of whatever swerves without stopping."""
    assume(input_set == "paper" or not terms.requirements.stop)
    assessment, expected = assess(terms, input_set), Expected(terms, input_set)
    derived, region = assessment.inflated, assessment.inflated.region
    assert assessment.limits.brake_mps2 == pytest.approx(expected.x_mps2)
    assert assessment.limits.right_mps2 == pytest.approx(expected.y_mps2)
    assert derived.encounter.speed_mps == pytest.approx(expected.speed_mps)
    assert derived.margin_m == pytest.approx(expected.margin_m)
    assert region.flat == expected.flat
    assert region.collision_set_depth_m == pytest.approx(expected.depth_m)
    assert region.overhang_left_m + region.coast_left_m == pytest.approx(expected.lane_m)
    assert region.overhang_right_m + region.coast_right_m == pytest.approx(expected.lane_m)
    assert region.pob_depth_m == pytest.approx(expected.pob_m)
    assert derived.roi_length_m == pytest.approx(expected.length_m)
    assert derived.roi_width_m == pytest.approx(expected.width_m)
    assert derived.required_detection_range_m == pytest.approx(expected.detection_m)
    assert derived.stopping_distance_m == pytest.approx(expected.stopping_m)
    assert derived.encounter.run_on_m == pytest.approx(expected.run_m)
    assert derived.encounter.coast_time_s == pytest.approx(expected.coast_s)
    assert derived.manoeuvre_encounter is derived.encounter
    assert derived.manoeuvre is region
    assert derived.manoeuvre_width_m == derived.roi_width_m
    assert derived.required_separation_box_m == (derived.roi_length_m, derived.roi_width_m)
    declared = {clause.name: clause.declared for clause in assessment.clauses}
    assert declared.get("wind", expected.still_mps2) == pytest.approx(expected.still_mps2)
    required = {clause.name: clause.required for clause in assessment.clauses}
    assert required == pytest.approx(expected.required)


def test_what_is_declared() -> None:
    declared = {clause.name: clause.declared for clause in assess(contract()).clauses}
    expected = dict.fromkeys(
        ("detection_range", "edge_visibility", "stop", "sensor_silence", "passive_safety"), 12.0
    )
    expected |= dict.fromkeys(("field_of_view", "seen_free_view"), 120.0)
    assert declared == pytest.approx(expected | {"thrust": 2.0, "separation": 20.0})


def test_checked_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The worked example of the theory: 15°, 2.8 m/s, 4 m, the paper's box, g = 9.81 m/s²."""
    monkeypatch.setattr(agility_module, "GRAVITY_MPS2", 9.81)
    assessment = assess(contract(**IDEAL), "paper")
    for derived in (assessment.nominal, assessment.inflated):
        assert derived.region.collision_set_depth_m == pytest.approx(1.4913, abs=5e-5)
        assert derived.region.overhang_right_m == pytest.approx(1.5439, abs=5e-5)
        assert derived.roi_length_m == pytest.approx(5.4913, abs=5e-5)
        assert derived.roi_width_m == pytest.approx(7.0878, abs=1e-4)
        separation_m = math.hypot(5.4913, 7.0878)
        assert derived.required_separation_m == pytest.approx(separation_m, abs=1e-4)


@given(contracts(), INPUT_SETS)
def test_nominal_reading_is_that_of_an_ideal_vehicle(terms: Contract, input_set: InputSet) -> None:
    kept = (terms.vehicle, terms.sensor, terms.environment)
    document = {key: value for section in kept for key, value in section.model_dump().items()}
    ideal = assess(contract(**(document | IDEAL), stop=False), input_set)
    assert assess(terms, input_set).nominal == ideal.nominal
    assert ideal.nominal == ideal.inflated


def test_inner_and_paper_set_differ_sideways_only() -> None:
    inner, paper = assess(contract(), "inner"), assess(contract(), "paper")
    assert inner.terms.input_set == "inner"
    assert assess(contract()).limits == inner.limits
    assert inner.limits.brake_mps2 == paper.limits.brake_mps2
    assert paper.limits.right_mps2 == pytest.approx(
        inner.limits.right_mps2 / math.cos(math.radians(15.0))
    )
    for assessment in (inner, paper):
        x_mps2, y_mps2 = tilt_limits(assessment.terms, SCALAR)
        assert assessment.limits == AccelerationLimits(x_mps2, x_mps2, y_mps2, y_mps2)


@given(contracts(), INPUT_SETS)
def test_the_encounter_flies_the_box_of_the_agility(terms: Contract, input_set: InputSet) -> None:
    assessment = assess(terms, input_set)
    for name, limit_mps2 in vars(assessment.limits).items():
        assert getattr(assessment.inflated.encounter, name) == pytest.approx(limit_mps2)


def test_angles_are_converted_once() -> None:
    terms = assess(contract(roll_max_deg=10.0, pitch_max_deg=20.0)).terms
    assert terms.roll_max_rad == pytest.approx(math.radians(10.0))
    assert terms.pitch_max_rad == pytest.approx(math.radians(20.0))
    assert terms.field_of_view_rad == pytest.approx(math.radians(120.0))


# --- verdict


def test_a_declared_value_must_exceed_what_is_required() -> None:
    free = assess(contract())
    for key, name in (
        ("obstacle_separation_min_m", "separation"),
        ("detection_range_m", "passive_safety"),
        ("thrust_to_weight", "thrust"),
    ):
        required = next(clause.required for clause in free.clauses if clause.name == name)
        for value, complies in ((required, False), (math.nextafter(required, 1e9), True)):
            assessment = assess(contract(**{key: value}))
            assert assessment.compliant is complies
            clause = next(clause for clause in assessment.clauses if clause.name == name)
            assert clause.holds is complies
            assert clause.margin == clause.declared - clause.required
            assert assessment.binding is clause


def test_field_of_view_that_is_too_narrow_is_refused() -> None:
    swerves: dict[str, Any] = {"stop": False, "obstacle_separation_min_m": 50.0}
    required_deg = clause_of(assess(contract(**swerves)), "field_of_view").required
    assert not assess(contract(**swerves, field_of_view_deg=0.999 * required_deg)).compliant
    assert assess(contract(**swerves, field_of_view_deg=1.001 * required_deg)).compliant


@pytest.mark.parametrize("heading_error_deg", [0.0, 3.0])
def test_what_looks_aside_sees_half_a_right_angle_to_either_side(heading_error_deg: float) -> None:
    """Whatever the heading error: 2 beta - 2 psi >= 90°, with 90° itself enough."""
    for view_deg, holds in ((90.0, True), (89.9, False)):
        assessment = assess(
            contract(
                heading_error_deg=heading_error_deg,
                field_of_view_deg=view_deg + 2.0 * heading_error_deg,
            )
        )
        clause = clause_of(assessment, "seen_free_view")
        assert clause.holds is holds
        assert clause.concerns == "safety"


def test_binding_clause_of_a_contract_that_requires_nothing_of_the_sensor() -> None:
    """A point mass with room to stop needs no field of view at all: that must not divide by 0."""
    assessment = assess(contract(**IDEAL))
    field_of_view = next(c for c in assessment.clauses if c.name == "field_of_view")
    assert field_of_view.required == 0.0
    assert assessment.binding.name in {"thrust", "separation", "seen_free_view"}


def test_clauses_may_be_switched_off() -> None:
    def names(**changes: bool) -> set[str]:
        return {clause.name for clause in assess(contract(**changes)).clauses}

    everything = names(stop=True, passive_safety=True)
    assert everything - names(stop=False) == {"stop", "sensor_silence", "seen_free_view"}
    assert everything - names(passive_safety=False) == {"passive_safety"}


def test_clauses_are_on_unless_switched_off() -> None:
    values: dict[str, Any] = {field.name: 1.0 for field in fields(Terms)}
    for name in ("stop", "passive_safety", "input_set", "setpoint_loss_model", "separation_shares"):
        del values[name]
    terms: Terms[float] = Terms(**values)
    assert (terms.stop, terms.passive_safety, terms.input_set) == (True, True, "inner")


def test_reasons_are_sentences_for_an_operator() -> None:
    for clause in assess(contract()).clauses:
        assert 30 < len(clause.reason) < 100
        assert clause.reason[0].islower()
        assert not any(character in clause.reason for character in "_=<>Φρτ")


# --- height, wind, heading


def clause_of(assessment: Assessment, name: str) -> Any:
    return next(clause for clause in assessment.clauses if clause.name == name)


def test_the_ground_is_cleared_by_size_error_and_reset_strictly() -> None:
    terms = contract(radius_m=0.4, tracking_error_z_m=0.7, estimator_reset_max_m=0.3)
    assert "ground_clearance" not in {clause.name for clause in assess(terms).clauses}
    needed_m = 0.4 + 0.7 + 0.3
    for altitude_m, holds in (
        (needed_m, False),
        (math.nextafter(needed_m, 2.0), True),
        (0.1, False),
    ):
        assessment = assess(terms, mission_altitude_m=altitude_m)
        clause = clause_of(assessment, "ground_clearance")
        assert (clause.required, clause.declared) == (pytest.approx(1.4), altitude_m)
        assert clause.holds is assessment.compliant is holds
    low = assess(terms).at_altitude(1.0)
    assert not low.compliant
    assert low.at_altitude(2.0).compliant


def test_a_vehicle_at_the_clauses_height_does_not_touch_the_ground() -> None:
    """However it is tilted, and however far below its reference."""
    terms = contract(radius_m=0.4, tracking_error_z_m=0.7)
    altitude_m = clause_of(assess(terms, mission_altitude_m=9.0), "ground_clearance").required
    rim_rad = np.linspace(0.0, 2.0 * math.pi, 91)
    lowest_m = [
        altitude_m - 0.7 - (0.4 * np.sin(tilt_rad) * np.cos(rim_rad)).max()
        for tilt_rad in np.linspace(0.0, math.pi / 2.0, 91)
    ]
    assert min(lowest_m) == pytest.approx(0.0, abs=1e-12)


def test_wind_takes_its_trim_from_every_limit() -> None:
    still, windy = assess(contract()), assess(contract(drag_per_s=0.4, wind_max_mps=2.0))
    for name, limit_mps2 in vars(still.limits).items():
        assert getattr(windy.limits, name) == pytest.approx(limit_mps2 - 0.8)
    assert windy.reserved_trim_mps2 == pytest.approx(0.8)
    assert still.reserved_trim_mps2 == 0.0
    assert windy.nominal == still.nominal
    assert windy.inflated.required_separation_m > still.inflated.required_separation_m


@pytest.mark.parametrize("input_set", ["inner", "paper"])
def test_wind_from_anywhere_leaves_what_is_planned_within_the_tilt(input_set: InputSet) -> None:
    still = assess(contract(roll_max_deg=20.0), input_set).limits
    windy = assess(contract(roll_max_deg=20.0, drag_per_s=0.4, wind_max_mps=3.0), input_set)
    used: list[float] = []
    for direction_rad in np.linspace(0.0, 2.0 * math.pi, 73):
        trim_mps2 = 1.2 * np.array((math.cos(direction_rad), math.sin(direction_rad)))
        for corner in np.array(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            planned = corner * (windy.limits.forward_mps2, windy.limits.right_mps2)
            total = np.abs(planned + trim_mps2) / (still.forward_mps2, still.right_mps2)
            used.append(float(total.max()))
    assert max(used) == pytest.approx(1.0)


def test_wind_that_takes_all_the_tilt_breaks_its_clause_and_no_formula() -> None:
    still = assess(contract())
    limit_mps2 = still.limits.brake_mps2
    for wind_mps, holds in (
        (math.nextafter(limit_mps2, 0.0), True),
        (limit_mps2, False),
        (100.0, False),
    ):
        assessment = assess(contract(drag_per_s=1.0, wind_max_mps=wind_mps))
        assert clause_of(assessment, "wind").holds is holds
        assert not assessment.compliant
        if not holds:
            assert assessment.binding.name == "wind"
            assert assessment.limits == still.limits


@given(contracts(), st.integers(0, 2**32))
def test_a_turned_body_displaces_no_face_by_more_than_allowed(terms: Contract, seed: int) -> None:
    """Boxes within range, seen by a vehicle whose heading is off, placed on its estimate."""
    random, heading_rad = np.random.default_rng(seed), math.radians(terms.vehicle.heading_error_deg)
    error_m, sensed_m = assess(terms).face_error_m, terms.sensor.position_error_m
    size_max_m = terms.environment.obstacle_size_max_m
    for _ in range(20):
        size_m = random.choice((random.uniform(0.0, size_max_m), size_max_m), 2)
        bearing_rad = random.uniform(-math.pi, math.pi)
        near = terms.sensor.detection_range_m * np.array(
            (math.cos(bearing_rad), math.sin(bearing_rad))
        )
        # Its nearest corner is just within range; the vehicle is the origin.
        low = np.where(near >= 0.0, near, near - size_m)
        corners = low + size_m * np.array(((0, 0), (0, 1), (1, 1), (1, 0)))
        turn_rad = random.choice((-heading_rad, heading_rad))
        cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
        placed = corners @ np.array(((cosine, sine), (-sine, cosine)))
        off_m = np.concatenate(
            (placed.min(axis=0) - corners.min(axis=0), placed.max(axis=0) - corners.max(axis=0))
        )
        assert np.abs(off_m).max() + math.sqrt(2.0) * sensed_m <= error_m + 1e-9


def test_the_error_of_a_turned_body_is_not_overstated() -> None:
    """The far corner of a square seen at the edge of the range, diagonally: all of it is needed."""
    assessment = assess(contract(heading_error_deg=20.0))
    corner_m = (12.0 + math.sqrt(2.0) * 4.0) / math.sqrt(2.0)
    # Turned so that the chord lies along an axis.
    bearing_rad = math.pi / 4.0 + math.radians(10.0)
    far_m = corner_m * math.sqrt(2.0)
    before, after = (
        far_m * math.cos(bearing_rad + turn_rad) for turn_rad in (0.0, math.radians(20.0))
    )
    assert (
        assessment.face_error_m - 0.05 * math.sqrt(2.0)
        >= abs(after - before)
        > 0.8 * (assessment.face_error_m - 0.05 * math.sqrt(2.0))
    )


# --- promises


def measured(box: Box, error_m: float, random: np.random.Generator) -> Box:
    """The box as a sensor may report it: every face off by up to the error."""
    off_m = random.choice((-1.0, 0.0, 1.0), 4) * error_m
    return Box(
        box.x_min_m + off_m[0],
        max(box.x_max_m + off_m[1], box.x_min_m + off_m[0]),
        box.y_min_m + off_m[2],
        max(box.y_max_m + off_m[3], box.y_min_m + off_m[2]),
    )


def centred(x_m: float, y_m: float, size_m: FloatArray) -> Box:
    half_x_m, half_y_m = size_m / 2.0
    return Box(x_m - half_x_m, x_m + half_x_m, y_m - half_y_m, y_m + half_y_m)


def regions_touch(assessment: Assessment, first: Box, second: Box) -> bool:
    one, other = (assessment.region_around(box, 0.0) for box in (first, second))
    assert one.conflicts_with(other) == other.conflicts_with(one)
    return one.conflicts_with(other)


@given(contracts(), st.integers(0, 2**32))
def test_regions_are_disjoint_at_the_separation(terms: Contract, seed: int) -> None:
    """Any two obstacles of allowed sizes, in any direction, measured as badly as allowed."""
    assessment, random = assess(terms), np.random.default_rng(seed)
    world, error_m = terms.environment, face_error_m(terms)
    thin_m, thick_m = world.obstacle_size_min_m, world.obstacle_size_max_m
    apart_m = assessment.inflated.required_separation_m * (1.0 + 1e-9)
    along_m, across_m = assessment.inflated.required_separation_box_m
    corner_rad = math.atan2(across_m, along_m)
    for _ in range(20):
        direction_rad = random.choice((corner_rad, -corner_rad, random.uniform(-math.pi, math.pi)))
        sizes_m = random.choice((thin_m, thick_m), (2, 2))
        # Across the leg an obstacle may be thinner than along it.
        sizes_m[:, 1] = random.choice((0.0, thick_m), 2)
        boxes = (
            centred(0.0, 0.0, sizes_m[0]),
            centred(
                apart_m * math.cos(direction_rad), apart_m * math.sin(direction_rad), sizes_m[1]
            ),
        )
        first, second = (measured(box, error_m, random) for box in boxes)
        assert not regions_touch(assessment, first, second)


@given(contracts(), st.sampled_from([-1.0, 1.0]))
def test_the_separation_is_tight(terms: Contract, side: float) -> None:
    """Diagonally nearer by a hair, the worst pair's regions do meet."""
    assessment = assess(terms)
    derived, world = assessment.inflated, terms.environment
    thick_m, error_m = world.obstacle_size_max_m, face_error_m(terms)
    # The near one is thin and measured too far away, or thick and measured too near.
    along_m, across_m = derived.required_separation_box_m
    x_m, y_m = along_m * (1.0 - 1e-9), side * across_m * (1.0 - 1e-9)
    far = centred(x_m, y_m, np.array((thick_m, thick_m))).inflated(error_m)
    thin_half_m, thick_half_m = world.obstacle_size_min_m / 2.0, thick_m / 2.0
    wide_m = thick_half_m + error_m
    thick = Box(-wide_m, wide_m, -wide_m, wide_m)
    thin = Box(
        min(error_m - thin_half_m, thin_half_m + error_m), thin_half_m + error_m, -wide_m, wide_m
    )
    assert regions_touch(assessment, thick, far) or regions_touch(assessment, thin, far)


def test_largest_of_length_and_width_is_no_separation() -> None:
    """Erratum 11: max(L_x, L_y) is unsafe on the diagonal."""
    assessment = assess(contract(stop=False))
    derived = assessment.inflated
    apart_m = 1.001 * max(derived.roi_length_m, derived.roi_width_m)
    direction_rad = math.atan2(derived.roi_width_m, derived.roi_length_m)
    size_m = np.array((4.0, 4.0))
    far = centred(apart_m * math.cos(direction_rad), apart_m * math.sin(direction_rad), size_m)
    assert regions_touch(assessment, centred(0.0, 0.0, size_m), far)


def test_two_largest_obstacles_are_not_the_worst_pair() -> None:
    """Erratum 11: 0.05 by 4 m, then 4 by 4 m, 6 m/s, 15°."""
    fast = IDEAL | {"cruise_speed_mps": 6.0, "stop": False}
    thick_only = assess(contract(**fast, obstacle_size_min_m=4.0)).inflated
    assessment = assess(contract(**fast, obstacle_size_min_m=0.05))
    assert assessment.inflated.roi_length_m > thick_only.roi_length_m + 1.0
    far = centred(thick_only.roi_length_m + 0.1, 0.0, np.array((4.0, 4.0)))
    assert regions_touch(assessment, centred(0.0, 0.0, np.array((0.05, 4.0))), far)
    assert not regions_touch(assessment, centred(0.0, 0.0, np.array((4.0, 4.0))), far)


@given(contracts())
def test_a_region_uses_the_larger_position_error(terms: Contract) -> None:
    assessment = assess(terms)
    box, declared_m = Box(20.0, 22.0, -1.0, 2.0), face_error_m(terms)
    body_m = terms.vehicle.radius_m + terms.vehicle.tracking_error_m
    for error_m in (0.0, declared_m, declared_m + 0.3):
        region = assessment.region_around(box, error_m)
        used_m = max(error_m, declared_m)
        inflated = box.inflated(body_m + used_m)
        assert vars(region.obstacle) == pytest.approx(vars(inflated))


@given(contracts())
def test_the_largest_measured_obstacle_has_the_contracts_region(terms: Contract) -> None:
    assessment = assess(terms)
    half_m = terms.environment.obstacle_size_max_m / 2.0 + face_error_m(terms)
    box = Box(30.0 - half_m, 30.0 + half_m, -half_m, half_m)
    region, found = assessment.region_around(box, 0.0), assessment.inflated
    inflated = region.obstacle
    for placed, size in ((region.extent, found.region), (region.manoeuvre, found.manoeuvre)):
        assert inflated.x_min_m - placed.x_min_m == pytest.approx(size.front_m)
        assert placed.x_max_m - inflated.x_min_m == pytest.approx(size.pob_depth_m)
        beside_m = size.overhang_left_m + size.coast_left_m
        assert inflated.y_min_m - placed.y_min_m == pytest.approx(beside_m)
        assert placed.y_max_m - inflated.y_max_m == pytest.approx(beside_m)
    size = found.manoeuvre
    assert region.x_pob_m - inflated.x_min_m == pytest.approx(size.pob_depth_m)
    assert inflated.y_min_m - region.lane_left_m == pytest.approx(size.overhang_left_m)
    assert region.lane_right_m - inflated.y_max_m == pytest.approx(size.overhang_right_m)
    assert inflated.x_min_m - region.keep_out.x_min_m == pytest.approx(
        assessment.inflated.manoeuvre_encounter.run_on_m
    )


HARDER = (
    "cruise_speed_mps",
    "velocity_error_x_mps",
    "velocity_error_y_mps",
    "radius_m",
    "tracking_error_m",
    "reaction_time_s",
    "attitude_lag_s",
    "setpoint_loss_timeout_s",
    "position_error_m",
    "heading_error_rad",
    "drag_per_s",
    "wind_max_mps",
    "tracking_error_z_m",
    "estimator_reset_max_m",
    "obstacle_size_max_m",
)


@given(contracts(), st.sampled_from(HARDER), st.floats(1e-6, 1.0))
def test_a_harder_contract_never_requires_less(terms: Contract, name: str, by: float) -> None:
    # What is read out of a measured run depends on all the rest of what is declared.
    before = replace(Terms.of(terms, mission_altitude_m=5.0), setpoint_loss_run_on_m=None)
    if name == "wind_max_mps" and before.wind_max_mps is None:
        before = replace(before, wind_max_mps=0.0)
    after = replace(before, **{name: getattr(before, name) + by})
    derived_before, derived_after = derive(before, SCALAR), derive(after, SCALAR)
    required = {clause.name: clause.required for clause in clauses(before, derived_before, SCALAR)}
    # What lies farther ahead may be seen under a smaller angle; and once stopping is quicker than
    # passing, the edge to pass need not be seen any more.
    exempt = {"field_of_view"}
    if derived_before.region.flat != derived_after.region.flat:
        exempt |= {"edge_visibility", "passive_safety"}
    if name == "attitude_lag_s" and before.stop:
        # What takes its acceleration back more slowly has less speed to gain from it.
        exempt |= {"passive_safety", "separation"}
    if name in {"drag_per_s", "wind_max_mps"}:
        # Wind takes acceleration: a weaker swerve is slower sideways, and may need less width.
        exempt |= {"separation"}
    found = clauses(after, derived_after, SCALAR)
    if any(clause.name == "wind" and not clause.holds for clause in found):
        # Where the wind leaves nothing, the other clauses are read in still air.
        exempt = required.keys() - {"wind"}
    for clause in found:
        if clause.name not in exempt:
            assert clause.required >= required[clause.name] - 1e-9, clause.name


def as_arrays(scalar: Terms[float], count: int) -> Terms[FloatArray]:
    values: dict[str, Any] = {f.name: getattr(scalar, f.name) for f in fields(Terms)}
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = np.full(count, value)
    return Terms(**values)


@given(contracts(), INPUT_SETS)
def test_arrays_and_floats_agree(terms: Contract, input_set: InputSet) -> None:
    array = as_arrays(Terms.of(terms, input_set), 2)
    many = clauses(array, derive(array, ARRAY), ARRAY)
    for clause, expected in zip(many, assess(terms, input_set).clauses, strict=True):
        assert clause.name == expected.name
        np.testing.assert_allclose(clause.required, np.full(2, expected.required), rtol=1e-12)
        np.testing.assert_array_equal(clause.holds, np.full(2, expected.holds))


@given(contracts(), st.floats(0.05, 1.0))
def test_a_slower_cruise_never_requires_more_with_a_measured_run(
    terms: Contract, share: float
) -> None:
    measured = replace(
        Terms.of(terms),
        setpoint_loss_run_on_m=terms.vehicle.setpoint_loss_run_on_m or 4.0,
        setpoint_loss_run_on_speed_mps=terms.vehicle.cruise_speed_mps,
        passive_safety=True,
    )
    slower = replace(measured, cruise_speed_mps=share * measured.cruise_speed_mps)
    fast, slow = derive(measured, SCALAR), derive(slower, SCALAR)
    slow_e, fast_e = slow.manoeuvre_encounter, fast.manoeuvre_encounter
    assert slow_e.run_on_m <= fast_e.run_on_m + 1e-9
    assert slow_e.coast_time_s == fast_e.coast_time_s
    assert slow.required_separation_m <= fast.required_separation_m + 1e-9
    assert slow.required_detection_range_m <= fast.required_detection_range_m + 1e-9


@dataclass(frozen=True)
class LostStream:
    """Ways in which an autopilot may run on; none of the formulas of the contract."""

    kind: str
    held_s: float
    lag_s: float
    brake_mps2: float
    gain_s: float

    def run_m(self, speed_mps: FloatArray, acceleration_mps2: FloatArray) -> FloatArray:
        """Way made after the last setpoint had this speed and forward acceleration."""
        v, a, b = speed_mps, acceleration_mps2, self.brake_mps2
        if self.kind == "flies on to the last position":
            return self.gain_s * v + self.gain_s * self.held_s * a / 4.0
        if self.kind == "keeps the velocity":
            a = 0.0 * a
        gained = v + a * self.held_s
        covered_m: FloatArray = v * self.held_s + a * self.held_s**2 / 2.0
        return covered_m + gained * self.lag_s + gained**2 / (2.0 * b)


def states(speed_mps: float, limit_mps2: float, jerk_mps3: float) -> tuple[FloatArray, FloatArray]:
    """Fastest speeds at which a cruise may still accelerate by so much, and how much."""
    a = np.linspace(0.0, min(limit_mps2, math.sqrt(2.0 * jerk_mps3 * speed_mps)), 101)
    return np.maximum(speed_mps - a * a / (2.0 * jerk_mps3), 0.0), a


@given(
    st.builds(
        LostStream,
        st.sampled_from(
            ["keeps the acceleration", "keeps the velocity", "flies on to the last position"]
        ),
        st.floats(0.0, 1.5),
        st.floats(0.0, 0.4),
        st.floats(2.6277, 12.0),
        st.floats(0.0, 2.0),
    ),
    st.floats(0.5, 8.0),
    st.floats(0.02, 1.0),
)
def test_the_scaled_run_covers_every_state_below(
    autopilot: LostStream, speed_mps: float, share: float
) -> None:
    """Theory H: measured over a flight at one speed, it covers every flight at less."""
    lag_s = max(autopilot.lag_s, 0.05)
    given_terms: dict[str, Any] = {
        "setpoint_loss_timeout_s": autopilot.held_s,
        "attitude_lag_s": lag_s,
        "velocity_error_mps": [0.0, 0.0],
    }
    limit_mps2 = assess(contract()).limits.forward_mps2
    jerk_mps3 = limit_mps2 / lag_s
    measured_m = float(autopilot.run_m(*states(speed_mps, limit_mps2, jerk_mps3)).max())
    slower = assess(
        contract(
            cruise_speed_mps=share * speed_mps,
            setpoint_loss_run_on_m=measured_m,
            setpoint_loss_run_on_speed_mps=speed_mps,
            **given_terms,
        )
    )
    # The same accelerations: those of the faster flight, where it reaches them at all.
    fastest_mps, acceleration_mps2 = states(share * speed_mps, limit_mps2, jerk_mps3)
    runs_m = autopilot.run_m(fastest_mps, acceleration_mps2)
    assert slower.inflated.manoeuvre_encounter.run_on_m >= float(runs_m.max()) * (1.0 - 1e-3) - 1e-9


def test_a_run_in_proportion_to_the_speed_is_too_short() -> None:
    """What holds the last acceleration runs on from rest as well."""
    autopilot = LostStream("keeps the acceleration", 1.0, 0.15, 2.6277, 0.0)
    fast_m, slow_m = (
        float(autopilot.run_m(*states(speed_mps, 2.6277, 2.6277 / 0.15)).max())
        for speed_mps in (4.0, 1.0)
    )
    assert slow_m > 1.2 * fast_m * 1.0 / 4.0


def test_a_measured_run_is_unknown_above_its_speed() -> None:
    measured = {"setpoint_loss_run_on_m": 3.4, "setpoint_loss_run_on_speed_mps": 2.8}
    at_speed = Terms.of(contract(**measured))
    faster = replace(at_speed, cruise_speed_mps=math.nextafter(2.8, 3.0))
    assert not assess_terms(contract(**measured), faster).compliant
    speeds_mps = np.array((1.0, 2.8, 2.9))
    array = replace(as_arrays(at_speed, 3), cruise_speed_mps=speeds_mps)
    derived = derive(array, ARRAY)
    np.testing.assert_array_equal(np.isnan(derived.encounter.run_on_m), (False, False, True))
    np.testing.assert_array_equal(np.isnan(derived.required_separation_m), (False, False, True))
    holds = {clause.name: clause.holds for clause in clauses(array, derived, ARRAY)}
    for name in ("passive_safety", "separation"):
        assert not holds[name][2]
    # Without passive safety the run is not counted on.
    bare = replace(array, passive_safety=False)
    assert not np.isnan(derive(bare, ARRAY).required_separation_m).any()


def test_a_measured_run_on_replaces_the_model() -> None:
    model = assess(contract(stop=False)).inflated
    assert model.encounter.run_on_m == pytest.approx(
        3.0 * 0.5 + 9.0 / (2.0 * model.encounter.brake_mps2)
    )
    measured_m = model.encounter.run_on_m
    same = assess(contract(stop=False, setpoint_loss_run_on_m=measured_m)).inflated
    assert same.encounter.coast_time_s == pytest.approx(0.5)
    assert same.required_separation_m == pytest.approx(model.required_separation_m)
    short = assess(contract(stop=False, setpoint_loss_run_on_m=0.5)).inflated
    assert (short.encounter.run_on_m, short.encounter.coast_time_s) == (0.5, 0.0)
