"""Machine proofs of stopping and sidestepping (THEORY.md, "Stop and sidestep").

Notation as in `onboard.contract.stop_region`: V speed, b brake, κ run per speed, F front, o
overhang.
Along the leg a vehicle that brakes from V has made (V² - v²)/2b when its speed is v.
"""

from __future__ import annotations

from typing import Any

import z3

from onboard.contract import stop_region
from tests.onboard.contract.prover import Symbols, assert_refuted, assert_theorem

b, d, w, lag = z3.Reals("b d w lag")
v, v_0, kappa, hold = z3.Reals("v v_0 kappa hold")
MOVING = [b > 0, v_0 > 0, v >= 0, v <= v_0]


def braked(speed: Any) -> Any:
    """Way made from V until the speed is this."""
    return (v_0 * v_0 - speed * speed) / (2 * b)


# --- front: nowhere on the way to rest does the run on reach farther than F


def test_p1a_coasting_runs_on_farthest_from_the_full_speed() -> None:
    """run = v t_l + v²/2b: the front is run(V)."""

    def run(speed: Any) -> Any:
        return speed * hold + speed * speed / (2 * b)

    assert_theorem(braked(v) + run(v) <= run(v_0), *MOVING, hold >= 0)


def test_p1b_c_the_code_covers_every_speed_on_the_way_to_rest() -> None:
    """run = κ v: κV if V <= κb, else V²/2b + κ²b/2; both are attained."""
    front = v_0 * v_0 / (2 * b) + stop_region.run_on_ahead_m(v_0, b, kappa, Symbols().arithmetic)
    assert_theorem(braked(v) + kappa * v <= front, *MOVING, kappa >= 0)
    assert_theorem(front == kappa * v_0, *MOVING, kappa >= 0, v_0 <= kappa * b)
    slow = [*MOVING, kappa >= 0, v_0 >= kappa * b, v == kappa * b]
    assert_theorem(front == braked(v) + kappa * v, *slow)


def test_without_run_on_the_front_is_the_braking_way() -> None:
    front = stop_region.run_on_ahead_m(v_0, b, z3.RealVal(0), Symbols().arithmetic)
    assert_theorem(front == 0, b > 0, v_0 > 0)


def test_the_run_at_the_full_speed_is_not_enough_for_a_fast_vehicle() -> None:
    """The naive front max(κV, V²/2b) is passed on the way, where V > κb."""
    naive = z3.If(kappa * v_0 >= v_0 * v_0 / (2 * b), kappa * v_0, v_0 * v_0 / (2 * b))
    assert_refuted(braked(v) + kappa * v <= naive, *MOVING, kappa > 0)


def test_a_cruise_that_accelerates_within_its_pre_condition_runs_on_no_farther() -> None:
    """κ v + c a <= κ V for a <= (V - v) κ / c: the front stands for every state of the cruise."""
    a, c = z3.Reals("a c")
    pre = [kappa > 0, c > 0, v >= 0, v <= v_0, a >= 0, c * a <= (v_0 - v) * kappa]
    assert_theorem(kappa * v + c * a <= kappa * v_0, *pre)
    assert_refuted(kappa * v + c * a <= kappa * v_0, kappa > 0, c > 0, v >= 0, v <= v_0, a >= 0)


# --- sidestep: y is the way to go to the face, v_y the speed towards it

y, v_y, a_y, c, o = z3.Reals("y v_y a_y c o")


def test_p7_a_sidestep_that_keeps_its_run_within_the_overhang_ends_there() -> None:
    """κ v_y + c a_y <= y + o: wherever the stream stops, it comes to rest within o of the face."""
    end = kappa * v_y + c * a_y - y
    kept = [kappa > 0, c > 0, o > 0, v_y >= 0, kappa * v_y + c * a_y <= y + o]
    assert_theorem(end <= o, *kept, a_y >= 0)
    assert_refuted(end <= o, kappa > 0, c > 0, o > 0, v_y >= 0, kappa * v_y <= y + o, a_y >= 0)


def test_p7_from_rest_it_may_begin_with_so_much() -> None:
    """ÿ <= (y + o)/c from the first instant; without an overhang it could not begin at the face."""
    begin = [c > 0, o > 0, y >= 0, v_y == 0, a_y > 0, a_y * c <= y + o]
    assert_theorem(kappa * v_y + c * a_y <= y + o, *begin, kappa > 0)
    assert_theorem(a_y == 0, c > 0, y == 0, o == 0, a_y >= 0, a_y * c <= y + o)


def test_a_drift_comes_to_rest_within_the_overhang_and_the_extension() -> None:
    """w (T + κ) + w²/2d is the lag, the run on and the arrest of a drift at w."""
    rest = w * (lag + kappa) + w * w / (2 * d)
    drifting = [d > 0, w >= 0, lag >= 0, kappa >= 0, v_y >= 0, v_y <= w]
    assert_theorem(v_y * (lag + kappa) + v_y * v_y / (2 * d) <= rest, *drifting)
    assert_refuted(v_y * lag + kappa * v_y + v_y * v_y / (2 * d) <= w * lag, *drifting)


# --- separation (B1): boxes i and j, inflated; x from a to A, y from c to C

front, over = z3.Reals("front over")
size = z3.Real("size")
x_i, y_i, x_j, y_j = z3.Reals("x_i y_i x_j y_j")
l_i, l_j, m_i, m_j = z3.Reals("l_i l_j m_i m_j")
BOXES = [
    *[z3.And(length >= 0, length <= size) for length in (l_i, l_j, m_i, m_j)],
    front >= 0,
    over >= 0,
]


def apart(first: Any, second: Any) -> Any:
    """Return the distance of two numbers."""
    return z3.If(first >= second, first - second, second - first)


def region_meets_keep_out() -> Any:
    """The region of i, centred on (x_i, y_i), and the inflated box of j share a point."""
    along = z3.And(
        x_i - l_i / 2 - front <= x_j + l_j / 2,
        x_i + l_i / 2 >= x_j - l_j / 2,
    )
    across = z3.And(
        y_i - m_i / 2 - over <= y_j + m_j / 2,
        y_i + m_i / 2 + over >= y_j - m_j / 2,
    )
    return z3.And(along, across)


def test_b1_apart_by_one_of_the_two_no_region_meets_another_obstacle() -> None:
    clause = z3.Or(apart(x_i, x_j) > front + size, apart(y_i, y_j) > over + size)
    assert_theorem(z3.Not(region_meets_keep_out()), *BOXES, clause)


def test_b1_one_overhang_is_needed() -> None:
    clause = z3.Or(apart(x_i, x_j) > front + size, apart(y_i, y_j) > size)
    assert_refuted(z3.Not(region_meets_keep_out()), *BOXES, over > 0, clause)


def test_b1_the_diagonal_holds_in_any_direction() -> None:
    dx, dy = x_i - x_j, y_i - y_j
    far = dx * dx + dy * dy > (front + size) * (front + size) + (over + size) * (over + size)
    clause = z3.Or(apart(x_i, x_j) > front + size, apart(y_i, y_j) > over + size)
    assert_theorem(clause, front >= 0, over >= 0, size >= 0, far)


def test_b1_halves_of_the_overhang_are_disjoint_exactly_where_no_region_meets() -> None:
    """`RegionOfInfluence.apart`: one symmetric test for both directions."""

    def meets(x_1: Any, y_1: Any, l_1: Any, m_1: Any, other: tuple[Any, ...]) -> Any:
        x_2, y_2, l_2, m_2 = other
        along = z3.And(x_1 - l_1 / 2 - front <= x_2 + l_2 / 2, x_1 + l_1 / 2 >= x_2 - l_2 / 2)
        return z3.And(along, apart(y_1, y_2) <= (m_1 + m_2) / 2 + over)

    i, j = (x_i, y_i, l_i, m_i), (x_j, y_j, l_j, m_j)
    one_sided = z3.Or(meets(*i, j), meets(*j, i))
    halves = z3.And(
        x_i - l_i / 2 - front <= x_j + l_j / 2,
        x_j - l_j / 2 - front <= x_i + l_i / 2,
        apart(y_i, y_j) <= (m_i + m_j) / 2 + over / 2 + over / 2,
    )
    assert_theorem(one_sided == halves, *BOXES)


def test_b1_on_leaving_one_region_the_front_of_what_is_headed_for_is_ahead() -> None:
    """The vehicle leaves i at its border, in the region; j is headed for if y meets its band."""
    y_1 = z3.Real("y_1")
    left = [y_1 >= y_i - m_i / 2 - over, y_1 <= y_i + m_i / 2 + over]
    headed = [y_1 >= y_j - m_j / 2, y_1 <= y_j + m_j / 2, x_j + l_j / 2 >= x_i + l_i / 2]
    clause = z3.Or(apart(x_i, x_j) > front + size, apart(y_i, y_j) > over + size)
    ahead = x_j - l_j / 2 - front > x_i + l_i / 2
    assert_theorem(ahead, *BOXES, *left, *headed, clause)


# --- faces of a box at an angle: n is (cos, sin) of the angle


def test_the_corner_of_a_turned_box_is_off_by_up_to_the_diagonal_of_its_errors() -> None:
    """Off by e along both of its own axes; along the leg that is at most √2 e, and may be."""
    n_x, n_y, e, off_1, off_2 = z3.Reals("n_x n_y e off_1 off_2")
    turned = [n_x * n_x + n_y * n_y == 1, e > 0]
    within = [off_1 >= -e, off_1 <= e, off_2 >= -e, off_2 <= e]
    along = off_1 * n_x + off_2 * n_y
    assert_theorem(along * along <= 2 * e * e, *turned, *within)
    assert_refuted(along <= e, *turned, *within)


# --- coasting with an acceleration (ArduPilot): how fast it may be at the end


def test_what_still_has_to_take_its_acceleration_back_gains_less_in_a_coast() -> None:
    """|v + a t| <= V + a t - a²/2J for a reference that keeps V and J, as long as a <= J t.

    Along one axis: v' = v + a²/2J is still to come, and at most V.
    """
    a, jerk, top = z3.Reals("a jerk top")
    keeps = [jerk > 0, a >= 0, hold >= 0, v + a * a / (2 * jerk) <= top]
    assert_theorem(v + a * hold <= top + a * hold - a * a / (2 * jerk), *keeps)
    # Grows with a up to J t: the limit W stands for all that is less.
    limit = z3.Real("limit")
    bound = limit * hold - limit * limit / (2 * jerk)
    covered = [*keeps, a <= limit, limit <= jerk * hold]
    assert_theorem(a * hold - a * a / (2 * jerk) <= bound, *covered)
