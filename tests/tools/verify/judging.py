"""What a step left behind, in figures, and what of it must not be."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pyarrow.parquet as pq

from gcs_tools.campaign.statistics import failure_rate_bounds
from gcs_tools.campaign.table import read_table

# Exit code of a command that says no: a finding, a collision, a missed limit.
SAYS_NO: Final = 1


@dataclass(frozen=True)
class Findings:
    """What a step found.

    Attributes:
        figures: in words, by name.
        problems: what must not be, one sentence each; none of a good step.
    """

    figures: dict[str, str] = field(default_factory=dict)
    problems: tuple[str, ...] = ()


# Of the folder of a step and what it printed.
Judge = Callable[[Path, str], Findings]


def judge_campaign(folder: Path, _: str) -> Findings:
    """Count flights, collisions among the covered ones, findings; and the least margin."""
    rows = read_table(folder / "flights.parquet")
    flown = [row for row in rows if not row.refused]
    drawn = [row for row in flown if not row.genes]
    covered = [row for row in drawn if row.covered]
    collided = sum(row.collisions > 0 for row in covered)
    found = sum(bool(row.findings) for row in rows)
    margins = [row.least_margin_m for row in flown if row.least_margin_m is not None]
    figures = {
        "flights": str(len(drawn)),
        "covered by a promise": str(len(covered)),
        "collisions among those": str(collided),
        "flights with findings": str(found),
    }
    if covered:
        figures["95 % bound on collisions"] = (
            f"{failure_rate_bounds(collided, len(covered))[1]:.3%}"
        )
    problems = []
    if not flown:
        problems.append("no flight was flown")
    if searched := [row for row in rows if row.genes]:
        figures["flights of the search"] = str(len(searched))
        collided += sum(row.collisions > 0 for row in searched)
    if margins:
        figures["least margin"] = f"{min(margins):.4f} m"
        negative = sum(margin < 0.0 for margin in margins)
        problems += [f"{negative} flights with a negative margin"] * (negative > 0)
    problems += [f"{collided} collisions in flights that promise none"] * (collided > 0)
    problems += [f"{found} flights with findings"] * (found > 0)
    return Findings(figures, tuple(problems))


def judge_ambush(folder: Path, printed: str) -> Findings:
    """Count as a campaign does; ask for a contact in motion, which shows that a flight can fail."""
    found = judge_campaign(folder, printed)
    collided = sum(row.collisions > 0 for row in read_table(folder / "flights.parquet"))
    figures = {**found.figures, "with a contact in motion": str(collided)}
    missing = ("no mover faster than declared has touched the vehicle in motion",)
    return Findings(figures, found.problems + (() if collided else missing))


def judge_benchmark(folder: Path, _: str) -> Findings:
    """Count legs, those flown to their end, those that pass the benchmark's rule, collisions."""
    columns = pq.read_table(
        folder / "legs.parquet", columns=["arrived", "passed", "collisions"]
    ).to_pydict()
    collided = sum(count > 0 for count in columns["collisions"])
    figures = {
        "legs": str(len(columns["arrived"])),
        "arrived": str(sum(columns["arrived"])),
        "pass its rule": str(sum(columns["passed"])),
        "legs with a collision": str(collided),
    }
    return Findings(figures, (f"{collided} legs with a collision",) * (collided > 0))


def judge_bench(folder: Path, _: str) -> Findings:
    """Name the figures that miss their limits, with both."""
    measured = json.loads((folder / "bench.json").read_text(encoding="utf-8"))
    missed = [
        f"{name}: {each['value']:.4g} {each['unit']}, limit {_limit(each)}"
        for name, each in measured.items()
        if each["passes"] is False
    ]
    limited = sum(each["passes"] is not None for each in measured.values())
    kept = limited - len(missed)
    figures = {"figures": str(len(measured)), "limits kept": f"{kept} of {limited}"}
    return Findings(figures, tuple(missed))


def judge_bench_small(folder: Path, printed: str) -> Findings:
    """Count the figures of a run that is too short for their limits to mean anything."""
    return Findings({"figures": judge_bench(folder, printed).figures["figures"]})


def _limit(measured: dict[str, float | None]) -> str:
    if measured["limit"] is not None:
        return f"{measured['limit']:g}"
    return f"{measured['ratio_min']:g} times its peer"


def judge_mutants(_: Path, printed: str) -> Findings:
    """Read the score of a part from its last line."""
    scores = re.findall(r"^[\w-]+: (\d+ of \d+ mutants noticed.*)$", printed, re.MULTILINE)
    if not scores:
        return Findings(problems=("no score was printed",))
    return Findings({"score": scores[-1]})


def judge_traceability(folder: Path, _: str) -> Findings:
    """Count the campaigns' figures, and name the rows with an empty cell."""
    with (folder / "campaign_figures.csv").open(encoding="utf-8", newline="") as stream:
        counted = list(csv.DictReader(stream))
    lines = (folder / "traceability.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| `")]
    empty = [line.split("`")[1] for line in rows if "|  |" in line]
    with_figures = {each["assumption"] for each in counted}
    figures = {
        "assumptions": str(len(rows)),
        "with figures of campaigns": str(len(with_figures)),
        "figures": str(len(counted)),
    }
    return Findings(figures, tuple(f"empty cell: {name}" for name in empty))
