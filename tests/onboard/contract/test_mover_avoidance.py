"""What passing a slow mover in flight requires: table, levels, encounters, machine proofs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import z3
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.contract.arithmetic import SCALAR
from onboard.contract.assessment import Assessment, assess, assess_terms
from onboard.contract.mover_avoidance import Passing, passing
from onboard.contract.region import Encounter, least_advance
from onboard.files.contract_file import Contract, load_contract
from onboard.files.yaml_file import FileError, validate
from tests.onboard.contract.prover import Symbols, assert_refuted, assert_theorem

CONTRACT = load_contract(Path(__file__).parents[3] / "config" / "avoid_contract.yaml")
# Of the table: r 0.40, E 0.35, e 0.10; tau 0.25, T 0.20, errors of the velocity 0.1.
MARGIN_M, FIXED_M, SLOWER_MPS = 0.95, 1.30, 0.1


def encounter(
    speed_mps: float, limit_mps2: float, size_m: float, **changes: float
) -> Encounter[float]:
    """Return an encounter with limits alike in all directions, speed as planned."""
    values: dict[str, Any] = {
        "brake_mps2": limit_mps2, "forward_mps2": limit_mps2, "left_mps2": limit_mps2,
        "right_mps2": limit_mps2, "speed_mps": speed_mps + SLOWER_MPS, "lateral_speed_mps": 0.1,
        "size_along_m": size_m, "size_across_m": size_m, "attitude_lag_s": 0.2,
        "reaction_time_s": 0.25, "run_on_m": 0.0, "coast_time_s": 0.0, "coast_drift_m": 0.0,
    }  # fmt: skip
    return Encounter(**values | changes)


# ---------------------------------------------------------------------- the table


@pytest.mark.parametrize(
    ("limit_mps2", "speed_mps", "mover_mps", "row"),
    [
        (2.628, 1.0, 0.0, (2.0, 2.8, 5.1, 10)),
        (2.628, 1.0, 0.25, (2.4, 5.6, 8.2, 19)),
        (2.628, 1.0, 0.5, (2.9, 12.0, 15.2, 40)),
        (2.628, 2.0, 0.25, (3.5, 4.7, 4.5, 16)),
        (2.628, 2.0, 0.5, (4.0, 7.4, 6.0, 25)),
        (2.628, 2.8, 0.25, (4.6, 4.6, 3.9, 17)),
        (2.628, 2.8, 0.5, (5.1, 6.8, 4.8, 23)),
        (2.628, 2.8, 1.5, (7.9, 28.2, 13.1, 95)),
        (2.628, 4.0, 0.25, (6.6, 4.4, 3.3, 19)),
        (2.628, 4.0, 0.5, (7.2, 6.5, 4.0, 24)),
        (2.628, 8.0, 0.25, (13.2, 4.2, 2.4, 32)),
        (2.628, 8.0, 0.5, (14.4, 5.8, 2.8, 35)),
        (5.662, 2.0, 0.25, (2.9, 5.0, 3.7, 16)),
        (5.662, 2.8, 0.5, (4.0, 6.6, 3.7, 21)),
        (5.662, 6.0, 0.25, (7.4, 4.6, 2.2, 20)),
        (5.662, 8.0, 0.5, (10.5, 5.8, 2.2, 27)),
    ],
)
def test_the_table_of_the_theory(
    limit_mps2: float, speed_mps: float, mover_mps: float, row: tuple[float, float, float, float]
) -> None:
    """T3, a person of 0.8 m: range, lane beyond the face, t_e and separation."""
    e = encounter(speed_mps, limit_mps2, 0.8 + 2.0 * MARGIN_M)
    size = passing(e, speed_mps - SLOWER_MPS, mover_mps, SCALAR)
    range_m, lane_m, passing_s, separation_m = row
    assert size.front_m + FIXED_M == pytest.approx(range_m, abs=0.06)
    assert size.lane_m == pytest.approx(lane_m, abs=0.06)
    assert size.passing_s == pytest.approx(passing_s, abs=0.06)
    assert math.hypot(size.length_m, size.width_m) == pytest.approx(separation_m, abs=0.6)


# ---------------------------------------------------------------------- clauses and levels


def with_movers(*movers: tuple[str, float], level: str = "avoid", **sensor: float) -> Assessment:
    data = CONTRACT.model_dump(mode="json", exclude_none=True)
    data["environment"]["movers"] = [
        {"class": kind, "speed_max_mps": speed_mps, "size_max_m": 0.8} for kind, speed_mps in movers
    ]
    data["requirements"]["movers"] = level
    data["sensor"] |= sensor
    return assess(validate(data, Contract, source="test"))


def broken(assessment: Assessment) -> list[str]:
    return [clause.name for clause in assessment.clauses if not clause.holds]


def test_a_slow_class_is_passed_and_the_contract_complies() -> None:
    slow = with_movers(("person", 0.4))
    assert slow.compliant
    assert "passed in flight where each stop on the way certifies" in slow.passing_levels[0]
    names = {clause.name: clause.concerns for clause in slow.clauses}
    for name in ("faster.person", "moving_range.person", "moving_separation.person"):
        assert names[name] == "progress"


def test_what_is_fast_breaks_the_clauses_and_is_waited_for() -> None:
    fast = with_movers(("person", 1.2))
    assert "moving_separation.person" in broken(fast)
    assert "waited for, not passed: passing it needs" in fast.passing_levels[0]
    faster = with_movers(("person", 2.5))
    assert "faster.person" in broken(faster)
    assert faster.passing_levels[0].endswith("the vehicle is not faster than 2.5 m/s")
    near = with_movers(("person", 0.4), detection_range_m=4.0)
    assert "moving_range.person" in broken(near)


def test_the_fastest_class_counts_for_all_since_it_may_hide_behind_a_slow_one() -> None:
    both = with_movers(("person", 0.4), ("runner", 1.2))
    assert {"moving_separation.person", "moving_separation.runner"} <= set(broken(both))


def test_without_the_requirement_nothing_is_asked_and_the_level_says_what_it_would_take() -> None:
    passive = with_movers(("person", 0.4), level="passive")
    assert not [c for c in passive.clauses if c.name.startswith(("faster", "moving"))]
    assert "requirements.movers = avoid would have it passed" in passive.passing_levels[0]


def test_best_effort_does_not_pass_movers() -> None:
    data = CONTRACT.model_dump(mode="json", exclude_none=True)
    data["requirements"]["progress"] = "best_effort"
    with pytest.raises(FileError, match="movers are passed from the cruise only"):
        validate(data, Contract, source="test")


def test_avoid_asks_for_all_that_passive_does() -> None:
    passive = {clause.name for clause in with_movers(("person", 0.4), level="passive").clauses}
    assert passive < {clause.name for clause in with_movers(("person", 0.4)).clauses}


def test_the_speed_of_the_vehicle_decides_both_ways() -> None:
    """Too slow, the mover has long to come near; too fast, the vehicle does not rest in time."""
    assessment = with_movers(("person", 0.4))
    speeds = {
        mps: broken(
            assess_terms(assessment.contract, replace(assessment.terms, cruise_speed_mps=mps))
        )
        for mps in (0.8, 2.0, 12.0)
    }
    assert "moving_separation.person" in speeds[0.8]
    assert speeds[2.0] == []
    assert "passive_range.person" in speeds[12.0]


# ---------------------------------------------------------------------- encounters


def encountered(
    e: Encounter[float],
    size: Passing[float],
    slow_mps: float,
    v_o: float,
    y_m: float,
    drift_mps: float,
    gap_m: float,
) -> tuple[bool, float, float]:
    """Fly past a hostile mover in steps of 2 ms; return (touched, farthest aside, when passed).

    The vehicle flies on for kappa, then brakes and pushes to the side that the theorem names until
    it is beside the box that it has to assume, keeps the speed of its face, and speeds up again.
    The mover runs at it, and to the side that the vehicle will choose, v_o along each axis.

    Args:
        e: V_e and the drift as flown.
        size: what the theorem says.
        slow_mps: entry speed.
        v_o: of the mover.
        y_m: of the vehicle from the box's middle.
        drift_mps: sideways at entry.
        gap_m: from the vehicle to the front face.
    """
    kappa_s = e.reaction_time_s + e.attitude_lag_s
    half_m, step_s, push = e.size_across_m / 2.0, 0.002, e.left_mps2
    t_s = size.clearing_s
    later_m = y_m + drift_mps * (kappa_s + t_s)
    side = 1.0 if later_m >= 0.0 else -1.0
    x_m, v_mps, w_mps, time_s = 0.0, slow_mps, drift_mps, 0.0
    touched, aside_m = False, 0.0
    while time_s < 3.0 * size.passing_s:
        grown_m = v_o * time_s
        beside = side * y_m >= half_m + grown_m
        if time_s >= kappa_s:
            if beside:
                w_mps = side * max(side * w_mps - push * step_s, v_o)
                v_mps = min(v_mps + e.forward_mps2 * step_s, e.speed_mps)
            else:
                w_mps += side * push * step_s
                v_mps = max(v_mps - e.brake_mps2 * step_s, 0.0)
        x_m, y_m, time_s = x_m + v_mps * step_s, y_m + w_mps * step_s, time_s + step_s
        front_m, rear_m = gap_m - v_o * time_s, gap_m - v_o * time_s + e.size_along_m
        # It moves to that side from the start, as one box that does not grow.
        middle_m = side * v_o * time_s
        touched |= front_m < x_m < rear_m and abs(y_m - middle_m) < half_m - 0.02
        aside_m = max(aside_m, side * y_m - half_m)
        if x_m > gap_m + e.size_along_m + v_o * time_s and v_mps >= e.speed_mps - 1e-9:
            break
    return touched, aside_m, time_s - kappa_s


@given(
    speed_mps=st.floats(1.5, 8.0),
    ratio=st.floats(0.02, 0.25),
    limit_mps2=st.sampled_from((2.628, 5.662)),
    entry=st.floats(0.0, 1.0),
    at=st.floats(-1.0, 1.0),
    drift=st.floats(-1.0, 1.0),
)
@settings(max_examples=40, deadline=None)
def test_at_the_range_of_the_clause_no_hostile_mover_touches(
    speed_mps: float, ratio: float, limit_mps2: float, entry: float, at: float, drift: float
) -> None:
    """Steps cost a hair of each bound; the lag is that of a dead time, as in kappa."""
    v_o, slow_mps = ratio * speed_mps, speed_mps - SLOWER_MPS
    e = encounter(speed_mps, limit_mps2, 2.7)
    size = passing(e, slow_mps, v_o, SCALAR)
    entry_mps = slow_mps + entry * (e.speed_mps - slow_mps)
    y_m = at * (e.size_across_m / 2.0 + v_o * 0.45)
    touched, aside_m, passed_s = encountered(
        e, size, entry_mps, v_o, y_m, 0.1 * drift, size.front_m + 0.01 * e.speed_mps
    )
    assert not touched
    assert aside_m <= size.lane_m + 0.02
    assert passed_s <= size.passing_s + 0.02


@given(speed_mps=st.floats(1.5, 8.0), ratio=st.floats(0.02, 0.25))
@settings(max_examples=20, deadline=None)
def test_a_tenth_nearer_the_mover_touches(speed_mps: float, ratio: float) -> None:
    """Straight ahead, at the greatest speed and without a drift: neither side is reached."""
    v_o = ratio * speed_mps
    e = encounter(speed_mps, 2.628, 2.7, lateral_speed_mps=0.0)
    size = passing(e, speed_mps - SLOWER_MPS, v_o, SCALAR)
    touched, *_ = encountered(e, size, e.speed_mps, v_o, 0.0, 0.0, 0.9 * size.front_m)
    assert touched


# ---------------------------------------------------------------------- proofs

u, a, b, v, v_1, v_o, w, t, s, y, rate, t_star, across = z3.Reals(
    "u a b v v_1 v_o w t s y rate t_star across"
)
POSITIVE = [u > 0, a > 0, b > 0, v > 0, v_o >= 0, w >= 0, t >= 0, s >= 0, across > 0]


def clearing() -> list[Any]:
    """t* as the code has it, with limits u on both sides."""
    symbols = Symbols()
    e = encounter(1.0, 1.0, 1.0)
    kappa_s = z3.RealVal(0)
    known = e._replace(
        left_mps2=u, right_mps2=u, lateral_speed_mps=w, size_across_m=across, speed_mps=v,
        size_along_m=across, brake_mps2=b, forward_mps2=a, attitude_lag_s=kappa_s,
        reaction_time_s=kappa_s,
    )  # fmt: skip
    size = passing(known, v_1, v_o, symbols.arithmetic)
    return [*symbols.known, t_star == size.clearing_s]


def side(sign: int, time: Any) -> Any:
    """How far beyond the face of the growing box a full push leads to one side."""
    return sign * (y + rate * time) + u * time * time / 2 - across / 2 - v_o * time


def test_a6_at_t_star_one_side_is_clear_and_stays_so() -> None:
    assert_theorem(u * t_star * t_star == across + 2 * (v_o + w) * t_star, *POSITIVE, *clearing())
    defined = [*POSITIVE, rate <= w, -rate <= w, t_star > 0]
    equation = u * t_star * t_star == across + 2 * (v_o + w) * t_star
    assert_theorem(z3.Or(side(1, t_star) >= 0, side(-1, t_star) >= 0), *defined, equation)
    # Its edge does not gain: no drift has to be outrun first.
    assert_theorem(u * t_star >= 2 * (v_o + w), *defined, equation)
    gaining = u * t_star >= v_o + w
    assert_theorem(side(1, t) >= 0, *defined, gaining, side(1, t_star) >= 0, t >= t_star)
    # A tenth earlier neither side need be clear.
    sooner = 10 * t == 9 * t_star
    assert_refuted(z3.Or(side(1, t) >= 0, side(-1, t) >= 0), *defined, equation, sooner)


def test_a6_slowed_to_the_face_and_then_to_rest_is_no_farther_than_at_once() -> None:
    peak = z3.Real("peak")
    assert_theorem((peak - v_o) ** 2 + v_o**2 <= peak**2, *POSITIVE, peak >= v_o)


def least(time: Any) -> Any:
    """Phi as the code has it."""
    return least_advance(v, b, time, Symbols().arithmetic)


def test_a7_until_t_star_the_vehicle_has_not_come_to_the_face() -> None:
    """Braking fully from D it is before the face that comes towards it; a stop does not help."""
    assert_theorem(least(t) + v_o * t <= least(t_star) + v_o * t_star, *POSITIVE, t <= t_star)
    # "Or stop": with v_o > 0 the face of a mover goes on after the vehicle has come to rest.
    resting = least(t) + v_o * t <= least(v / b) + v_o * (v / b)
    assert_refuted(resting, *POSITIVE, v_o > 0, t <= t_star)


def test_a8_the_way_made_while_speeding_up_falls_short_by_the_square_of_the_deficit() -> None:
    speeding = z3.If(
        a * t <= v - v_1, v_1 * t + a * t * t / 2, v * t - (v - v_1) * (v - v_1) / (2 * a)
    )
    bound = v * t - (v - v_1) * (v - v_1) / (2 * a)
    assert_theorem(speeding >= bound, *POSITIVE, v_1 >= 0, v_1 <= v)
    tighter = v * t - (v - v_1) * (v - v_1) / (3 * a)
    assert_refuted(speeding >= tighter, *POSITIVE, v_1 >= 0, v_1 < v)


def test_stand_off_a_gap_of_the_square_of_the_closing_speed_suffices_beside_a_mover() -> None:
    """Beside it, at a lateral speed below v_o, a push keeps away if the gap is (v_o - v_y)²/2u."""
    v_y, gap = z3.Reals("v_y gap")
    away = gap + v_y * t + u * t * t / 2 - v_o * t
    assert_theorem(away >= 0, *POSITIVE, v_y <= v_o, gap >= (v_o - v_y) ** 2 / (2 * u))
    assert_refuted(away >= 0, *POSITIVE, v_y < v_o, gap == (v_o - v_y) ** 2 / (6 * u))
