"""Counts the flights of a campaign per class, with exact bounds on failure rates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from scipy.special import betaincinv

from gcs_tools.campaign.flight import FlightRow

CONFIDENCE: Final = 0.95


def failure_rate_bounds(
    failures: int, trials: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a rate: two-sided, or one-sided if none or all failed.

    Without a failure in n trials, all of the error probability goes to the upper bound, which is
    then 1 - 0.05^(1/n), about 3/n: the rule of three.

    Raises:
        ValueError: ``failures`` is negative or exceeds ``trials``.
    """
    if not 0 <= failures <= trials:
        raise ValueError(f"{failures} failures in {trials} trials: expected 0 to {trials}")
    if trials == 0:
        return 0.0, 1.0
    tail = 1.0 - confidence if failures in (0, trials) else (1.0 - confidence) / 2.0
    passes = trials - failures
    # Quantiles of the beta distribution; scipy.stats has them too, but takes a second to import.
    lower = float(betaincinv(failures, passes + 1, tail)) if failures else 0.0
    upper = float(betaincinv(failures + 1, passes, 1.0 - tail)) if passes else 1.0
    return lower, upper


@dataclass(frozen=True)
class ClassSummary:
    """The flights of one source and variant.

    Attributes:
        source, variant: of the class; the variant is a breach or a kind of fault.
        covered: whether the contract promises that its flights have no collision.
        flights: number of flights, refused ones included.
        refused, arrived, held: number of flights with that outcome.
        fell_back: flights in which the service used a fallback.
        collided: flights with a collision.
        failed: flights in which an oracle has a finding.
        collision_rate: bounds, of the flights that flew.
        failure_rate: bounds, of all flights.
        clearance_min_m: smallest of the class; None without obstacles.
        threaded: flights of which a part was flown with best effort.
        pauses: of all flights together.
        rest_margin_min_m: smallest of the class; None where no way to rest was held.
    """

    source: str
    variant: str
    covered: bool
    flights: int
    refused: int
    arrived: int
    held: int
    fell_back: int
    collided: int
    failed: int
    collision_rate: tuple[float, float]
    failure_rate: tuple[float, float]
    clearance_min_m: float | None
    threaded: int
    pauses: int
    rest_margin_min_m: float | None


def summarize(rows: Iterable[FlightRow]) -> list[ClassSummary]:
    """Return one summary per source, variant and coverage, in alphabetical order."""
    classes: dict[tuple[str, str, bool], list[FlightRow]] = {}
    for row in rows:
        classes.setdefault((row.source, row.variant, row.covered), []).append(row)
    return [_summary(key, members) for key, members in sorted(classes.items())]


def total(rows: Sequence[FlightRow]) -> ClassSummary:
    """Return the summary of all covered flights."""
    return _summary(("all", "covered", True), [row for row in rows if row.covered])


def _summary(key: tuple[str, str, bool], rows: Sequence[FlightRow]) -> ClassSummary:
    source, variant, covered = key
    refused = sum(row.refused for row in rows)
    collided = sum(row.collisions > 0 for row in rows)
    failed = sum(not row.good for row in rows)
    clearances_m = [row.clearance_min_m for row in rows if row.clearance_min_m is not None]
    margins_m = [row.rest_margin_min_m for row in rows if row.rest_margin_min_m is not None]
    return ClassSummary(
        source=source,
        variant=variant,
        covered=covered,
        flights=len(rows),
        refused=refused,
        arrived=sum(row.outcome == "arrived" for row in rows),
        held=sum(row.outcome == "held" for row in rows),
        fell_back=sum(row.fell_back for row in rows),
        collided=collided,
        failed=failed,
        collision_rate=failure_rate_bounds(collided, len(rows) - refused),
        failure_rate=failure_rate_bounds(failed, len(rows)),
        clearance_min_m=min(clearances_m, default=None),
        threaded=sum(row.threaded for row in rows),
        pauses=sum(row.pauses for row in rows),
        rest_margin_min_m=min(margins_m, default=None),
    )
