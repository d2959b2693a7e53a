"""``clearway report``: a flight log as one HTML file that needs no network."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from gcs_tools.console.output import write_text
from gcs_tools.console.progress import progress_bar
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Document, logs_of, read_flight
from gcs_tools.page import render


def run_report(logs: Sequence[Path], output: Path | None) -> None:
    """Write the report of one flight, or of two compared; print its path.

    Args:
        logs: of one flight or two; a log, or the directory that `clearway fly` wrote.
        output: the file; by default ``report.html`` beside the first log.

    Raises:
        CommandError: a log has no flight, or the file cannot be written.
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
        bar.show(size, "building the report")
        return document_of(flight)


def write_report(flights: Sequence[Document], path: Path) -> None:
    """Write the page of one flight, or of two compared.

    Raises:
        CommandError: the file cannot be written.
    """
    write_text(render("report.html", flights=flights), path)
