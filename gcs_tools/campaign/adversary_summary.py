"""The summary of an adversary's campaign: what it used of each allowance, and what it left."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from gcs_tools.campaign.adversary.shares import summarize_shares
from gcs_tools.campaign.flight import FlightRow, replay_command
from gcs_tools.campaign.statistics import CONFIDENCE, failure_rate_bounds


def print_adversary(rows: Sequence[FlightRow], console: Console) -> None:
    """Print the allowances used, the least margin with its replay, and the bound; else nothing."""
    flown = [row for row in rows if row.least_margin_m is not None]
    if not flown:
        return
    table = Table(title="Allowances used, as shares of what the contract grants")
    table.add_column("allowance")
    for column in ("flights", "median", "least"):
        table.add_column(column, justify="right")
    for each in summarize_shares(row.shares for row in flown):
        cells = (each.name, str(each.flights), f"{each.median:.2%}", f"{each.least:.2%}")
        table.add_row(*cells)
    console.print(table)
    for line in adversary_lines(flown):
        console.print(line, markup=False, soft_wrap=True)


def adversary_lines(flown: Sequence[FlightRow]) -> list[str]:
    """Return the least margin of each promise with its replay, and the bound on broken ones.

    Args:
        flown: rows with a margin.
    """
    worst: dict[str, FlightRow] = {}
    for row in sorted(flown, key=_margin_m):
        worst.setdefault(row.least_margin_of, row)
    lines = [
        f"least margin of {promise}: {_margin_m(row):+.4f} m: {replay_command(row)}"
        for promise, row in sorted(worst.items(), key=lambda item: _margin_m(item[1]))
    ]
    drawn = [row for row in flown if not row.genes]
    broken = sum(_margin_m(row) < 0.0 for row in drawn)
    lower, upper = failure_rate_bounds(broken, len(drawn))
    rate = f"{lower:.3%} to {upper:.3%}" if broken else f"at most {upper:.3%}"
    found = sum(_margin_m(row) < 0.0 for row in flown) - broken
    bound = f"negative margins: {broken} of {len(drawn)} draws, {rate} at {CONFIDENCE:.0%}"
    return [*lines, f"{bound}; {found} of {len(flown) - len(drawn)} flights of the search"]


def _margin_m(row: FlightRow) -> float:
    return 0.0 if row.least_margin_m is None else row.least_margin_m
