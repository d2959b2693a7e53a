"""Theory F: the clause, the corridor, and a slow simulation of what they promise."""

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract.agility import AccelerationLimits
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.assessment import TICK_S, Clause, Terms, assess, clauses, derive
from onboard.contract.clauses import recentring_drift
from onboard.contract.recentring import DEAD_BAND_M, Corridor, Drift, drift_of, required_view
from onboard.files.contract_file import Contract
from onboard.geometry.box import Box
from onboard.geometry.frames import FloatArray
from onboard.motion.trajectory import State, Y
from onboard.planning.closed_form import stop_at
from tests.onboard.contract.ideal_encounter import ideal_encounter
from tests.onboard.planning.avoidance_cases import Variety
from tests.onboard.planning.avoidance_cases import draw as drawn_problem

LIMITS = AccelerationLimits(2.0, 4.0, 1.0, 3.0)
ENCOUNTER = ideal_encounter(LIMITS, 2.5, (2.0, 2.0))._replace(
    lateral_speed_mps=0.5,
    attitude_lag_s=0.2,
    coast_drift_m=0.1,
)


def changed(contract: Contract, **vehicle: float) -> Contract:
    terms = contract.vehicle.model_copy(update=vehicle)
    return contract.model_copy(update={"vehicle": terms})


def clause_of(contract: Contract) -> Clause[float]:
    return next(each for each in assess(contract).clauses if each.name == "recentring")


def test_room_to_come_to_rest_by_hand() -> None:
    """0.7 m of margin, 0.5²/2 to stop at 1 m/s², 0.5 m/s for 0.2 + 0.3 s, and 0.1 m of coasting."""
    drift = drift_of(ENCOUNTER, speed_min_mps=2.0, margin_m=0.7, notice_s=0.3, ops=SCALAR)
    assert (drift.lateral_mps, drift.speed_min_mps) == (0.5, 2.0)
    assert drift.room_m == pytest.approx(0.7 + 0.125 + 0.25 + 0.1)
    assert drift.ending_s == pytest.approx(0.5 + 0.4 + 0.3)


def test_the_weaker_side_decides_how_soon_a_drift_ends() -> None:
    mirrored = ENCOUNTER._replace(left_mps2=LIMITS.right_mps2, right_mps2=LIMITS.left_mps2)
    for e in (ENCOUNTER, mirrored):
        drift = drift_of(e, speed_min_mps=2.0, margin_m=0.7, notice_s=0.3, ops=SCALAR)
        assert drift.ending_s == pytest.approx(0.5 + 0.4 + 0.3)


def test_standing_still_is_the_slowest() -> None:
    """An error above the cruise speed: a drift then goes sideways only."""
    backwards = required_view(Drift(0.5, -1.0, 1.0, 1.0), 2.0, SCALAR)
    assert backwards == pytest.approx(required_view(Drift(0.5, 0.0, 1.0, 1.0), 2.0, SCALAR))
    assert backwards == pytest.approx(math.pi)


def test_more_than_80_degrees_to_each_side_is_not_relied_upon() -> None:
    corridor = Corridor.of(Drift(0.5, 2.0, 1.0, 1.0), math.radians(300.0))
    assert corridor.side_m / corridor.reach_m == pytest.approx(math.tan(math.radians(80.0)))


def test_required_view_by_hand() -> None:
    """Room 1 m, range 2 m: 30° beyond a slope of nothing; beyond a slope of 1:1 its cosine less."""
    assert required_view(Drift(0.0, 2.0, 1.0, 1.0), 2.0, SCALAR) == pytest.approx(math.pi / 3.0)
    near = required_view(Drift(0.0, 2.0, 1.6, 1.0), 2.0, SCALAR)
    assert near == pytest.approx(2.0 * math.asin(0.8))
    steep = required_view(Drift(2.0, 2.0, 1.0, 1.0), 2.0, SCALAR)
    assert steep == pytest.approx(2.0 * (math.pi / 4.0 + math.asin(0.5 * math.sqrt(0.5))))


def test_no_view_will_do_where_the_range_is_shorter_than_the_room() -> None:
    twice_round = pytest.approx(4.0 * math.pi)
    assert required_view(Drift(0.5, 2.0, 3.0, 1.0), 2.0, SCALAR) == twice_round
    assert required_view(Drift(0.0, 2.0, 2.0, 1.0), 2.0, SCALAR) == twice_round


@given(st.floats(0.05, 1.0), st.floats(1.0, 8.0), st.floats(0.3, 3.0), st.floats(4.0, 30.0))
def test_required_view_is_just_enough(w: float, v: float, room_m: float, range_m: float) -> None:
    """At that view the corridor ends exactly at the range; a wider one makes it shorter."""
    drift = Drift(w, v, room_m, 1.0)
    view_rad = required_view(drift, range_m, SCALAR)
    if view_rad < math.radians(160.0):
        corridor = Corridor.of(drift, view_rad)
        assert math.hypot(corridor.reach_m, corridor.side_m) == pytest.approx(range_m)
        wider = Corridor.of(drift, view_rad + 0.1)
        assert math.hypot(wider.reach_m, wider.side_m) < range_m


def test_a_drift_steeper_than_the_view_has_no_corridor() -> None:
    with pytest.raises(ValueError, match="slope"):
        Corridor.of(Drift(1.0, 1.0, 1.0, 1.0), math.radians(90.0))


def test_corridor_lies_between_the_vehicle_and_the_line() -> None:
    corridor = Corridor(4.0, 2.0, 2.0, 1.0)
    for sign in (1.0, -1.0):
        beside = Box(0.0, 1.0, *sorted((sign * 0.5, sign * 1.1)))
        assert corridor.meets(sign * 3.0, beside)
        assert not corridor.meets(sign * 3.2, beside)
        assert corridor.meets(sign * 0.6, beside)
        beyond = Box(0.0, 1.0, *sorted((sign * 3.1, sign * 4.0)))
        assert not corridor.meets(sign * 3.0, beyond)
        # What touches its edge is met.
        assert corridor.meets(sign * 3.0, Box(0.0, 1.0, *sorted((sign * 3.0, sign * 4.0))))
        assert corridor.meets(sign * 3.0, Box(0.0, 1.0, *sorted((sign * 0.5, sign * 1.0))))


def test_a_drift_begins_after_a_straight_way_and_at_a_steady_speed() -> None:
    corridor = Corridor(4.0, 2.0, 2.0, 1.0)
    assert corridor.seen(1.0, straight_m=4.0)
    assert not corridor.seen(1.0, straight_m=3.9)
    assert not corridor.seen(DEAD_BAND_M, straight_m=4.0)
    assert corridor.steady(2.0, 2.1)
    assert corridor.steady(2.0 - 1e-9, 2.1)  # round-off is no slowing down
    assert not corridor.steady(2.1, 1.9)
    assert not corridor.steady(1.9, 2.1)


# --- the contract


def test_without_recentring_there_is_no_clause_and_no_corridor(contract: Contract) -> None:
    assessment = assess(contract)
    assert "recentring" not in {clause.name for clause in assessment.clauses}
    assert assessment.corridor is None


def test_clause_adds_up_what_the_contract_states(contract: Contract) -> None:
    """The default contract: silence is noticed after 0.32 s, a dead daemon coasts for 0.5 s."""
    clause = clause_of(changed(contract, recentring_speed_mps=0.3))
    w, v, limit = 0.3 + 0.1, 2.8 - 0.2, 9.80665 * math.tan(math.radians(15.0))
    margin_m = (0.30 + 0.25 + 2.0 * 0.05 * math.sqrt(2.0)) + 0.25
    room_m = margin_m + w * w / (2.0 * limit) + w * (0.15 + 0.3 + TICK_S) + 0.3 * 0.5
    slope_rad = math.atan2(w, v)
    needed_rad = 2.0 * (slope_rad + math.asin(room_m * math.cos(slope_rad) / 12.0))
    assert clause.required == pytest.approx(math.degrees(needed_rad))
    assert clause.declared == pytest.approx(120.0)


def test_what_is_noticed_later_than_silence_counts(contract: Contract) -> None:
    """Silence is noticed after 0.32 s, an object after the reaction time where that is longer."""
    drifting = changed(contract, recentring_speed_mps=0.3)
    required_deg = clause_of(drifting).required
    prompt = changed(drifting, reaction_time_s=0.32)
    assert clause_of(prompt).required == pytest.approx(required_deg, abs=1e-3)
    assert clause_of(changed(drifting, reaction_time_s=0.5)).required > required_deg + 0.5


def test_clause_asks_nothing_where_nothing_drifts(contract: Contract) -> None:
    """On a surface with the recentring speed as its axis."""
    scalar = Terms.of(changed(contract, recentring_speed_mps=0.3))
    values: dict[str, Any] = {each.name: getattr(scalar, each.name) for each in fields(Terms)}
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = np.full(2, value)
    values["recentring_speed_mps"] = np.array([0.0, 0.3])
    terms: Terms[FloatArray] = Terms(**values)
    found = {each.name: each.required for each in clauses(terms, derive(terms, ARRAY), ARRAY)}
    assert found["recentring"][0] == 0.0
    assert found["recentring"][1] == pytest.approx(
        clause_of(changed(contract, recentring_speed_mps=0.3)).required
    )


def test_recentring_has_a_corridor(contract: Contract) -> None:
    corridor = assess(changed(contract, recentring_speed_mps=0.3)).corridor
    assert corridor is not None
    assert math.hypot(corridor.reach_m, corridor.side_m) < 12.0


def test_a_heading_error_turns_what_is_seen_to_the_side(contract: Contract) -> None:
    drifting = changed(contract, recentring_speed_mps=0.3, heading_error_deg=2.0)
    spacious = {"obstacle_separation_min_m": 40.0}
    wide = drifting.model_copy(
        update={"environment": drifting.environment.model_copy(update=spacious)}
    )
    assessment = assess(wide)
    drift = recentring_drift(assessment.terms, assessment.inflated, SCALAR)
    view_rad = required_view(drift, 12.0, SCALAR)
    assert clause_of(wide).required == pytest.approx(math.degrees(view_rad) + 2.0 * 2.0)
    expected = Corridor.of(drift, math.radians(120.0 - 2.0 * 2.0))
    assert vars(assessment.corridor) == pytest.approx(vars(expected))


def test_recentring_widens_every_region(contract: Contract) -> None:
    before = assess(contract).inflated
    after = assess(changed(contract, recentring_speed_mps=0.3)).inflated
    assert after.manoeuvre_encounter.lateral_speed_mps == pytest.approx(0.4)
    assert after.manoeuvre_encounter.coast_drift_m == pytest.approx(0.15)
    assert after.manoeuvre_width_m > before.manoeuvre_width_m
    assert after.manoeuvre.drift_left_m > before.manoeuvre.drift_left_m + 0.15
    # Where it stops, the reference alone counts: its drift, on either side of face and overhang.
    assert after.encounter.lateral_speed_mps == pytest.approx(0.3)
    assert after.region.drift_left_m > before.region.drift_left_m == 0.0
    assert after.roi_width_m > before.roi_width_m + 2.0 * after.region.drift_left_m - 1e-9
    assert assess(changed(contract, recentring_speed_mps=0.3)).nominal == assess(contract).nominal


def test_a_contract_that_does_not_comply_is_not_recentred(contract: Contract) -> None:
    assessment = assess(changed(contract, recentring_speed_mps=3.0))
    assert not assessment.compliant
    assert assessment.corridor is None


# --- the drift itself


@pytest.mark.parametrize("y_m", [-3.0, 0.7, 3.0])
def test_a_drift_ends_on_the_line_at_no_more_than_its_speed(y_m: float) -> None:
    from random import Random  # noqa: PLC0415

    envelope = drawn_problem(Random(4), Variety()).envelope
    start = State((0.0, y_m, 0.0), (envelope.speed_max_mps / 2.0, 0.0, 0.0))
    cruise = stop_at(start, 5.0, envelope, 200.0, envelope.speed_max_mps, recentring_mps=0.3)
    assert cruise is not None
    assert cruise.final.position_leg_m[1] == pytest.approx(0.0, abs=1e-6)
    low_mps, high_mps = cruise.velocity_range_mps(Y)
    assert max(-low_mps, high_mps) <= 0.3 + 1e-9
    # At more than this it would be there before the attitude is, and be overshot.
    sideways_mps2 = np.abs(cruise.acceleration_leg_mps2[:, 1]).max()
    assert sideways_mps2 <= 0.3 / 1.0 + 1e-9


@given(
    st.floats(0.1, 0.5),
    st.floats(1.5, 5.0),
    st.floats(0.0, 2.0),
    st.floats(-1.0, 30.0),
    st.floats(0.0, 3.0),
    st.sampled_from((0.0, 0.1, 0.5)),
)
def test_nothing_is_met_that_was_not_seen_in_time(
    w: float, v: float, beside_m: float, ahead_m: float, length_m: float, extra_rad: float
) -> None:
    """Fly straight, drift, and stop when something known is beside: it is never touched.

    The face lies anywhere along the drift, ``beside_m`` to its side; it is known once one of its
    points has been in view, and then only after the notice time.
    """
    limit_mps2, lag_s, notice_s, range_m, step_s, margin_m = 1.5, 0.2, 0.3, 12.0, 0.02, 0.6
    e = ENCOUNTER._replace(left_mps2=limit_mps2, right_mps2=limit_mps2, lateral_speed_mps=w)
    drift = drift_of(e, speed_min_mps=v, margin_m=margin_m, notice_s=notice_s, ops=SCALAR)
    view_rad = required_view(drift, range_m, SCALAR) + 1e-3 + extra_rad
    corridor = Corridor.of(drift, view_rad)
    face_y_m = margin_m + beside_m + w / v * max(0.0, ahead_m)  # the drift goes towards +y
    face = [(ahead_m + length_m * share, face_y_m) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    keep_out = Box(ahead_m, ahead_m + length_m, face_y_m - margin_m, face_y_m + 1.0)

    def in_view(x_m: float, y_m: float) -> bool:
        return any(
            math.hypot(px - x_m, py - y_m) <= range_m
            and abs(math.atan2(py - y_m, px - x_m)) <= view_rad / 2.0
            for px, py in face
        )

    x_m, y_m, vy_mps, now_s = -corridor.reach_m, 0.0, 0.0, 0.0
    seen_s = stop_s = math.inf
    while x_m < keep_out.x_max_m + 1.0:
        now_s += step_s
        if seen_s == math.inf and in_view(x_m, y_m):
            seen_s = now_s
        near = keep_out.x_min_m <= x_m + corridor.reach_m and keep_out.x_max_m >= x_m
        beside = near and keep_out.y_min_m <= y_m + corridor.side_m
        if beside and now_s >= seen_s + notice_s:
            stop_s = min(stop_s, now_s + lag_s)
        if now_s >= stop_s:
            vy_mps = max(0.0, vy_mps - limit_mps2 * step_s)
        elif x_m >= 0.0 and (vy_mps > 0.0 or stop_s == math.inf):
            vy_mps = w
        x_m, y_m = x_m + v * step_s, y_m + vy_mps * step_s
        if keep_out.x_min_m <= x_m <= keep_out.x_max_m and y_m > keep_out.y_min_m:
            # Met with its front first, it is an obstacle of interest, and avoided.
            assert x_m - v * step_s < keep_out.x_min_m
            return
