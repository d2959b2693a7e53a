"""Machine proofs of the formulas, and the printed errors as counterexamples that a solver finds.

Every statement is put as polynomials over the reals, for all values at once.  Time is the
parameter, so that no square root is left: instead of t = √(2s/u), u t² = 2s.  z3 decides them: a
theorem holds because its negation has no solution, an erratum because the printed claim has one.
The last part ties the statements to the code: it runs on z3's reals as on floats and arrays.

Notation as in `onboard.contract.region`: b, a braking and forward, u, d right and left; V entry
speed, w drift, T lag, S size across.  ``pytest -v tests/onboard/contract/test_proofs.py`` lists
what is proven.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
import z3

from onboard.contract import region
from onboard.contract.region import Encounter
from tests.onboard.contract.prover import Symbols, assert_refuted, assert_theorem, solution

a, b, d, u, v, w = z3.Reals("a b d u v w")
lag, size, t, t_m, t_s = z3.Reals("lag size t t_m t_s")
LIMITS = [a > 0, b > 0, d > 0, u > 0]
ENTRY = [*LIMITS, v > 0, w >= 0, lag >= 0, size > 0, t_s > 0, (u + d) * t_s * t_s == 2 * size]


def advance(speed: Any, time: Any) -> Any:
    """Φ(t) while the vehicle still moves: the assumptions must say t ≤ V/b."""
    return speed * time - b * time * time / 2


# --- the prover itself


def test_the_prover_proves_and_refutes() -> None:
    assert_theorem(v * v > 0, v > 0)
    assert_refuted(v > 1, v > 0)
    with pytest.raises(AssertionError):
        assert_theorem(v > 1, v > 0)
    with pytest.raises(AssertionError):
        assert_refuted(v * v > 0, v > 0)
    with pytest.raises(AssertionError, match="nothing satisfies"):
        assert_theorem(v > 1, v > 0, v < 0)


# --- admissible accelerations: p, r are the tangents of the pitch and roll limits

g, p, r, x, y = z3.Reals("g p r x y")
TILTED = [g > 0, p > 0, r > 0]


def test_eq_7_inner_box_keeps_roll_and_pitch() -> None:
    """Eq. 4: tan θ = x/g and tan φ = y/√(g² + x²), squared."""
    within = z3.And(x * x <= p * p * g * g, y * y <= r * r * (g * g + x * x))
    inner = [x <= p * g, x >= -p * g, y <= r * g, y >= -r * g]
    assert_theorem(within, *TILTED, *inner)


def test_eq_7_as_printed_breaks_the_roll_limit() -> None:
    """Erratum 7: its y limit is r √(g² + p² g²), which is too much unless pitching fully."""
    printed = [x * x <= p * p * g * g, y >= 0, y * y <= r * r * g * g * (1 + p * p)]
    assert_refuted(y * y <= r * r * (g * g + x * x), *TILTED, *printed)
    # At its corners it is exact.
    corner = [x == p * g, y * y == r * r * g * g * (1 + p * p)]
    assert_theorem(y * y == r * r * (g * g + x * x), *TILTED, *corner)


def test_eq_4_thrust_at_the_corner_covers_the_box() -> None:
    """Erratum 8: (T/m)² = x² + y² + g² is at most g² (1 + p²)(1 + r²) on either box."""
    printed = [x * x <= p * p * g * g, y * y <= r * r * g * g * (1 + p * p)]
    covered = x * x + y * y + g * g <= g * g * (1 + p * p) * (1 + r * r)
    assert_theorem(covered, *TILTED, *printed)


# --- collision set boundary: y_r, y_l are the ways to the right and left corner

x_0, x_1, y_r, y_l, y_1 = z3.Reals("x_0 x_1 y_r y_l y_1")
t_u, t_d = z3.Reals("t_u t_d")
FACE = [y_r > 0, y_l > 0, t_u > 0, t_d > 0, u * t_u * t_u == 2 * y_r, d * t_d * t_d == 2 * y_l]


def test_eq_8_inside_the_boundary_no_input_escapes() -> None:
    """Whatever the input, the face is reached before either corner can have been passed.

    x_1, y_1 stand for any position that admissible inputs lead to at time t.
    """
    reached = [x_1 >= x_0 + advance(v, t), y_1 <= u * t * t / 2, y_1 >= -d * t * t / 2]
    inside = [t > 0, t <= t_u, t <= t_d, t * b <= v, x_0 + advance(v, t) >= 0]
    between_corners = z3.And(y_1 <= y_r, y_1 >= -y_l)
    assert_theorem(z3.And(x_1 >= 0, between_corners), *LIMITS, *FACE, v > 0, *reached, *inside)


def test_eq_19_outside_the_boundary_the_vertex_escapes() -> None:
    """Braking and pushing right: short of the face all the way, then past the corner."""
    outside = [x_0 + advance(v, t_u) < 0, t_u * b <= v]
    before = [t >= 0, t <= t_u]
    assert_theorem(x_0 + advance(v, t) < 0, *LIMITS, *FACE, v > 0, *outside, *before)
    assert_theorem(u * t_u * t_u / 2 == y_r, *LIMITS, *FACE)


def test_eq_20_outside_the_flat_part_braking_stops() -> None:
    stopped = [t * b <= v, t >= 0, x_0 + v * v / (2 * b) < 0]
    assert_theorem(x_0 + advance(v, t) < 0, *LIMITS, v > 0, *stopped)


def test_eq_9_no_point_of_the_face_takes_longer_than_t_star() -> None:
    """The shape turns at V/b = t* because t* is the longest that the nearer corner can take."""
    assert_theorem(z3.Or(t_u <= t_s, t_d <= t_s), *ENTRY, *FACE, y_r + y_l == size)


def test_eq_9_as_printed_is_unsafe() -> None:
    """Erratum 3: speeds it calls pointed, the boundary nearer than the stopping distance."""
    called_pointed = [v * v * (u + d) > b * b * size, v > 0]
    is_flat = [v <= b * t_s]
    assert_refuted(advance(v, t_s) >= v * v / (2 * b), *ENTRY, *called_pointed, *is_flat)


def test_eq_28_both_corners_are_equally_near_at_the_point() -> None:
    y_max, y_min, point = z3.Reals("y_max y_min point")
    there = [y_max > y_min, point * (u + d) == d * y_max + u * y_min]
    ways = [u * t_u * t_u == 2 * (y_max - point), d * t_d * t_d == 2 * (point - y_min)]
    assert_theorem(t_u == t_d, *LIMITS, *there, *ways, t_u > 0, t_d > 0)


def test_eq_28_as_printed_has_a_second_root() -> None:
    """Erratum 4: f_1 = f_2 also where the corners are not equally near, if u ≠ d."""
    assert_refuted(t_u == t_d, *LIMITS, *FACE, v > 0, u != d, advance(v, t_u) == advance(v, t_d))


def test_eq_20_22_as_printed_call_a_collision_safe() -> None:
    """Errata 1, 2: f_c lacks x_min, and g > 0 holds on the wrong side of it."""
    x_min, x_here = z3.Reals("x_min x_here")
    printed_safe = x_here - v * v / (2 * b) > 0
    inside = [v > 0, x_min > 0, x_here < x_min, x_here > x_min - v * v / (2 * b)]
    assert_refuted(z3.Not(printed_safe), *LIMITS, *inside)


def test_unsafe_sets_as_printed_contain_safe_starts() -> None:
    """Erratum 5: "w_1 or w_2 collides" holds where the other of them escapes."""
    right_collides = [x_0 + advance(v, t_u) >= 0, t_u * b <= v]
    left_collides = x_0 + advance(v, t_d) >= 0
    assert_refuted(left_collides, *LIMITS, *FACE, v > 0, t_d * b <= v, *right_collides)


def test_eq_16_depth_grows_with_speed_and_size() -> None:
    faster, later = z3.Reals("faster later")
    moving = [t >= 0, t * b <= v, v > 0]
    assert_theorem(advance(v, t) <= advance(faster, t), *LIMITS, *moving, faster >= v)
    longer = [t <= later, later * b <= v, t >= 0, v > 0]
    assert_theorem(advance(v, t) <= advance(v, later), *LIMITS, *longer)


# --- lateral speed at entry (theory A): y_l is the way to the left corner, and may be negative

DRIFTING = [
    t_u > 0,
    t_d > 0,
    w * t_u + u * t_u * t_u / 2 == size - y_l,
    -w * t_d + d * t_d * t_d / 2 == y_l,
    d * t_d >= w,
]


def test_theory_a_slow_drift_costs_no_time() -> None:
    assert_theorem(z3.Or(t_u <= t_s, t_d <= t_s), *ENTRY, *DRIFTING, w <= d * t_s)


def test_theory_a_fast_drift_is_outrun_in_time() -> None:
    """The worst start is the farthest one outside whose drift cannot be turned back in time."""
    outrun = [t > 0, w * t + u * t * t / 2 == size + w * w / (2 * d)]
    assert_theorem(z3.Or(t_u <= t, t_d <= t), *ENTRY, *DRIFTING, *outrun)
    assert_theorem(t >= t_s, *ENTRY, *outrun)


# --- lane


def overhang(crossing: Any, late: Any) -> Any:
    """Way beyond the face: crossed at that speed, the counter-input acts that much later."""
    peak = crossing + u * late
    return crossing * late + u * late * late / 2 + peak * peak / (2 * d)


def test_eq_12_lane_holds_every_reversal() -> None:
    assert_theorem(overhang(u * t, 0) <= overhang(u * t_m, 0), *LIMITS, t >= 0, t <= t_m)


def test_eq_12_is_the_printed_one() -> None:
    """(29): |w_1y/w_2y| (y_max - β) is (u t)²/2d where u t² = 2 (y_max - β)."""
    assert_theorem(overhang(u * t_u, 0) == u / d * y_r, *LIMITS, *FACE)


def test_theory_a_d_lane_with_drift_and_lag_holds_every_reversal() -> None:
    late, crossing = z3.Reals("late crossing")
    bounds = [t >= 0, t <= t_m, late >= 0, late <= lag, crossing >= w + u * t_m]
    assert_theorem(overhang(w + u * t, late) <= overhang(crossing, lag), *ENTRY, *bounds)


def test_eq_12_as_printed_is_left_with_drift() -> None:
    """Erratum 14: a lateral speed at entry, however small, leaves the printed lane."""
    for largest in (z3.RealVal("1/5"), z3.RealVal("1/1000")):
        slow = [t_m > 0, w > 0, w <= largest]
        assert_refuted(overhang(w + u * t_m, 0) <= overhang(u * t_m, 0), *LIMITS, *slow)


# --- post-obstacle border: m braked on after the crossing, q = t + m in all

m, q, k, m_0, m_1, c = z3.Reals("m q k m_0 m_1 c")
SCHEDULE = [
    *LIMITS,
    v > 0,
    k >= b / a,
    m_1 == (k * a - b) / (a + b),
    c == b * (k * (1 + m_1) + m_1),
]


def regained(total: Any, before: Any) -> Any:
    """Way from the crossing until V is back, having braked ``before`` and ``total`` in all."""
    return (1 + b / a) * advance(v, total) - advance(v, before)


def test_eq_15_way_until_the_speed_is_back() -> None:
    """From V - bt brake on for q - t, then speed up at a: (1 + b/a) Φ(q) - Φ(t)."""
    crossing, low = v - b * t, v - b * q
    braking = crossing * (q - t) - b * (q - t) * (q - t) / 2
    speeding_up = (v * v - low * low) / (2 * a)
    assert_theorem(braking + speeding_up == regained(q, t), *LIMITS, v > 0, t >= 0, t <= q)


def test_eq_15_lateral_speed_and_deficit_vanish_together() -> None:
    """Braking on for m = m_1 t + m_0 makes the recovery last kt + s, m_0 = s a/(a + b)."""
    settle = z3.Real("settle")
    braked = [t >= 0, settle >= 0, m_0 == settle * a / (a + b), q == t + m_1 * t + m_0]
    assert_theorem(q - t + b * q / a == k * t + settle, *SCHEDULE, *braked)


def test_eq_15_worst_crossing() -> None:
    """No crossing needs more than the one at t = (kV - (1 + k) b m_0)/c, or the first before it."""
    worst = z3.Real("worst")
    at = [t >= 0, worst * c == k * v - (1 + k) * b * m_0, m_0 >= 0, worst >= 0]
    lag_free = regained(t + m_1 * t + m_0, t) <= regained(worst + m_1 * worst + m_0, worst)
    assert_theorem(lag_free, *SCHEDULE, *at)
    # Up to t_m < worst, the last crossing is the worst.
    last = [*at, t <= t_m, t_m <= worst]
    so_far = regained(t + m_1 * t + m_0, t) <= regained(t_m + m_1 * t_m + m_0, t_m)
    assert_theorem(so_far, *SCHEDULE, *last)


def test_eq_15_without_drift_is_the_closed_form() -> None:
    """P = V k t - c t²/2."""
    closed = v * k * t - c * t * t / 2
    assert_theorem(regained(t + m_1 * t, t) == closed, *SCHEDULE, t >= 0)


def test_eq_15_is_right_for_the_boxes_of_eq_7() -> None:
    """u = d, a = b: V²/2a covers every crossing that brakes for t, and a standstill."""
    moving = [t >= 0, t * b <= v, a == b, v > 0]
    assert_theorem(regained(t, t) <= v * v / (2 * a), *LIMITS, *moving)


def test_eq_15_as_printed_is_too_short() -> None:
    """Erratum 9: for the forward limit it prints the braking limit; and it forgets lopsidedness."""
    printed = v * v / (2 * b)
    assert_refuted(v * v / (2 * a) <= printed, *LIMITS, v > 0)
    lopsided = [*SCHEDULE, a == b, k == u / d, t >= 0, t + m_1 * t <= v / b]
    assert_refuted(regained(t + m_1 * t, t) <= printed, *lopsided)
    drifting = [*SCHEDULE, a == b, k == 1, t >= 0, m_0 > 0, t + m_0 <= v / b]
    assert_refuted(regained(t + m_0, t) <= printed, *drifting)


def test_eq_15_as_printed_cannot_be_met_at_all_if_a_is_below_half_b() -> None:
    """Erratum 9: then even the whole printed region is too short to speed up in from rest."""
    region = v * v / (2 * b) + v * v / (2 * b)
    assert_theorem((v * v / (2 * a) > region) == (2 * a < b), *LIMITS, v > 0)


def test_theory_d_border_with_lag() -> None:
    """All switches act T late: the crossing at t is the lag-free one at t + T, and at most VT more.

    V (1 + b/a) T, which is what the region adds, covers that.
    """
    crossing = [t >= 0, lag >= 0, (t + lag) * b <= v]
    late = advance(v, t + lag) - advance(v, t)
    assert_theorem(late <= v * lag, *LIMITS, v > 0, *crossing)
    stands = [lag >= 0, v > 0]
    assert_theorem(v * lag <= v * (1 + b / a) * lag, *LIMITS, *stands)


# --- separation of regions

front, border, over_left, over_right = z3.Reals("front border over_left over_right")
dx, dy, s_max, s_min = z3.Reals("dx dy s_max s_min")
l_x, l_y = z3.Reals("l_x l_y")
s_1x, s_1y, s_2x, s_2y = z3.Reals("s_1x s_1y s_2x s_2y")


def largest(first: Any, second: Any) -> Any:
    return z3.If(first >= second, first, second)


def regions_meet() -> Any:
    """RoIs of an obstacle at the origin and another at (dx, dy), dx ≥ 0, Eq. 16 as corrected."""
    behind_first = largest(s_1x / 2, border - s_1x / 2)
    along = dx - s_2x / 2 - front <= behind_first
    right_of = z3.And(dy >= 0, dy - s_2y / 2 - over_left <= s_1y / 2 + over_right)
    left_of = z3.And(dy <= 0, -dy - s_2y / 2 - over_right <= s_1y / 2 + over_left)
    return z3.And(along, z3.Or(right_of, left_of))


SIZES = [
    *[z3.And(s >= s_min, s <= s_max) for s in (s_1x, s_2x)],
    *[z3.And(s >= 0, s <= s_max) for s in (s_1y, s_2y)],
    s_min >= 0,
    *[length >= 0 for length in (front, border, over_left, over_right)],
    dx >= 0,
    l_y == s_max + over_left + over_right,
]
LENGTH = l_x == front + s_max / 2 + largest(border - s_min / 2, s_max / 2)


def test_eq_16_regions_are_disjoint_at_the_separation() -> None:
    assert_theorem(z3.And(dx <= l_x, dy <= l_y, -dy <= l_y), *SIZES, LENGTH, regions_meet())
    near = [dx >= 0, l_x >= 0, l_y >= 0, dx <= l_x, dy <= l_y, -dy <= l_y]
    assert_theorem(dx * dx + dy * dy <= l_x * l_x + l_y * l_y, *near)


def test_separation_of_the_larger_length_is_unsafe() -> None:
    """Erratum 11: farther apart than max(L_x, L_y), and still they meet, on the diagonal."""
    apart = [dx * dx + dy * dy > l_x * l_x, dx * dx + dy * dy > l_y * l_y]
    assert_refuted(z3.Not(regions_meet()), *SIZES, LENGTH, *apart)


def test_separation_of_two_largest_obstacles_is_unsafe() -> None:
    """Erratum 11: a thin obstacle's border lies farther behind its centre."""
    two_largest = l_x == front + s_max / 2 + largest(border - s_max / 2, s_max / 2)
    assert_refuted(z3.Not(regions_meet()), *SIZES, two_largest, dx > l_x)
    thick = [s_1x == s_max, two_largest, dx > l_x]
    assert_theorem(z3.Not(regions_meet()), *SIZES, *thick)


# --- passive safety (theory H): coast for t, then brake

coast, run, peak, lane = z3.Reals("coast run peak lane")


def test_theory_h_forward_run_is_the_longest() -> None:
    slower = z3.Real("slower")
    speeds = [slower >= 0, slower <= v, coast >= 0]
    run_on = v * coast + v * v / (2 * b)
    assert_theorem(slower * coast + slower * slower / (2 * b) <= run_on, *LIMITS, *speeds)


def run_of_any_autopilot(speed: Any) -> Any:
    """From rest, in proportion to the speed, and its square: convex, as coast and brake is."""
    from_rest, linear, square = z3.Reals("from_rest linear square")
    return from_rest + linear * speed + square * speed * speed


def test_theory_h_a_measured_run_is_scaled_down_to_that_from_rest() -> None:
    """Below the speed X of a measurement, of at least the run from there, and at least ``rest``."""
    from_rest, linear, square, rest, slower = z3.Reals("from_rest linear square rest slower")
    convex = [from_rest >= 0, linear >= 0, square >= 0]
    measured = [v > 0, run >= run_of_any_autopilot(v), rest >= from_rest, run >= rest]
    below = [slower >= 0, slower <= v]
    scaled = rest + (run - rest) * slower / v
    assert_theorem(run_of_any_autopilot(slower) <= scaled, *convex, *measured, *below)
    # Two-tier corrections: in proportion to the speed it is too short where something is held.
    in_proportion = run * slower / v
    assert_refuted(run_of_any_autopilot(slower) <= in_proportion, *convex, *measured, *below)


def test_theory_h_no_speed_above_that_of_the_measurement_is_covered() -> None:
    from_rest, linear, square, faster = z3.Reals("from_rest linear square faster")
    convex = [from_rest >= 0, linear >= 0, square >= 0, v > 0, faster > v]
    measured = [run == run_of_any_autopilot(v)]
    assert_refuted(run_of_any_autopilot(faster) <= run * faster / v, *convex, *measured)


def test_theory_h_a_slower_flight_has_no_acceleration_that_a_faster_one_has_not() -> None:
    """Who may reach V with acceleration x at jerk j from v: also V + gap, from v + gap."""
    jerk, gap = z3.Reals("jerk gap")
    slow = [jerk > 0, x >= 0, w >= 0, w + x * x / (2 * jerk) <= v, gap >= 0]
    assert_theorem(w + gap + x * x / (2 * jerk) <= v + gap, *slow)
    # Its share of the fastest speed with that acceleration is at most that of the cruise speeds.
    share = (v - x * x / (2 * jerk)) * (v + gap) <= v * (v + gap - x * x / (2 * jerk))
    assert_theorem(share, *slow, v > 0)


def test_theory_h_coasting_sideways_adds_only_peak_speed_times_time() -> None:
    """A plan that can stop inside its lane at any instant stops inside lane plus coast."""
    planned = [y_1 + w * w / (2 * d) <= lane, w >= 0, w <= peak, coast >= 0]
    stops = y_1 + w * coast + w * w / (2 * d) <= lane + peak * coast
    assert_theorem(stops, *LIMITS, *planned)


def test_theory_h_border_of_the_extended_obstacle() -> None:
    """Eq. 15 for the box that begins ``run`` earlier is max(S_x, P - run) behind the true face."""
    extended = -run + largest(size + run, border)
    assert_theorem(extended == largest(size, border - run), run >= 0, size >= 0, border >= 0)


# --- detection and stopping (theory B, C, E)


def test_theory_e_stopping_within_the_range() -> None:
    """Seen at more than V (τ + T) + V²/2b, the vehicle stops short."""
    reaction, seen = z3.Reals("reaction seen")
    late = [reaction >= 0, lag >= 0, seen > v * (reaction + lag) + v * v / (2 * b)]
    braking = [t >= 0, t * b <= v, v > 0]
    assert_theorem(v * (reaction + lag) + advance(v, t) < seen, *LIMITS, *late, *braking)


def test_theory_b_a_misplaced_face_moves_the_border() -> None:
    """Measured e too far away, a region ends 2e behind what the most inflated box promises."""
    error, body, centre = z3.Reals("error body centre")
    measured_face = centre - size / 2 + error - (body + error)
    assert_theorem(
        measured_face + border == centre - (size + 2 * body) / 2 + border, error >= 0, body >= 0
    )
    assert_refuted(
        measured_face + border <= centre - (size + 2 * body + 4 * error) / 2 + border,
        error >= 0,
        body >= 0,
    )


# --- heading (theory I) and wind (theory J)


def test_theory_i_a_turned_point_moves_by_the_chord() -> None:
    """(cx - sy, sx + cy) is as far from (x, y) as 2 sin(psi/2) says; half = sin(psi/2)."""
    half, cosine, sine = z3.Reals("half cosine sine")
    turned = [cosine == 1 - 2 * half * half, sine * sine == 1 - cosine * cosine]
    moved_x, moved_y = cosine * x - sine * y - x, sine * x + cosine * y - y
    chord = 4 * half * half * (x * x + y * y)
    assert_theorem(moved_x * moved_x + moved_y * moved_y == chord, *turned)
    # The distance times the sine of the error is too little.
    moved = moved_x * moved_x + moved_y * moved_y
    assert_refuted(moved <= sine * sine * (x * x + y * y), *turned, half > 0, cosine > 0)


def test_theory_i_a_corner_of_what_is_in_range_is_within_range_and_diagonal() -> None:
    near_x, near_y, far_x, far_y, range_m, side, diagonal, sum_m = z3.Reals(
        "near_x near_y far_x far_y range_m side diagonal sum_m"
    )
    box = [far_x >= 0, far_x <= side, far_y >= 0, far_y <= side, side > 0]
    near = [near_x * near_x + near_y * near_y <= range_m * range_m, range_m > 0]
    length = [diagonal > 0, diagonal * diagonal == 2 * side * side, sum_m == range_m + diagonal]
    corner = (near_x + far_x) * (near_x + far_x) + (near_y + far_y) * (near_y + far_y)
    assert_theorem(corner <= sum_m * sum_m, *box, *near, *length)


def test_theory_j_wind_from_anywhere_stays_within_the_tilt() -> None:
    """What is planned in the smaller box, and the trim of any direction, is in the larger one."""
    trim, wind_x, wind_y = z3.Reals("trim wind_x wind_y")
    wind = [trim >= 0, wind_x * wind_x + wind_y * wind_y <= trim * trim]
    planned = [x <= a - trim, x >= -(b - trim), y <= u - trim, y >= -(d - trim)]
    within = z3.And(x + wind_x <= a, x + wind_x >= -b, y + wind_y <= u, y + wind_y >= -d)
    assert_theorem(within, *LIMITS, *wind, *planned)


def test_theory_j_a_sinking_plan_has_less_of_the_tilt_than_its_share() -> None:
    """W in proportion to the lift is too much for it: what the wind takes does not shrink."""
    trim, lift = z3.Reals("trim lift")
    level = [trim > 0, trim < a, lift > 0, lift < 1]
    assert_refuted(x + trim <= a * lift, *level, x <= (a - trim) * lift)
    assert_theorem(x + trim <= a * lift, *level, x <= (a - trim) * lift - trim * (1 - lift))


# --- recentring: what a drift of slope k meets the room beside it was on the edge of the view

slope, view, ago, room, far = z3.Reals("slope view ago room far")
RECENTRING = [
    *(v > 0, slope > 0, view > slope, ago > 0, room > 0, far > 0),
    room + slope * v * ago == view * v * ago,
]


def test_theory_f_what_is_met_was_within_range_and_view() -> None:
    """With view = tan β, slope = w/v: sin β - k cos β >= s/D, squared and times 1 + tan² β."""
    beyond = (view - slope) * far
    condition = beyond * beyond >= room * room * (1 + view * view)
    ahead, beside = v * ago, room + slope * v * ago
    within = ahead * ahead + beside * beside <= far * far
    assert_theorem(within, *RECENTRING, condition)
    assert_theorem(condition, *RECENTRING, within)


def test_theory_f_a_drift_ends_short_of_the_face() -> None:
    """Notice after n, lag and coasting at w, then full input: s is enough, and nothing less is."""
    n, coast, gap = z3.Reals("n coast gap")
    covered = w * (n + lag) + coast + w * w / (2 * d)
    assumptions = [*LIMITS, w > 0, lag >= 0, n >= 0, coast >= 0]
    assert_theorem(gap - covered > 0, *assumptions, gap > covered)
    assert_refuted(gap - covered > 0, *assumptions, gap > w * (n + lag) + coast)


def test_theory_f_a_view_no_wider_than_the_slope_sees_nothing_in_time() -> None:
    narrow = [v > 0, slope > 0, view > 0, view <= slope, ago > 0, room > 0]
    assert solution(*narrow, room + slope * v * ago == view * v * ago) is None


# --- the formulas that are flown: the same statements about the code itself


def encounter(**changes: Any) -> Encounter[Any]:
    """The encounter of the symbols of this file."""
    zero = z3.RealVal(0)
    plain: dict[str, Any] = {
        "brake_mps2": b,
        "forward_mps2": a,
        "left_mps2": d,
        "right_mps2": u,
        "speed_mps": v,
        "lateral_speed_mps": zero,
        "size_along_m": zero,
        "size_across_m": size,
        "attitude_lag_s": zero,
        "reaction_time_s": zero,
        "run_on_m": zero,
        "coast_time_s": zero,
        "coast_drift_m": zero,
    }
    return Encounter(**plain | changes)


def test_the_code_of_least_advance_is_phi() -> None:
    code = region.least_advance(v, b, t, Symbols().arithmetic)
    moving = [*LIMITS, v > 0, t >= 0]
    assert_theorem(code == advance(v, t), *moving, t * b <= v)
    assert_theorem(code == v * v / (2 * b), *moving, t * b >= v)
    # Whatever brakes by no more than b has got at least as far: at x'' = -b' with b' <= b.
    gentler = z3.Real("gentler")
    assert_theorem(
        code <= v * t - gentler * t * t / 2, *moving, gentler >= 0, gentler <= b, t * gentler <= v
    )


def test_the_code_of_time_to_clear_without_drift_is_t_star() -> None:
    symbols = Symbols()
    code = region.time_to_clear(encounter(), symbols.arithmetic)
    assumptions = [*LIMITS, v > 0, size > 0, t_s > 0, (u + d) * t_s * t_s == 2 * size]
    assert_theorem(code == t_s, *assumptions, *symbols.known)


def test_the_code_of_time_to_clear_with_a_slow_drift_is_t_star() -> None:
    symbols = Symbols()
    code = region.time_to_clear(encounter(lateral_speed_mps=w), symbols.arithmetic)
    slow = [w <= d * t_s, w <= u * t_s]
    # Both roots of the outrun branch exist, and are not taken.
    assert_theorem(code == t_s, *ENTRY, *slow, *symbols.known)


def test_the_code_of_the_outrun_time_reaches_the_far_side() -> None:
    """Theory A: w t + u t²/2 = S + w²/2d, for the direction that the drift goes in."""
    symbols = Symbols()
    code = region._time_to_clear_against_drift(
        u, d, t_s, encounter(lateral_speed_mps=w), symbols.arithmetic
    )
    covered = w * code + u * code * code / 2 == size + w * w / (2 * d)
    assert_theorem(covered, *ENTRY, *symbols.known, w > d * t_s)


def test_the_code_of_the_lane_is_the_overhang() -> None:
    symbols = Symbols()
    drifting = encounter(lateral_speed_mps=w, attitude_lag_s=lag)
    width, peak_speed = region.overhang(u, d, t_m, drifting, symbols.arithmetic)
    crossing = z3.Real("crossing")
    square = (w + u * t_m) * (w + u * t_m) + 2 * u * w * lag
    late = [w >= 0, lag >= 0, t_m >= 0, crossing >= 0, crossing * crossing == square]
    assert_theorem(width == overhang(crossing, lag), *LIMITS, *symbols.known, *late)
    assert_theorem(peak_speed == crossing + u * lag, *LIMITS, *symbols.known, *late)
    # The speed at the crossing is what the theorem about the lane asks for.
    assert_theorem(crossing >= w + u * t_m, *LIMITS, *late)


def test_the_code_of_the_lane_without_drift_and_lag_is_eq_12() -> None:
    symbols = Symbols()
    width, _ = region.overhang(u, d, t_m, encounter(), symbols.arithmetic)
    assert_theorem(width == overhang(u * t_m, 0), *LIMITS, *symbols.known, t_m >= 0)


@pytest.mark.parametrize(
    "limits", [(2, 2, 1, 3), (3, 2, 1, 1), (2, 5, 4, 1), (1, 1, 2, 2), (5, 1, 1, 7)], ids=str
)
def test_the_code_of_the_border_covers_every_crossing(limits: tuple[int, int, int, int]) -> None:
    """Eq. 15 as corrected, for these limits (b, a, d, u) and all speeds and crossings up to t_m.

    For all limits at once the solver gives up; that the schedule is the worst one for them is
    proven above.
    """
    braking, forward, left, right = (Fraction(each) for each in limits)
    worst = max(right / left, left / right, braking / forward)
    share = (worst * forward - braking) / (forward + braking)
    b_, a_, d_, u_, more, both = (
        z3.Q(each.numerator, each.denominator)
        for each in (braking, forward, left, right, 1 + share, 1 + braking / forward)
    )
    lopsided = encounter(brake_mps2=b_, forward_mps2=a_, left_mps2=d_, right_mps2=u_)
    code = region.recovery_distance(lopsided, t_m, Symbols().arithmetic)
    total = more * t
    way = both * (v * total - b_ * total * total / 2) - (v * t - b_ * t * t / 2)
    assert_theorem(code >= way, v > 0, t >= 0, t <= t_m, total * b_ <= v)


def test_the_code_of_the_border_is_the_speeding_up_for_the_boxes_of_eq_7() -> None:
    code = region.recovery_distance(encounter(), t_m, Symbols().arithmetic)
    moving = [*LIMITS, v > 0, t_m >= 0]
    assert_theorem(code == v * v / (2 * a), *moving, a == b, u == d)
    # A vehicle that has stopped before the face needs as much, whatever its limits.
    assert_theorem(code >= v * v / (2 * a), *moving)


def test_the_code_of_the_drift_is_the_way_that_ends_short_of_the_face() -> None:
    """Theory F and D: coasting, the lag, then full input."""
    drifting = encounter(lateral_speed_mps=w, attitude_lag_s=lag, coast_drift_m=coast)
    way = region._drift(d, drifting)
    assert_theorem(way == coast + w * lag + w * w / (2 * d), *LIMITS, w >= 0, lag >= 0)
