"""Figures of campaigns, by assumption: a small table in the repository, made of theirs."""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Final

from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.statistics import failure_rate_bounds
from gcs_tools.campaign.table import read_table
from onboard.monitoring.assumptions import Assumption

STATED: Final = Path(__file__).parents[3] / "docs" / "data" / "campaign_figures.csv"


@dataclass(frozen=True, order=True)
class Figure:
    """What one campaign shows of one assumption.

    Attributes:
        assumption: that failed.
        campaign: generator or scenario file.
        seed: of the campaign.
        flights: of the campaign that were flown.
        failed: of those, flights in which it failed.
        covered: of those, flights that are promised to hit nothing.
        collided: of those, flights that hit something.
    """

    assumption: str
    campaign: str
    seed: int
    flights: int
    failed: int
    covered: int
    collided: int

    def __str__(self) -> str:
        """What a reader of the page needs, with the bound at 95 % on collisions."""
        _, upper = failure_rate_bounds(self.collided, self.covered) if self.covered else (0.0, 1.0)
        name = Path(self.campaign).stem
        text = f"{name}: {self.failed} of {self.flights}"
        if self.covered < 20:  # a bound would say nothing
            return f"{text}, {self.collided} collisions"
        return f"{text}, {self.collided} collisions in {self.covered} covered (≤ {upper:.1%})"


def failed_in(row: FlightRow) -> set[str]:
    """Return the assumptions that failed in a flight.

    Those that the service reported as violated (each line begins with one), and that which the
    flight's fault or scenario breaks: what costs progress only is no violation on a way to rest.
    """
    reported = set(re.findall(r"^\w+", row.violations, re.MULTILINE))
    if row.source.endswith(".yaml"):
        return reported | set(named_after(Path(row.source).stem))
    kind = _BREAKS.get(row.variant)
    return reported if kind is None else reported | {kind.value}


# Faults of a kind, of whatever amount; see gcs_tools/campaign/detection_bounds.py.
_BREAKS: Final = {
    "detections_off": Assumption.DETECTION_AGE,
    "detections_garbage": Assumption.DETECTION_AGE,
    "detections_nan": Assumption.DETECTION_AGE,
    "detections_late": Assumption.REACTION_TIME,
    "detections_short_range": Assumption.DETECTION_RANGE,
    "detections_narrow_view": Assumption.FIELD_OF_VIEW,
    "tick_stall": Assumption.TICK_OVERRUN,
}


def named_after(stem: str) -> list[str]:
    """Return the assumption that a scenario file is named after, or nothing: the longest name."""
    fitting = [each.value for each in Assumption if f"{stem}_".startswith(f"{each.value}_")]
    return sorted(fitting, key=len)[-1:]


def figures_of(rows: Iterable[FlightRow]) -> list[Figure]:
    """Count the flights of campaigns in which each assumption failed."""
    campaigns: dict[tuple[str, int], list[FlightRow]] = defaultdict(list)
    # One flight may be in several tables: of a short campaign and of a long one.
    once = {(row.source, row.campaign_seed, row.number, row.genes): row for row in rows}
    for row in once.values():
        if not row.refused:
            campaigns[row.source, row.campaign_seed].append(row)
    found = []
    for (source, seed), flown in campaigns.items():
        for assumption in sorted({name for row in flown for name in failed_in(row)}):
            failed = [row for row in flown if assumption in failed_in(row)]
            covered = [row for row in failed if row.covered]
            collided = sum(row.collisions > 0 for row in covered)
            counts = (len(flown), len(failed), len(covered), collided)
            found.append(Figure(assumption, source, seed, *counts))
    return sorted(found)


def write_figures(
    directories: Sequence[Path], path: Path = STATED, kept: Sequence[Figure] = ()
) -> None:
    """Count what the tables of some campaigns show, and state it.

    Args:
        directories: of campaigns, with their ``flights.parquet`` each.
        path: of the table.
        kept: figures that are stated, too, unless their campaign is in a directory.

    Raises:
        CommandError: a table cannot be read.
    """
    rows = [row for each in directories for row in read_table(each / "flights.parquet")]
    flown = {(row.source, row.campaign_seed) for row in rows}
    others = [each for each in kept if (each.campaign, each.seed) not in flown]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([field.name for field in fields(Figure)])
        writer.writerows(astuple(figure) for figure in sorted([*figures_of(rows), *others]))


def stated_figures(path: Path = STATED) -> tuple[Figure, ...]:
    """Return what is stated."""
    with path.open(encoding="utf-8", newline="") as stream:
        return tuple(
            Figure(each["assumption"], each["campaign"], *(int(each[name]) for name in _COUNTS))
            for each in csv.DictReader(stream)
        )


_COUNTS: Final = ("seed", "flights", "failed", "covered", "collided")
