"""Flights counted per class."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.campaign.statistics import failure_rate_bounds, summarize, total
from tests.gcs_tools.campaign.rows import row

FLIGHTS = (
    row(),
    row(number=1, outcome="held", clearance_min_m=0.2, plans_brake=1),
    row(number=2, outcome="aborted", refused=True, clearance_min_m=None),
    row(number=3, outcome="collided", collisions=2, findings="no_collision: 2 collision(s)"),
    row(number=4, variant="gust", covered=False, violations="wind"),
)


def test_a_class_is_a_source_a_variant_and_a_promise() -> None:
    mixed = [*FLIGHTS, row(source="faults", variant="gust"), row(variant="gust")]
    keys = [(each.source, each.variant, each.covered) for each in summarize(mixed)]
    assert keys == [
        ("faults", "gust", True),
        ("quick", "gust", False),
        ("quick", "gust", True),
        ("quick", "none", True),
    ]


def test_each_flight_is_counted_by_how_it_came_out() -> None:
    (nominal,) = (each for each in summarize(FLIGHTS) if each.variant == "none")
    assert (nominal.flights, nominal.refused) == (4, 1)
    assert (nominal.arrived, nominal.held, nominal.collided) == (1, 1, 1)
    assert (nominal.fell_back, nominal.failed) == (1, 1)
    assert nominal.clearance_min_m == 0.2
    # Only flights that flew can collide, while a refused one can fail.
    assert nominal.collision_rate == failure_rate_bounds(1, 3)
    assert nominal.failure_rate == failure_rate_bounds(1, 4)


def test_the_total_is_of_covered_flights_alone() -> None:
    assert total(FLIGHTS).flights == 4
    assert total(FLIGHTS[4:]).flights == 0
    assert total([]).failure_rate == (0.0, 1.0)


def test_no_obstacle_gives_no_clearance() -> None:
    (summary,) = summarize([row(clearance_min_m=None)])
    assert summary.clearance_min_m is None


@pytest.mark.parametrize(("failures", "trials"), [(-1, 5), (6, 5), (1, 0)])
def test_impossible_counts_are_refused(failures: int, trials: int) -> None:
    with pytest.raises(ValueError, match=f"{failures} failures in {trials} trials: expected 0 to"):
        failure_rate_bounds(failures, trials)


@given(st.integers(0, 200), st.integers(0, 200))
def test_failures_and_passes_mirror_each_other(failures: int, passes: int) -> None:
    trials = failures + passes
    lower, upper = failure_rate_bounds(failures, trials)
    mirrored_lower, mirrored_upper = failure_rate_bounds(passes, trials)
    if trials:
        assert lower == pytest.approx(1.0 - mirrored_upper, abs=1e-9)
        assert upper == pytest.approx(1.0 - mirrored_lower, abs=1e-9)


@given(st.integers(0, 50), st.integers(51, 300), st.floats(0.5, 0.98))
def test_more_confidence_needs_a_wider_interval(
    failures: int, trials: int, confidence: float
) -> None:
    lower, upper = failure_rate_bounds(failures, trials, confidence)
    wider_lower, wider_upper = failure_rate_bounds(failures, trials, confidence + 0.01)
    assert wider_lower <= lower
    assert upper < wider_upper


@pytest.mark.parametrize(
    ("changes", "fell_back"),
    [
        ({}, False),
        ({"violations": "wind"}, True),
        ({"outcome": "held"}, True),
        ({"plans_brake": 1}, True),
        ({"plans_vertex": 3}, False),
    ],
)
def test_what_counts_as_a_fallback(changes: dict[str, object], *, fell_back: bool) -> None:
    assert row(**changes).fell_back is fell_back
