"""The hot paths are as fast, beside their peers, as when the ratios were stored."""

from __future__ import annotations

import json

import pytest

from tests.benchmarks.ratios import STORED, WORSE_MAX, Pair, measured, pairs

RATIOS = json.loads(STORED.read_text(encoding="utf-8"))


def test_every_pair_has_a_stored_ratio() -> None:
    assert RATIOS.keys() == pairs().keys()


@pytest.mark.parametrize("name", pairs())
def test_a_hot_path_is_not_slower_than_stored(name: str) -> None:
    ratio = measured(pairs()[name](), RATIOS[name])
    assert ratio <= WORSE_MAX * RATIOS[name]


def test_a_ratio_is_that_of_the_least_times() -> None:
    def spin(count: int) -> int:
        return sum(range(count))

    ratio = measured(Pair(lambda: spin(200_000), lambda: spin(100_000)), 2.0)
    assert 1.6 < ratio < 2.5
