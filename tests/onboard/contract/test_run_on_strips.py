"""The strips of a run cover all of it, and each of them less than the whole."""

import math
import random
from itertools import pairwise

import pytest

from gcs_tools.benchmark.run_on_models import coasting_run_on, frozen_run_on
from onboard.contract.run_on import RunOn

RUNS = {
    "coasting": coasting_run_on(
        0.5, lag_s=0.2, brake_mps2=2.0, speed_max_mps=3.0, acceleration_max_mps2=3.0
    ),
    "frozen": frozen_run_on(1.1, gain_per_s=0.95, velocity_gain_per_s=1.8),
    "measured": RunOn(((0.5, 0.0), (0.5, 0.125), (1.68, 0.0), (1.68, 0.7))),
    "without acceleration": RunOn(((1.2, 0.0),)),
}


def holds(strip: tuple[tuple[float, float], ...], kappa_s: float, c_s2: float) -> bool:
    """Tell whether the box around a strip's points holds a point."""
    kappas_s, cs_s2 = zip(*strip, strict=True)
    return bool(
        min(kappas_s) - 1e-12 <= kappa_s <= max(kappas_s) + 1e-12
        and min(cs_s2) - 1e-12 <= c_s2 <= max(cs_s2) + 1e-12
    )


@pytest.mark.parametrize("name", RUNS)
def test_every_point_of_the_run_is_in_a_strip(name: str) -> None:
    run, draw = RUNS[name], random.Random(1)
    corners = [(0.0, 0.0), *run.gains]
    for _ in range(500):
        weights = [draw.expovariate(1.0) for _ in corners]
        kappa_s, c_s2 = (
            sum(w * corner[i] for w, corner in zip(weights, corners, strict=True)) / sum(weights)
            for i in (0, 1)
        )
        assert any(holds(strip, kappa_s, c_s2) for strip in run.strips)


@pytest.mark.parametrize("name", RUNS)
def test_a_strip_is_a_small_part_of_the_run_and_meets_the_next(name: str) -> None:
    run = RUNS[name]
    longest_s = max(kappa_s for kappa_s, _ in run.gains)
    spans = [(min(k for k, _ in strip), max(k for k, _ in strip)) for strip in run.strips]
    assert all(end_s - begin_s < 0.2 * longest_s for begin_s, end_s in spans)
    assert all(one[1] == pytest.approx(other[0]) for one, other in pairwise(spans))
    assert spans[0][0] == 0.0
    assert spans[-1][1] == pytest.approx(longest_s)


def test_without_a_run_there_is_the_setpoint_alone() -> None:
    assert RunOn().strips == (((0.0, 0.0),),)


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_a_strip_of_a_triangle_is_as_high_as_the_triangle_there(turned: float) -> None:
    """Points within the triangle, or on its edges, change nothing."""
    inner = ((1.0, 0.5), (1.5, 0.0), (1.5, 1.5), (0.5, 0.2))
    run = RunOn(tuple((turned * k, c) for k, c in ((2.0, 0.0), *inner, (2.0, 2.0))))
    assert len(run.strips) == len(RunOn(((0.1, 0.0), (0.1, 0.1))).strips) > 1
    for strip in run.strips:
        kappas_s, cs_s2 = zip(*strip, strict=True)
        assert min(cs_s2) == pytest.approx(0.0, abs=1e-12)
        assert max(cs_s2) == pytest.approx(max(abs(kappa_s) for kappa_s in kappas_s))
    widths_s = [max(k for k, _ in strip) - min(k for k, _ in strip) for strip in run.strips]
    assert widths_s == pytest.approx([2.0 / len(run.strips)] * len(run.strips))


def test_strips_of_a_run_to_both_sides_begin_behind() -> None:
    run = RunOn(((-1.0, 0.5), (1.0, 1.0), (3.0, 0.5)))
    assert min(kappa_s for kappa_s, _ in run.strips[0]) == -1.0
    assert max(kappa_s for kappa_s, _ in run.strips[-1]) == pytest.approx(3.0)
    at_ends = [{c for k, c in s if k in (-1.0, 3.0)} for s in (run.strips[0], run.strips[-1])]
    assert at_ends == [{0.5}, {0.5}]


def test_a_run_that_is_unknown_is_one_strip_with_the_setpoint() -> None:
    (strip,) = RunOn(((math.nan, 0.0), (1.0, 0.5))).strips
    assert strip[0] == (0.0, 0.0)
    assert len(strip) == 3
    assert math.isnan(strip[1][0])
