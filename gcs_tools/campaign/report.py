"""Report of a campaign: one HTML file without anything from elsewhere."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.statistics import CONFIDENCE, ClassSummary, summarize, total
from gcs_tools.console.output import write_text

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem;
       color: #222; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .7rem; text-align: right; }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
tr.failed { background: #fdd; } tr.total { font-weight: bold; }
svg { max-width: 100%; height: auto; }
pre { white-space: pre-wrap; }
"""
_EXPLANATION: Final = (
    f"<p>Intervals hold at {CONFIDENCE:.0%} (Clopper-Pearson; without a failure, the rule of "
    "three). A flight fails if any oracle finds anything; classes of which nothing is promised "
    "count collisions all the same.</p>"
)
_COLUMNS: Final = (
    "scenario", "fault or breach", "flights", "refused", "arrived", "held", "fallback",
    "collided", "collision rate", "failed", "failure rate", "least clearance",
)  # fmt: skip


def write_report(rows: Sequence[FlightRow], path: Path) -> None:
    """Write verdict, bounds per class, distributions of the margins used, and every finding.

    Raises:
        CommandError: the file cannot be written.
    """
    failed = [row for row in rows if not row.good]
    verdict = f"{len(failed)} of {len(rows)} flights failed" if failed else "every flight passed"
    body = [
        f"<h1>Campaign: {escape(verdict)}</h1>",
        f"<p>{len(rows)} flights, {sum(r.virtual_s for r in rows) / 3600.0:.1f} h flown.</p>",
        _EXPLANATION,
        _table(rows),
        _histograms(rows),
        *(_failure(row) for row in failed),
    ]
    text = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Campaign</title>'
        f"<style>{_STYLE}</style>{''.join(body)}</html>\n"
    )
    write_text(text, path)


def _table(rows: Sequence[FlightRow]) -> str:
    head = "".join(f"<th>{column}</th>" for column in _COLUMNS)
    lines = [_line(each, "failed" if each.failed else "") for each in summarize(rows)]
    return f"<table><tr>{head}</tr>{''.join(lines)}{_line(total(rows), 'total')}</table>"


def _line(each: ClassSummary, style: str) -> str:
    variant = each.variant if each.covered else f"{each.variant} (nothing promised)"
    clearance = "" if each.clearance_min_m is None else f"{each.clearance_min_m:.2f} m"
    flew = each.flights > each.refused
    cells: Iterable[object] = (
        each.source,
        variant,
        each.flights,
        each.refused,
        each.arrived,
        each.held,
        each.fell_back,
        each.collided,
        _interval(each.collision_rate) if flew else "",
        each.failed,
        _interval(each.failure_rate),
        clearance,
    )
    inner = "".join(f"<td>{escape(str(cell))}</td>" for cell in cells)
    return f'<tr class="{style}">{inner}</tr>'


def _interval(bounds: tuple[float, float]) -> str:
    lower, upper = bounds
    return f"{lower:.3%} to {upper:.3%}" if lower else f"≤ {upper:.3%}"


def _histograms(rows: Sequence[FlightRow]) -> str:
    """How much of the margins was used: clearance, and share of the declared tracking error."""
    figure = Figure(figsize=(11.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    clearances_m = [row.clearance_min_m for row in rows if row.clearance_min_m is not None]
    shares = [row.tracking_share for row in rows if not row.refused]
    for axes, values, label in (
        (left, clearances_m, "least clearance of a flight [m]"),
        (right, shares, "largest tracking error, share of the declared one"),
    ):
        axes.hist(values, bins=40, color="#36c")
        axes.set(xlabel=label, ylabel="flights")
    svg = io.StringIO()
    figure.savefig(svg, format="svg", metadata={"Date": None})
    return svg.getvalue()[svg.getvalue().index("<svg") :]


def _failure(row: FlightRow) -> str:
    name = f"{row.source} --seed {row.campaign_seed} --only {row.number}"
    return f"<h3>clearway campaign {escape(name)}</h3><pre>{escape(row.findings)}</pre>"
