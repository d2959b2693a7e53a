"""Roots and ranges of real polynomials of degree three or less on an interval [0, end].

Coefficients run from the constant upwards: ``c[0] + c[1] t + c[2] t² + c[3] t³``.  A polynomial is
cut at the roots of its derivative into monotone pieces, and a sign change is bisected: slower
than a closed formula, but exact to round-off for degenerate coefficients too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_ITERATIONS_MAX = 100


def evaluate(coefficients: Sequence[float], t: float) -> float:
    """Value of the polynomial at ``t`` (Horner)."""
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * t + coefficient
    return value


def derivative(coefficients: Sequence[float]) -> tuple[float, ...]:
    """Coefficients of the derivative."""
    return tuple(i * c for i, c in enumerate(coefficients) if i > 0)


def roots(coefficients: Sequence[float], end: float) -> list[float]:
    """Where the polynomial changes sign in the open interval (0, end), in ascending order."""
    if len(coefficients) <= 3:
        return _quadratic_roots(coefficients, end)
    if _keeps_its_sign(coefficients, end):
        return []
    cuts = [0.0, *roots(derivative(coefficients), end), end]
    values = [evaluate(coefficients, t) for t in cuts]
    found: list[float] = []
    for i in range(len(cuts) - 1):
        if values[i + 1] == 0.0 and cuts[i + 1] < end:
            found.append(cuts[i + 1])
        elif values[i] * values[i + 1] < 0.0:
            found.append(_bisect(coefficients, cuts[i], cuts[i + 1], values[i]))
    return found


def _keeps_its_sign(coefficients: Sequence[float], end: float) -> bool:
    """Tell whether all Bernstein points have one sign: the curve lies within their range."""
    c0, c1, c2, c3 = coefficients
    first, second, third = c1 * end / 3.0, c2 * end * end / 3.0, c3 * end * end * end
    points = (c0, c0 + first, c0 + 2.0 * first + second, c0 + 3.0 * (first + second) + third)
    return min(points) > 0.0 or max(points) < 0.0


def value_range(coefficients: Sequence[float], end: float) -> tuple[float, float]:
    """Least and greatest value on the closed interval [0, end], exact."""
    values = [evaluate(coefficients, t) for t in (0.0, *roots(derivative(coefficients), end), end)]
    return min(values), max(values)


def _quadratic_roots(coefficients: Sequence[float], end: float) -> list[float]:
    c0, c1, c2 = (*coefficients, 0.0, 0.0, 0.0)[:3]
    discriminant = c1 * c1 - 4.0 * c2 * c0
    if discriminant < 0.0:
        return []
    # Without cancellation: one root from the sum, the other from the product.
    q = -0.5 * (c1 + math.copysign(math.sqrt(discriminant), c1))
    candidates = [
        numerator / denominator for numerator, denominator in ((q, c2), (c0, q)) if denominator
    ]
    return sorted({t for t in candidates if 0.0 < t < end})


def _bisect(coefficients: Sequence[float], low: float, high: float, value_low: float) -> float:
    """Root between ``low`` and ``high``, where the polynomial is monotone and changes sign."""
    slope = derivative(coefficients)
    t = 0.5 * (low + high)
    for _ in range(_ITERATIONS_MAX):
        value = evaluate(coefficients, t)
        if value == 0.0:
            return t
        if (value < 0.0) == (value_low < 0.0):
            low = t
        else:
            high = t
        rate = evaluate(slope, t)
        newton = t - value / rate if rate else low
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * (abs(t) + high):
            return following
        t = following
    return t
