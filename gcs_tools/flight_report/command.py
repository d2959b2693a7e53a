"""``clearway report``: a flight log as one HTML file that needs no network."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from gcs_tools.console.output import write_text
from gcs_tools.console.progress import progress_bar
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Document, logs_of, read_flight
from gcs_tools.page import asset

_SCRIPTS = ("map.js", "charts.js", "space.js", "report.js")


def run_report(logs: Sequence[Path], output: Path | None) -> None:
    """Write the report of a flight, or of two laid over each other; print where it is.

    Args:
        logs: one flight or two; a log, or the directory that `clearway fly` left.
        output: the file; by default ``report.html`` beside the first log.

    Raises:
        CommandError: a log holds no flight, or the file cannot be written.
    """
    first = logs[0]
    path = output or (first if first.is_dir() else first.parent) / "report.html"
    console = Console(stderr=True, highlight=False)
    flights = [_document(log) for log in logs]
    write_report(flights, path)
    for flight in flights:
        for problem in flight["problems"]:
            console.print(f"note: {problem}", style="yellow", markup=False, soft_wrap=True)
    sys.stdout.write(f"{path}\n")


def _document(path: Path) -> Document:
    size = sum(log.stat().st_size for log in logs_of(path) if log.exists())
    with progress_bar(f"reading {path.name}", size) as bar:

        def watch(read: int) -> None:
            if bar.due:
                bar.show(read)

        flight = read_flight(path, watch)
        bar.show(size, "making sense of it")
        return document_of(flight)


def write_report(flights: Sequence[Document], path: Path) -> None:
    """Write the page of one flight or two.

    Raises:
        CommandError: the file cannot be written.
    """
    # Inside a script element nothing but "<" could end the data.
    data = json.dumps(flights, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    page = asset("report.html")
    for mark, text in {
        "/*style*/": asset("page.css"),
        "/*script*/": "\n".join(asset(name).replace('"use strict";\n', "") for name in _SCRIPTS),
        "/*data*/": data,
    }.items():
        page = page.replace(mark, text)
    write_text(page, path)
