"""Turns records into columns of numbers: aligned, thinned, rounded, null where unknown."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from onboard.geometry.frames import FloatArray

R = TypeVar("R")
Column = list[float | None]

# More samples than any screen has pixels, and few enough for a page that opens at once.
SAMPLES_MAX = 6000


class Columns(Generic[R]):
    """Reads columns from records, all thinned alike.

    Args:
        records: of one topic, in the order of time.
    """

    def __init__(self, records: Sequence[R]) -> None:
        self._records = records
        self._stride = max(1, math.ceil(len(records) / SAMPLES_MAX))

    def of(self, read: Callable[[R], float | None], digits: int = 3) -> Column:
        """Return what ``read`` finds in every record that is kept."""
        return _rounded(self._numbers(read)[:: self._stride], digits)

    def peaks(self, read: Callable[[R], float | None], digits: int = 3, *, back: int = 0) -> Column:
        """Return the largest value of each stretch that is thinned to one, so that no peak is lost.

        Args:
            read: finds a value in a record.
            digits: to keep.
            back: number of records before the stretch that count with it, which turns a saw-tooth
                into its envelope.
        """
        values = self._numbers(read)
        known = np.where(np.isnan(values), -math.inf, values)
        before = np.append(np.full(back, -math.inf), known)
        tops = np.lib.stride_tricks.sliding_window_view(before, back + 1).max(axis=1)
        padded = np.append(tops, np.full(-len(tops) % self._stride, -math.inf))
        peaks = padded.reshape(-1, self._stride).max(axis=1)
        return _rounded(np.where(np.isneginf(peaks), math.nan, peaks), digits)

    def vector(
        self, read: Callable[[R], Sequence[float] | None], axis: int, *, scale: float = 1.0
    ) -> Column:
        """Return one component of a vector."""
        return self.of(lambda record: _component(read(record), axis, scale))

    def angle_deg(self, read: Callable[[R], float | None]) -> Column:
        """Return an angle in degrees."""
        return self.of(lambda record: _degrees(read(record)), 2)

    def _numbers(self, read: Callable[[R], float | None]) -> FloatArray:
        # numpy reads None as NaN.
        return np.array([read(record) for record in self._records], dtype=np.float64)


def _component(vector: Sequence[float] | None, axis: int, scale: float) -> float | None:
    return None if vector is None or len(vector) <= axis else scale * vector[axis]


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def _rounded(values: FloatArray, digits: int) -> Column:
    return [value if math.isfinite(value) else None for value in np.round(values, digits).tolist()]
