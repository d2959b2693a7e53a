"""Machine proofs of passive safety against movers (THEORY.md, "Movers").

Along the line of approach the vehicle flies at V for kappa, then brakes with b; a mover runs
towards it with v_o.  Both ways grow until the vehicle rests.
"""

from __future__ import annotations

from typing import Any

import z3

from onboard.contract.movers import Stop, passive_range_m
from tests.onboard.contract.prover import assert_refuted, assert_theorem

v, v_o, b, kappa, t_set, fixed, t, gap, lag = z3.Reals("v v_o b kappa t_set fixed t gap lag")
POSITIVE = [v > 0, v_o >= 0, b > 0, kappa >= 0, t_set >= 0, fixed >= 0, t >= 0, lag >= 0]


def way(time: Any, dead: Any = kappa) -> Any:
    """Way made after a time: V for the dead time, then braking, then rest."""
    braking = time - dead
    return z3.If(
        time <= dead,
        v * time,
        z3.If(
            b * braking <= v,
            v * dead + v * braking - b * braking * braking / 2,
            v * dead + v * v / (2 * b),
        ),
    )


def required(dead: Any = kappa) -> Any:
    """Return (1) as the code has it, without the error of a stamp."""
    stop = Stop(fixed, v, b, lag, t_set, 0)
    whole = passive_range_m(stop, dead - lag, v_o)
    return whole - (v + v_o) * z3.RealVal(1) / 100


def test_a1_farther_than_1_no_mover_touches_before_the_rest() -> None:
    moving = t <= kappa + v / b + t_set
    touches = way(t) + v_o * t + fixed >= gap
    assert_theorem(z3.Not(touches), *POSITIVE, kappa >= lag, moving, gap > required())


def test_a1_is_tight_any_nearer_a_mover_straight_on_touches_while_moving() -> None:
    """At the last instant before rest the gap is closed: 10 % less of the range fails."""
    end = kappa + v / b + t_set
    assert_theorem(way(end) + v_o * end + fixed >= gap, *POSITIVE, kappa >= lag, gap <= required())
    assert_refuted(
        way(t) + v_o * t + fixed < gap,
        *POSITIVE,
        kappa >= lag,
        v_o > 0,
        t <= end,
        10 * gap == 9 * required(),
    )


def test_accelerating_costs_its_lag_at_the_full_speed() -> None:
    """From v at a_0, ended at the jerk b/T, the way to V is no longer than flown at V in a_0 T/b.

    At V - a_0^2 T / 2b at most, so that the reference does not exceed V: then braking from V.
    """
    a_0, v_0 = z3.Reals("a_0 v_0")
    ending = a_0 * lag / b
    jerk = [a_0 >= 0, a_0 <= b, v_0 >= 0, lag > 0]
    reaches = v_0 + a_0 * ending - (b / lag) * ending * ending / 2
    made = v_0 * ending + a_0 * ending**2 / 2 - (b / lag) * ending**3 / 6
    pre = [*POSITIVE, *jerk, reaches <= v]
    assert_theorem(made <= v * ending, *pre)


def test_a2_behind_a_vehicle_twice_as_fast_nothing_is_reached() -> None:
    """v_o s <= x(s) for v >= 2 v_o: the danger set has no rear; below it has one."""
    moving = [t <= v / b, kappa == 0]
    assert_theorem(v_o * t <= way(t), *POSITIVE, *moving, v >= 2 * v_o)
    assert_refuted(v_o * t <= way(t), *POSITIVE, *moving, 2 * v > 3 * v_o, v < 2 * v_o)


def test_a4_what_a_view_does_not_show_of_a_disc_lies_within_its_radius_over_the_sine() -> None:
    """A disc of radius q about (c, 0), c >= 0, seen at a bearing with sine s, cosine k."""
    q, c, r, s, k = z3.Reals("q c r s k")
    disc = [q >= 0, c >= 0, r >= 0, s > 0, s <= 1, s * s + k * k == 1]
    inside = r * r - 2 * r * c * k + c * c <= q * q
    assert_theorem(r * s <= q, *disc, k >= 0, inside)
    assert_theorem(r <= q, *disc, k < 0, inside)
    assert_refuted(10 * r * s <= 9 * q, *disc, k >= 0, inside)


def test_a5_in_a_steady_cruise_a_mover_falls_back_across_the_line_of_its_angle() -> None:
    """n = (-sin, cos) of alpha, sin alpha = v_o / V: n.(mover - vehicle) never falls in cruise."""
    sine, cosine, x, y = z3.Reals("sine cosine x y")
    unit = [sine * sine + cosine * cosine == 1, cosine >= 0, x * x + y * y <= v_o * v_o]
    alpha = [sine * v == v_o]
    rate = -sine * (x - v) + cosine * y
    assert_theorem(rate >= 0, *POSITIVE, *unit, *alpha)
    assert_refuted(rate >= 0, *POSITIVE, *unit, 10 * sine * v == 9 * v_o, v_o > 0)


def test_a5_drift_counts_as_speed_of_the_mover() -> None:
    """With a lateral speed of at most w, sin alpha = (v_o + w) / V takes the place of v_o / V."""
    sine, cosine, x, y, w, drift = z3.Reals("sine cosine x y w drift")
    unit = [sine * sine + cosine * cosine == 1, cosine >= 0, x * x + y * y <= v_o * v_o]
    drifts = [w >= 0, drift <= w, drift >= -w]
    rate = -sine * (x - v) + cosine * (y - drift)
    assert_theorem(rate >= 0, *POSITIVE, *unit, *drifts, sine * v == v_o + w)
    assert_refuted(rate >= 0, *POSITIVE, *unit, *drifts, sine * v == v_o, w > 0, sine > 0)


def test_a5_the_danger_set_reaches_no_farther_across_than_the_clause_has_it() -> None:
    """What a mover may have come across the line of alpha, less what the vehicle has left it.

    (v_o + w) (s - x(s) / V) <= (v_o + w) (V / 2b + t_set) until rest; in the dead time nothing.
    """
    across, growing = z3.Reals("across growing")
    pre = [*POSITIVE, across >= 0, t <= kappa + v / b + t_set]
    grown = across * (t - way(t) / v)
    assert_theorem(grown <= across * growing, *pre, growing == v / (2 * b) + t_set)
    assert_theorem(grown == 0, *pre, t <= kappa)
    assert_refuted(grown <= across * growing, *pre, 10 * growing == 9 * v / (2 * b))


def test_a5_who_cruises_faster_leaves_more_behind() -> None:
    """The least speed is the worst: (v_o + w)(U / b - U^2 / 2bV) falls in U from V on."""
    faster, across = z3.Reals("faster across")
    left = across * (faster / b - faster * faster / (2 * b * v))
    pre = [*POSITIVE, across >= 0, faster >= v]
    assert_theorem(left <= across * v / (2 * b), *pre)


def test_the_kappa_of_a_dead_daemon_begins_with_the_reaction_time() -> None:
    """Flown at V for tau, then run on by l within t_run: nearer by v_o tau it touches."""
    tau, run, t_run = z3.Reals("tau run t_run")
    pre = [*POSITIVE, tau > 0, run >= 0, t_run >= 0]
    ends = tau + t_run + t_set
    closed = v * tau + run + v_o * ends + fixed
    assert_theorem(closed < gap, *pre, gap > fixed + run + v * tau + v_o * ends)
    without = fixed + run + v_o * (t_run + t_set)
    assert_refuted(closed < gap, *pre, gap > without)
