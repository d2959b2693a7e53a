"""Machine proofs about heights (THEORY.md, K): what is out of the way, and what hides nothing."""

from __future__ import annotations

from typing import Any

import pytest
import z3

from tests.onboard.contract.prover import assert_refuted, assert_theorem

# The leg, r_z, E_z in the estimate, how far the reference may be off, drift, e_z; all down.
leg, body, control, level, drift, error = z3.Reals("leg body control level drift error")
SIZES = [each >= 0 for each in (body, control, level, drift, error)]
half = body + control + level + drift


def off_by(value: Any, middle: Any, most: Any) -> Any:
    return z3.And(value >= middle - most, value <= middle + most)


def passing(**left_out: Any) -> tuple[Any, list[Any]]:
    """Return "no part of the body touches the obstacle", and what is known of both.

    Heights are in the estimate's frame of the sighting, which has moved by at most the drift.
    """
    reference, estimate, moved, part = z3.Reals("reference estimate moved part")
    top, bottom, measured_top, measured_bottom, point = z3.Reals("top bottom mtop mbottom point")
    known = [
        *SIZES,
        off_by(reference, leg, left_out.get("level", level)),
        off_by(estimate, reference, left_out.get("control", control)),
        off_by(moved, 0, left_out.get("drift", drift)),
        off_by(part, 0, left_out.get("body", body)),
        off_by(measured_top, top, left_out.get("error", error)),
        off_by(measured_bottom, bottom, left_out.get("error", error)),
        top <= point,
        point <= bottom,
    ]
    # What the code calls out of the way: [top - e, bottom + e] does not meet leg -+ half.
    out = z3.Or(measured_top - error > leg + half, measured_bottom + error < leg - half)
    return z3.Implies(out, estimate + moved + part != point), known


def test_what_is_out_of_the_way_is_not_touched() -> None:
    claim, known = passing()
    assert_theorem(claim, *known)


@pytest.mark.parametrize("term", ["level", "control", "drift", "body", "error"])
def test_no_error_may_be_larger_than_the_band_allows_for(term: str) -> None:
    claim, known = passing(**{term: {"level": level, "control": control, "drift": drift,
                                     "body": body, "error": error}[term] * 2})  # fmt: skip
    assert_refuted(claim, *known, error > 0, level > 0, control > 0, drift > 0, body > 0)


def test_a_line_of_sight_within_the_band_stays_in_it() -> None:
    """So what does not reach into the band hides nothing that does."""
    sensor, seen, share = z3.Reals("sensor seen share")
    low, high, top, bottom = z3.Reals("low high top bottom")
    inside = [low <= sensor, sensor <= high, low <= seen, seen <= high, share >= 0, share <= 1]
    at = sensor + share * (seen - sensor)
    assert_theorem(z3.Or(at < top, at > bottom), *inside, z3.Or(top > high, bottom < low))
    # From outside the band it is not so: a low obstacle hides what is behind it.
    assert_refuted(z3.Or(at < top, at > bottom), *inside[2:], z3.Or(top > high, bottom < low))


def test_beyond_the_blind_distance_the_whole_band_is_in_view() -> None:
    """With tan v the slope of the view's edge: a height h at distance d is below it."""
    slope, high, distance, seen = z3.Reals("slope high distance seen")
    known = [slope > 0, high >= 0, off_by(seen, 0, high), distance * slope >= high]
    assert_theorem(seen <= slope * distance, *known)
    assert_refuted(seen <= slope * distance, *known[:3], distance * slope >= high / 2, high > 0)


def test_on_the_spot_nothing_is_crossed_but_the_bands_of_start_and_leg() -> None:
    start, at, share, part = z3.Reals("start at share part")
    known = [*SIZES, share >= 0, share <= 1, off_by(part, 0, half)]
    filled = at == start + share * (leg - start) + part
    claim = z3.Or(off_by(at, leg, half), off_by(at, start, half))
    assert_theorem(claim, *known, filled, off_by(start, leg, 2 * half))
    assert_refuted(claim, *known, filled, off_by(start, leg, 3 * half), half > 0)


@pytest.mark.parametrize("doubled", [None, "control", "level", "body", "drift", "terrain"])
def test_what_keeps_to_its_height_is_flown_over(doubled: str | None) -> None:
    """The clause flown_over: up is positive, from the true local origin; drift since the start."""
    terrain, top, mission = z3.Reals("terrain top mission")
    reference, estimate, truth, part, ground, mover = z3.Reals(
        "reference estimate truth part ground mover"
    )
    most = {"control": control, "level": level, "body": body, "drift": drift, "terrain": terrain}
    if doubled is not None:
        most[doubled] = most[doubled] * 2
    known = [
        *SIZES,
        terrain >= 0,
        top >= 0,
        off_by(reference, mission, most["level"]),
        off_by(estimate, reference, most["control"]),
        off_by(truth, estimate, most["drift"]),
        off_by(part, truth, most["body"]),
        ground <= most["terrain"],
        mover <= ground + top,
        mission > body + control + drift + terrain + top + level,
    ]
    if doubled is None:
        assert_theorem(part > mover, *known)
    else:
        assert_refuted(part > mover, *known, z3.And([each > 0 for each in most.values()]))


def _climbed(time: Any, up: Any, speed: Any, whole: Any) -> Any:
    """Return the height after a time at full climb; `whole` is when the speed is reached."""
    return z3.If(time <= whole, up * time * time / 2, speed * time - speed * whole / 2)


def test_no_climb_is_quicker() -> None:
    """Formula t_up: no step from below full climb ends above it, and t_up gains h exactly."""
    up, speed, whole, time, step, height, rate, gain = z3.Reals("up v whole t dt z w c")
    limits = [up > 0, speed > 0, up * whole == speed, time >= 0, step >= 0]
    below = [height <= _climbed(time, up, speed, whole), rate <= speed, rate <= up * time]
    stepped = [gain <= up, rate + gain * step <= speed]
    after = height + rate * step + gain * step * step / 2
    for phase in (time + step <= whole, time >= whole):
        claim = after <= _climbed(time + step, up, speed, whole)
        assert_theorem(claim, *limits, *below, *stepped, phase)
    assert_refuted(
        after <= _climbed(time + step, up, speed, whole),
        *limits, *below, gain <= 2 * up, rate + gain * step <= speed, step > 0,
    )  # fmt: skip
    short = [2 * up * height <= speed * speed, height >= 0, up * time * time == 2 * height]
    long = [2 * up * height > speed * speed, time == height / speed + whole / 2]
    for case in (short, long):
        assert_theorem(_climbed(time, up, speed, whole) == height, *limits, *case)


def test_no_side_asks_for_more_than_braking() -> None:
    """So with `stop`, which asks for the whole way to rest, no further side buys speed."""
    speed, brake, time = z3.Reals("v b t")
    known = [brake > 0, speed >= 0, time >= 0]
    way = speed * time - brake * time * time / 2
    assert_theorem(2 * brake * way <= speed * speed, *known)
    assert_refuted(2 * brake * way <= speed * speed * 0.99, *known, speed > 0)
