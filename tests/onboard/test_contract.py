"""The clauses hold what they promise.

The numbers are derived a second time here, from the sentences of THEORY.md, for the boxes that a
contract file can describe; the promises are tried out on random obstacle fields.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard import contract as contract_module
from onboard.agility import AccelerationLimits, InputSet
from onboard.config import Contract
from onboard.contract import Assessment, Terms, _edge_offset, assess, clauses, derive
from onboard.frames import FloatArray
from onboard.region import ARRAY, SCALAR, Box, Encounter, dimensions

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
        "recentring_speed_mps": 0.0,
    },
    "requirements": {"stop": True, "passive_safety": True},
    "sensor": {
        "detection_range_m": 12.0,
        "field_of_view_deg": 120.0,
        "frame_age_max_s": 0.30,
        "position_error_m": 0.05,
    },
    "environment": {
        "obstacle_size_max_m": 4.0,
        "obstacle_size_min_m": 0.0,
        "obstacle_separation_min_m": 20.0,
    },
}


def contract(**changes: Any) -> Contract:
    """Return the example with some keys, which are unique among the sections, changed."""
    sections = {
        name: section | {key: changes.pop(key) for key in list(changes) if key in section}
        for name, section in DOCUMENT.items()
    }
    if "setpoint_loss_run_on_m" in changes:
        sections["vehicle"]["setpoint_loss_run_on_m"] = changes.pop("setpoint_loss_run_on_m")
    assert not changes, changes
    return Contract.model_validate(sections)


IDEAL: dict[str, Any] = {
    "radius_m": 0.0,
    "tracking_error_m": 0.0,
    "velocity_error_mps": [0.0, 0.0],
    "reaction_time_s": 0.0,
    "attitude_lag_s": 0.0,
    "position_error_m": 0.0,
    "passive_safety": False,
}


@st.composite
def contracts(draw: st.DrawFn) -> Contract:
    size_max_m = draw(st.floats(0.2, 8.0))
    return contract(
        roll_max_deg=draw(st.floats(3.0, 45.0)),
        pitch_max_deg=draw(st.floats(3.0, 45.0)),
        cruise_speed_mps=draw(st.floats(0.3, 12.0)),
        radius_m=draw(st.floats(0.0, 1.0)),
        tracking_error_m=draw(st.floats(0.0, 1.0)),
        velocity_error_mps=[draw(st.floats(0.0, 0.8)), draw(st.floats(0.0, 0.8))],
        reaction_time_s=draw(st.floats(0.0, 0.5)),
        attitude_lag_s=draw(st.floats(0.0, 0.4)),
        setpoint_loss_timeout_s=draw(st.floats(0.0, 2.0)),
        setpoint_loss_run_on_m=draw(st.none() | st.floats(0.1, 8.0)),
        position_error_m=draw(st.floats(0.0, 0.3)),
        frame_age_max_s=draw(st.floats(0.05, 1.0)),
        detection_range_m=draw(st.floats(1.0, 60.0)),
        obstacle_size_max_m=size_max_m,
        obstacle_size_min_m=draw(st.floats(0.0, size_max_m)),
        stop=draw(st.booleans()),
        passive_safety=draw(st.booleans()),
    )


INPUT_SETS: st.SearchStrategy[InputSet] = st.sampled_from(["inner", "paper"])


class Expected:
    """What follows from a contract, written down from the theory without looking at the code."""

    def __init__(self, terms: Contract, input_set: InputSet) -> None:
        vehicle, sensor, world = terms.vehicle, terms.sensor, terms.environment
        slope_x = math.tan(math.radians(vehicle.pitch_max_deg))
        slope_y = math.tan(math.radians(vehicle.roll_max_deg))
        self.x_mps2 = b = GRAVITY_MPS2 * slope_x
        self.y_mps2 = u = GRAVITY_MPS2 * slope_y
        if input_set == "paper":
            self.y_mps2 = u = u / math.cos(math.radians(vehicle.pitch_max_deg))
        self.speed_mps = v = vehicle.cruise_speed_mps + vehicle.velocity_error_mps[0]
        w, lag_s = vehicle.velocity_error_mps[1], vehicle.attitude_lag_s
        body_m = vehicle.radius_m + vehicle.tracking_error_m
        self.margin_m = body_m + 2.0 * sensor.position_error_m
        size_m = world.obstacle_size_max_m + 2.0 * self.margin_m
        clear_s = math.sqrt(size_m / u)
        if w > u * clear_s:
            clear_s = (math.sqrt(2.0 * w * w + 2.0 * u * size_m) - w) / u
        self.flat = v / b <= clear_s
        t_m = v / b if self.flat else clear_s
        self.depth_m = v * t_m - b * t_m * t_m / 2.0
        stopping_m = v * v / (2.0 * b)

        run_m = coast_s = 0.0
        if terms.requirements.passive_safety:
            coast_s = vehicle.setpoint_loss_timeout_s
            run_m = v * coast_s + stopping_m
            if vehicle.setpoint_loss_run_on_m is not None:
                run_m = vehicle.setpoint_loss_run_on_m
                coast_s = max(0.0, (run_m - stopping_m) / v)
        front_m = run_m + self.depth_m + v * (vehicle.reaction_time_s + lag_s)
        crossing_mps = math.sqrt((w + u * t_m) ** 2 + 2.0 * u * w * lag_s)
        peak_mps = crossing_mps + u * lag_s
        overhang_m = max(
            crossing_mps * lag_s + u * lag_s**2 / 2.0 + peak_mps**2 / (2.0 * u),
            2.0 * w * lag_s + w * w / u,
        )
        self.lane_m = overhang_m + peak_mps * coast_s
        swerving_m = swerving_distance_m(v, b, w / u / 2.0, t_m + lag_s)
        recovery_m = max(stopping_m, swerving_m) + 2.0 * v * lag_s
        self.pob_m = max(size_m, recovery_m - run_m)
        behind_m = recovery_m - run_m - (world.obstacle_size_min_m / 2.0 + body_m)
        self.length_m = front_m + size_m / 2.0 + max(behind_m, size_m / 2.0)
        self.width_m = size_m + 2.0 * self.lane_m

        before_m = self.margin_m + vehicle.tracking_error_m
        ahead_m = before_m + front_m - run_m
        self.detection_m = ahead_m + run_m
        edge_m = (
            self.margin_m + w * lag_s + w * w / (2.0 * u)
            if self.flat
            else w * (t_m + lag_s) + u * t_m * t_m / 2.0
        )
        self.stopping_m = stopping_m + v * (vehicle.reaction_time_s + lag_s)
        silent_s = sensor.frame_age_max_s + 0.02 + lag_s
        self.required = {
            "thrust": math.hypot(1.0, slope_x, slope_y, slope_x * slope_y),
            "detection_range": ahead_m,
            "edge_visibility": math.hypot(ahead_m, edge_m),
            "field_of_view": 2.0 * math.degrees(math.atan(edge_m / ahead_m)),
            "separation": math.hypot(self.length_m, self.width_m),
        }
        if terms.requirements.stop:
            self.required["stop"] = before_m + self.stopping_m
            self.required["sensor_silence"] = before_m + stopping_m + v * silent_s
        if terms.requirements.passive_safety:
            self.required["passive_safety"] = math.hypot(self.detection_m, edge_m)


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
    required = {clause.name: clause.required for clause in assessment.clauses}
    assert required == pytest.approx(expected.required)


def test_what_is_declared() -> None:
    declared = {clause.name: clause.declared for clause in assess(contract()).clauses}
    expected = dict.fromkeys(
        ("detection_range", "edge_visibility", "stop", "sensor_silence", "passive_safety"), 12.0
    )
    assert declared == pytest.approx(
        expected | {"thrust": 2.0, "field_of_view": 120.0, "separation": 20.0}
    )


def test_checked_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The worked example of the theory: 15°, 2.8 m/s, 4 m, the paper's box, g = 9.81 m/s²."""
    monkeypatch.setattr(contract_module, "GRAVITY_MPS2", 9.81)
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
    ideal = assess(contract(**(document | IDEAL)), input_set)
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
        assert assessment.limits == assessment.agility.acceleration_limits(
            assessment.terms.input_set
        )


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
    required_deg = next(
        clause.required for clause in assess(contract()).clauses if clause.name == "field_of_view"
    )
    assert not assess(contract(field_of_view_deg=0.999 * required_deg)).compliant
    assert assess(contract(field_of_view_deg=1.001 * required_deg)).compliant


def test_binding_clause_of_a_contract_that_requires_nothing_of_the_sensor() -> None:
    """A point mass with room to stop needs no field of view at all: that must not divide by 0."""
    assessment = assess(contract(**IDEAL))
    field_of_view = next(c for c in assessment.clauses if c.name == "field_of_view")
    assert field_of_view.required == 0.0
    assert assessment.binding.name in {"thrust", "separation"}


def test_clauses_may_be_switched_off() -> None:
    def names(**changes: bool) -> set[str]:
        return {clause.name for clause in assess(contract(**changes)).clauses}

    everything = names(stop=True, passive_safety=True)
    assert everything - names(stop=False) == {"stop", "sensor_silence"}
    assert everything - names(passive_safety=False) == {"passive_safety"}


def test_clauses_are_on_unless_switched_off() -> None:
    values: dict[str, Any] = {field.name: 1.0 for field in fields(Terms)}
    del values["stop"], values["passive_safety"], values["input_set"]
    terms: Terms[float] = Terms(**values)
    assert (terms.stop, terms.passive_safety, terms.input_set) == (True, True, "inner")


def test_reasons_are_sentences_for_an_operator() -> None:
    for clause in assess(contract()).clauses:
        assert 30 < len(clause.reason) < 100
        assert clause.reason[0].islower()
        assert not any(character in clause.reason for character in "_=<>Φρτ")


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
    error_m = assessment.terms.position_error_m
    extents = [assessment.region_around(box, error_m).extent for box in (first, second)]
    return extents[0].intersects(extents[1])


@given(contracts(), st.integers(0, 2**32))
def test_regions_are_disjoint_at_the_separation(terms: Contract, seed: int) -> None:
    """Any two obstacles of allowed sizes, in any direction, measured as badly as allowed."""
    assessment, random = assess(terms), np.random.default_rng(seed)
    world, error_m = terms.environment, terms.sensor.position_error_m
    thin_m, thick_m = world.obstacle_size_min_m, world.obstacle_size_max_m
    apart_m = assessment.inflated.required_separation_m * (1.0 + 1e-9)
    corner_rad = math.atan2(assessment.inflated.roi_width_m, assessment.inflated.roi_length_m)
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
    thick_m, error_m = world.obstacle_size_max_m, terms.sensor.position_error_m
    # The near one is thin and measured too far away, or thick and measured too near.
    x_m = derived.roi_length_m * (1.0 - 1e-9)
    y_m = side * derived.roi_width_m * (1.0 - 1e-9)
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
    assessment = assess(contract())
    derived = assessment.inflated
    apart_m = 1.001 * max(derived.roi_length_m, derived.roi_width_m)
    direction_rad = math.atan2(derived.roi_width_m, derived.roi_length_m)
    size_m = np.array((4.0, 4.0))
    far = centred(apart_m * math.cos(direction_rad), apart_m * math.sin(direction_rad), size_m)
    assert regions_touch(assessment, centred(0.0, 0.0, size_m), far)


def test_two_largest_obstacles_are_not_the_worst_pair() -> None:
    """Erratum 11: 0.05 by 4 m, then 4 by 4 m, 6 m/s, 15°."""
    fast = IDEAL | {"cruise_speed_mps": 6.0}
    thick_only = assess(contract(**fast, obstacle_size_min_m=4.0)).inflated
    assessment = assess(contract(**fast, obstacle_size_min_m=0.05))
    assert assessment.inflated.roi_length_m > thick_only.roi_length_m + 1.0
    far = centred(thick_only.roi_length_m + 0.1, 0.0, np.array((4.0, 4.0)))
    assert regions_touch(assessment, centred(0.0, 0.0, np.array((0.05, 4.0))), far)
    assert not regions_touch(assessment, centred(0.0, 0.0, np.array((4.0, 4.0))), far)


@given(contracts())
def test_a_region_uses_the_larger_position_error(terms: Contract) -> None:
    assessment = assess(terms)
    box, declared_m = Box(20.0, 22.0, -1.0, 2.0), terms.sensor.position_error_m
    body_m = terms.vehicle.radius_m + terms.vehicle.tracking_error_m
    for error_m in (0.0, declared_m, declared_m + 0.3):
        region = assessment.region_around(box, error_m)
        used_m = max(error_m, declared_m)
        inflated = box.inflated(body_m + used_m)
        assert vars(region.obstacle) == pytest.approx(vars(inflated))


@given(contracts())
def test_the_largest_measured_obstacle_has_the_contracts_region(terms: Contract) -> None:
    assessment = assess(terms)
    half_m = terms.environment.obstacle_size_max_m / 2.0 + terms.sensor.position_error_m
    box = Box(30.0 - half_m, 30.0 + half_m, -half_m, half_m)
    region, size = assessment.region_around(box, 0.0), assessment.inflated.region
    inflated = region.obstacle
    assert inflated.x_min_m - region.extent.x_min_m == pytest.approx(size.front_m)
    assert region.x_pob_m - inflated.x_min_m == pytest.approx(size.pob_depth_m)
    assert inflated.y_min_m - region.lane_left_m == pytest.approx(size.overhang_left_m)
    assert region.lane_right_m - inflated.y_max_m == pytest.approx(size.overhang_right_m)
    assert inflated.x_min_m - region.keep_out.x_min_m == pytest.approx(
        assessment.inflated.encounter.run_on_m
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
    "obstacle_size_max_m",
)


@given(contracts(), st.sampled_from(HARDER), st.floats(1e-6, 1.0))
def test_a_harder_contract_never_requires_less(terms: Contract, name: str, by: float) -> None:
    # A run that was measured at one speed says nothing about another.
    before = replace(Terms.of(terms), setpoint_loss_run_on_m=None)
    after = replace(before, **{name: getattr(before, name) + by})
    derived_before, derived_after = derive(before, SCALAR), derive(after, SCALAR)
    required = {clause.name: clause.required for clause in clauses(before, derived_before, SCALAR)}
    # What lies farther ahead may be seen under a smaller angle; and once stopping is quicker than
    # passing, the edge to pass need not be seen any more.
    exempt = {"field_of_view"}
    if derived_before.region.flat != derived_after.region.flat:
        exempt |= {"edge_visibility", "passive_safety"}
    for clause in clauses(after, derived_after, SCALAR):
        if clause.name not in exempt:
            assert clause.required >= required[clause.name] - 1e-9, clause.name


@given(contracts(), INPUT_SETS)
def test_arrays_and_floats_agree(terms: Contract, input_set: InputSet) -> None:
    scalar = Terms.of(terms, input_set)
    values: dict[str, Any] = {f.name: getattr(scalar, f.name) for f in fields(Terms)}
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = np.full(2, value)
    array: Terms[FloatArray] = Terms(**values)
    many = clauses(array, derive(array, ARRAY), ARRAY)
    for clause, expected in zip(many, assess(terms, input_set).clauses, strict=True):
        assert clause.name == expected.name
        np.testing.assert_allclose(clause.required, np.full(2, expected.required), rtol=1e-12)
        np.testing.assert_array_equal(clause.holds, np.full(2, expected.holds))


def test_a_measured_run_on_replaces_the_model() -> None:
    model = assess(contract()).inflated
    assert model.encounter.run_on_m == pytest.approx(
        3.0 * 0.5 + 9.0 / (2.0 * model.encounter.brake_mps2)
    )
    same = assess(contract(setpoint_loss_run_on_m=model.encounter.run_on_m)).inflated
    assert same.encounter.coast_time_s == pytest.approx(0.5)
    assert same.required_separation_m == pytest.approx(model.required_separation_m)
    short = assess(contract(setpoint_loss_run_on_m=0.5)).inflated
    assert (short.encounter.run_on_m, short.encounter.coast_time_s) == (0.5, 0.0)


@pytest.mark.parametrize(("left_mps2", "right_mps2"), [(1.0, 4.0), (4.0, 1.0)])
def test_what_must_be_seen_lies_on_the_worse_side(left_mps2: float, right_mps2: float) -> None:
    limits = AccelerationLimits(1.0, 1.0, left_mps2, right_mps2)
    late = {"lateral_speed_mps": 0.4, "attitude_lag_s": 0.5}
    fast = replace(Encounter.ideal(limits, 10.0, (1.0, 10.0)), **late)
    # 10 m are left behind in 2 s, by the sum of both limits; drift and the stronger one go on.
    region = dimensions(fast, SCALAR)
    assert not region.flat
    assert _edge_offset(fast, region, 0.3, SCALAR) == pytest.approx(0.4 * 2.5 + 4.0 * 2.0**2 / 2.0)
    slow = replace(Encounter.ideal(limits, 1.0, (1.0, 10.0)), **late)
    region = dimensions(slow, SCALAR)
    assert region.flat
    # The drift is stopped last by the weaker limit.
    drift_m = 0.4 * 0.5 + 0.4**2 / (2.0 * 1.0)
    assert _edge_offset(slow, region, 0.3, SCALAR) == pytest.approx(0.3 + drift_m)
