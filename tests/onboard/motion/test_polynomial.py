"""Roots and ranges of polynomials against dense sampling and against factors known beforehand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onboard.motion import polynomial

NUMBERS = st.floats(-9.0, 9.0)
COEFFICIENTS = st.lists(NUMBERS, min_size=1, max_size=4)
ENDS = st.floats(0.01, 20.0)


def from_roots(leading: float, *roots: float) -> tuple[float, ...]:
    """Coefficients of leading (t - r1) (t - r2) ..., the constant first."""
    return tuple((leading * np.poly(roots))[::-1].tolist())


@given(COEFFICIENTS, NUMBERS)
def test_a_value_is_the_sum_of_its_powers(coefficients: list[float], t: float) -> None:
    expected = sum(c * t**power for power, c in enumerate(coefficients))
    assert polynomial.evaluate(coefficients, t) == pytest.approx(expected, abs=1e-6)


def test_no_coefficients_are_the_zero_polynomial() -> None:
    assert polynomial.evaluate((), 3.0) == 0.0
    assert polynomial.derivative((5.0,)) == ()
    assert polynomial.derivative(()) == ()


@given(COEFFICIENTS, st.floats(-3.0, 3.0))
def test_the_derivative_is_the_slope(coefficients: list[float], t: float) -> None:
    step = 1e-5
    after = polynomial.evaluate(coefficients, t + step)
    before = polynomial.evaluate(coefficients, t - step)
    slope = polynomial.evaluate(polynomial.derivative(coefficients), t)
    assert slope == pytest.approx((after - before) / (2.0 * step), abs=1e-4)


@given(
    st.lists(st.floats(0.05, 9.0), min_size=1, max_size=3, unique=True),
    st.floats(0.1, 5.0) | st.floats(-5.0, -0.1),
)
def test_simple_roots_are_all_found(roots: list[float], leading: float) -> None:
    roots = sorted(roots)
    assume(all(after - before > 1e-2 for before, after in itertools.pairwise(roots)))
    found = polynomial.roots(from_roots(leading, *roots), 9.5)
    assert found == pytest.approx(roots, abs=1e-6)


@given(COEFFICIENTS, ENDS)
def test_every_sign_change_has_a_root_and_every_root_is_one(
    coefficients: list[float], end: float
) -> None:
    found = polynomial.roots(coefficients, end)
    assert found == sorted(found)
    assert all(0.0 < t < end for t in found)
    scale = sum(abs(c) * end**power for power, c in enumerate(coefficients))
    for t in found:
        assert abs(polynomial.evaluate(coefficients, t)) <= 1e-9 * scale + 1e-12
    times = np.linspace(0.0, end, 257)
    values = np.array([polynomial.evaluate(coefficients, t) for t in times.tolist()])
    clear = np.abs(values) > 1e-6 * scale + 1e-12
    for i in range(256):
        if clear[i] and clear[i + 1] and values[i] * values[i + 1] < 0.0:
            assert any(times[i] <= t <= times[i + 1] for t in found)


@pytest.mark.parametrize(
    ("coefficients", "end", "expected"),
    [
        ((1.0,), 5.0, []),
        ((0.0,), 5.0, []),
        ((-1.0, 1.0), 5.0, [1.0]),
        ((-1.0, 1.0), 1.0, []),  # the end is not inside
        ((0.0, 1.0), 5.0, []),  # nor is the beginning
        ((2.0, -3.0, 1.0), 5.0, [1.0, 2.0]),
        ((2.0, -3.0, 1.0), 1.5, [1.0]),
        ((1.0, 0.0, 1.0), 5.0, []),
        ((1e-12, -1.0, 0.0), 5.0, [1e-12]),
        ((-6.0, 11.0, -6.0, 1.0), 5.0, [1.0, 2.0, 3.0]),
        ((-8.0, 12.0, -6.0, 1.0), 5.0, [2.0]),  # a triple root changes the sign
        ((-2.0, 5.0, -4.0, 1.0), 5.0, [2.0]),  # (t - 1)² (t - 2): at 1 it only touches
        ((0.0, -1.0, 0.0, 1.0), 5.0, [1.0]),
        ((-1.0, 1.0, 0.0, 0.0), 5.0, [1.0]),  # a line, as a cubic
        ((-1.0, 0.0, 1.0, 1e-18), 5.0, [1.0]),
    ],
)
def test_roots_by_hand(coefficients: tuple[float, ...], end: float, expected: list[float]) -> None:
    found = polynomial.roots(coefficients, end)
    crossing = [t for t in found if t == pytest.approx(t, abs=1e-9)]
    for t in expected:
        assert any(math.isclose(each, t, abs_tol=1e-5) for each in crossing)
    if coefficients != (-2.0, 5.0, -4.0, 1.0):
        assert len(found) == len(expected)


def test_a_small_root_does_not_cancel() -> None:
    """t² - 1e8 t + 1: by the school formula the small root is off in every digit."""
    (small,) = polynomial.roots((1.0, -1e8, 1.0), 1.0)
    assert small == pytest.approx(1e-8, rel=1e-12)


@given(COEFFICIENTS, ENDS)
def test_the_range_bounds_all_values_and_is_attained(coefficients: list[float], end: float) -> None:
    low, high = polynomial.value_range(coefficients, end)
    scale = 1e-9 * (1.0 + sum(abs(c) * end**power for power, c in enumerate(coefficients)))
    values = [polynomial.evaluate(coefficients, t) for t in np.linspace(0.0, end, 500).tolist()]
    assert low - scale <= min(values)
    assert max(values) <= high + scale
    assert low <= min(values[0], values[-1])
    assert high >= max(values[0], values[-1])
    # No farther than what lies between two samples.
    step = end / 499.0
    slope = sum(abs(c) * power * end ** max(power - 1, 0) for power, c in enumerate(coefficients))
    assert min(values) <= low + slope * step + scale
    assert max(values) >= high - slope * step - scale
