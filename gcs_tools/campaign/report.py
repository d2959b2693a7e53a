"""Writes the summary of a campaign: one HTML file that needs no network."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from markupsafe import Markup
from matplotlib.figure import Figure

from gcs_tools.campaign.flight import FlightRow, replay_command
from gcs_tools.campaign.statistics import CONFIDENCE, ClassSummary, summarize, total
from gcs_tools.console.output import write_text
from gcs_tools.page import render

_COLUMNS: Final = (
    "scenario", "fault or breach", "flights", "refused", "arrived", "held", "fallback",
    "collided", "collision rate", "failed", "failure rate", "least clearance",
    "best effort", "pauses", "least rest margin",
)  # fmt: skip


def write_report(rows: Sequence[FlightRow], path: Path) -> None:
    """Write verdict, bounds per class, distributions of the margins used, and every finding.

    Raises:
        CommandError: the file cannot be written.
    """
    failed = [row for row in rows if not row.good]
    page = render(
        "summary.html",
        verdict=f"{len(failed)} of {len(rows)} flights failed" if failed else "every flight passed",
        flights=len(rows),
        hours=sum(row.virtual_s for row in rows) / 3600.0,
        confidence=CONFIDENCE,
        columns=_COLUMNS,
        rows=[
            *(
                {"style": "failed" if each.failed else "", "cells": _cells(each)}
                for each in summarize(rows)
            ),
            {"style": "total", "cells": _cells(total(rows))},
        ],
        histograms=_histograms(rows),
        failures=[{"command": replay_command(row), "findings": row.findings} for row in failed],
    )
    write_text(page, path)


def _cells(each: ClassSummary) -> tuple[object, ...]:
    flew = each.flights > each.refused
    return (
        each.source,
        each.variant if each.covered else f"{each.variant} (nothing promised)",
        each.flights,
        each.refused,
        each.arrived,
        each.held,
        each.fell_back,
        each.collided,
        _interval(each.collision_rate) if flew else "",
        each.failed,
        _interval(each.failure_rate),
        "" if each.clearance_min_m is None else f"{each.clearance_min_m:.2f} m",
        each.threaded,
        each.pauses,
        "" if each.rest_margin_min_m is None else f"{each.rest_margin_min_m:.2f} m",
    )


def _interval(bounds: tuple[float, float]) -> str:
    lower, upper = bounds
    return f"{lower:.3%} to {upper:.3%}" if lower else f"≤ {upper:.3%}"


def _histograms(rows: Sequence[FlightRow]) -> Markup:
    """Draw how much of the margins was used: clearance, and share of the tracking error."""
    figure = Figure(figsize=(11.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    clearances_m = [row.clearance_min_m for row in rows if row.clearance_min_m is not None]
    shares = [row.tracking_share for row in rows if not row.refused]
    for axes, values, label in (
        (left, clearances_m, "least clearance of a flight [m]"),
        (right, shares, "largest tracking error, as a share of the declared one"),
    ):
        axes.hist(values, bins=40, color="#36c")
        axes.set(xlabel=label, ylabel="flights")
    svg = io.StringIO()
    figure.savefig(svg, format="svg", metadata={"Date": None})
    text = svg.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704  drawn here, without text of a flight
