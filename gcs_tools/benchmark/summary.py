"""Counts the legs of each field, with exact bounds, and prints them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.benchmark.legs import LegRow, Manner
from gcs_tools.benchmark.suites import Benchmark, Peer
from gcs_tools.campaign.statistics import CONFIDENCE, failure_rate_bounds

HEADER: Final = (
    *("field", "legs", "passable", "arrived", "collisions", "pass", "pass rate"),
    *(
        "collision rate",
        "mean speed",
        "without first look",
        "pauses a leg",
        "least clearance",
        "least distance",
    ),
)


@dataclass(frozen=True)
class Run:
    """A benchmark that was flown.

    Attributes:
        benchmark, manner: of which legs, and how.
        command: that flies the same legs.
        rows: of the legs that were flown, by their number.
        legs: how many it was to fly; more than it did, if it was interrupted.
    """

    benchmark: Benchmark
    manner: Manner
    command: str
    rows: Sequence[LegRow]
    legs: int

    @property
    def interruption(self) -> str:
        """Return a sentence, if it was interrupted."""
        flown = len(self.rows)
        return "" if flown == self.legs else f"Interrupted after {flown} of {self.legs} legs."


@dataclass(frozen=True)
class FieldSummary:
    """The legs of one field, or of all.

    Attributes:
        field: name.
        legs, passable, arrived, collided, passed: numbers of legs.
        pass_rate, collision_rate: Clopper-Pearson bounds at `CONFIDENCE`.
        speed_mps, moving_mps: mean over the legs that arrived, the second without the first look;
            None where none did.
        pauses: a leg.
        clearance_min_m, distance_min_m: least of all legs, of the hull and of the centre.
        losses, losses_unsafe: of the stream, tried in all.
    """

    field: str
    legs: int
    passable: int
    arrived: int
    collided: int
    passed: int
    pass_rate: tuple[float, float]
    collision_rate: tuple[float, float]
    speed_mps: float | None
    moving_mps: float | None
    pauses: float
    clearance_min_m: float | None
    distance_min_m: float | None
    losses: int
    losses_unsafe: int

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table with `HEADER`."""
        return (
            self.field,
            str(self.legs),
            str(self.passable),
            str(self.arrived),
            str(self.collided),
            str(self.passed),
            interval(self.pass_rate),
            interval(self.collision_rate),
            _number(self.speed_mps, "m/s"),
            _number(self.moving_mps, "m/s"),
            f"{self.pauses:.1f}",
            _number(self.clearance_min_m, "m"),
            _number(self.distance_min_m, "m"),
        )


def summarize(rows: Sequence[LegRow]) -> list[FieldSummary]:
    """Return a summary of each field in the order in which they come, and of all if several."""
    fields = {row.field: None for row in rows}
    found = [_summary(field, [row for row in rows if row.field == field]) for field in fields]
    return found if len(found) < 2 else [*found, _summary("all", rows)]


def _summary(field: str, rows: Sequence[LegRow]) -> FieldSummary:
    arrived = [row for row in rows if row.arrived]
    collided = sum(row.collisions > 0 for row in rows)
    passed = sum(row.passed for row in rows)
    return FieldSummary(
        field=field,
        legs=len(rows),
        passable=sum(row.passable for row in rows),
        arrived=len(arrived),
        collided=collided,
        passed=passed,
        pass_rate=failure_rate_bounds(passed, len(rows)),
        collision_rate=failure_rate_bounds(collided, len(rows)),
        speed_mps=_mean(row.length_m / row.duration_s for row in arrived),
        moving_mps=_mean(row.length_m / (row.duration_s - row.first_look_s) for row in arrived),
        pauses=sum(row.pauses for row in rows) / max(len(rows), 1),
        clearance_min_m=_least(row.clearance_min_m for row in rows),
        distance_min_m=_least(row.distance_min_m for row in rows),
        losses=sum(row.losses for row in rows),
        losses_unsafe=sum(row.losses_unsafe for row in rows),
    )


def peers_of(benchmark: Benchmark, rows: Sequence[LegRow]) -> tuple[Peer, ...]:
    """Return what peers report, and what the scenes' own file says of those that were flown."""
    least_m = benchmark.rule.distance_min_m
    kept = {
        (row.field, row.leg.partition(" way ")[0]): row.peer_distance_m
        for row in rows
        if row.peer_distance_m is not None
    }
    if least_m is None or not kept:
        return benchmark.peers
    near = sum(distance_m < least_m for distance_m in kept.values())
    said = f"less than {least_m:g} m in {near} of the {len(kept)} scenes flown here"
    return (*benchmark.peers, Peer("PX4-Avoidance", said, "the scenes' own file"))


def waits(benchmark: Benchmark, rows: Sequence[LegRow]) -> str:
    """Return a sentence about waiting for what moves; empty where nothing does."""
    if not benchmark.moves or not rows:
        return ""
    longest = max(rows, key=lambda row: row.waited_s)
    mean_s = sum(row.waited_s for row in rows) / len(rows)
    touched = sum(row.contacts_at_rest for row in rows)
    return (
        f"Waited for what moves: {mean_s:.1f} s a leg, at most {longest.waited_s:.1f} s "
        f"({longest.field}, {longest.leg}); touched at rest: {touched} times. Clearance and "
        "distance are of what stands still."
    )


def print_tables(run: Run, console: Console) -> None:
    """Print every leg, the summary, and what peers report."""
    benchmark, rows = run.benchmark, run.rows
    console.print(_legs(rows))
    if run.interruption:
        console.print(run.interruption)
    console.print(f"passes: {benchmark.rule.text}", soft_wrap=True)
    summary = Table(
        title=f"{benchmark.title}; bounds at {CONFIDENCE:.0%} (Clopper-Pearson)",
        title_justify="left",
    )
    for index, name in enumerate(HEADER):
        summary.add_column(name, justify="right" if index else "left")
    for each in summarize(rows):
        summary.add_row(*map(escape, each.cells()), style="bold red" if each.collided else "")
    console.print(summary)
    losses, unsafe = sum(row.losses for row in rows), sum(row.losses_unsafe for row in rows)
    if waited := waits(benchmark, rows):
        console.print(waited, soft_wrap=True)
    if losses:
        console.print(f"loss of the stream: {unsafe} of {losses} instants unsafe")
    peers = Table(title="what peers report", title_justify="left")
    for name in ("system", "reported", "source"):
        peers.add_column(name)
    for peer in peers_of(benchmark, rows):
        peers.add_row(*map(escape, peer))
    if peers.row_count:
        console.print(peers)
    console.print(benchmark.differences, soft_wrap=True)


def _legs(rows: Iterable[LegRow]) -> Table:
    table = Table()
    for name in ("field", "leg"):
        table.add_column(name)
    for name in ("arrived", "time", "speed", "clearance", "collisions", "passes"):
        table.add_column(name, justify="right")
    table.add_column("why not")
    for row in rows:
        table.add_row(
            escape(row.field),
            row.leg,
            "yes" if row.arrived else "no",
            f"{row.duration_s:.1f} s",
            _number(row.speed_mps, "m/s"),
            _number(row.clearance_min_m, "m"),
            str(row.collisions),
            "yes" if row.passed else "no",
            escape(row.why_not),
            style="" if row.passed else "red" if row.collisions else "yellow",
        )
    return table


def interval(bounds: tuple[float, float]) -> str:
    """Return bounds of a rate in words: one of them where the other is 0 or 1."""
    lower, upper = bounds
    if lower == 0.0:
        return f"≤ {upper:.1%}"
    return f"≥ {lower:.1%}" if upper == 1.0 else f"{lower:.1%} to {upper:.1%}"


def _number(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.2f} {unit}"


def _mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.mean(found)) if found else None


def _least(values: Iterable[float | None]) -> float | None:
    return min((value for value in values if value is not None), default=None)
