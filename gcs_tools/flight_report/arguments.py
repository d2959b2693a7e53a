"""Arguments of ``clearway report``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("report", help="write a flight log, or two compared, as HTML")
    parser.add_argument("log", type=Path, metavar="LOG", help="flight.mcap, or its directory")
    parser.add_argument(
        "other", type=Path, nargs="?", metavar="LOG", help="a second flight, to compare"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: report.html beside the log"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.flight_report.command import run_report  # noqa: PLC0415  loads rich and NumPy

    logs = [options.log] if options.other is None else [options.log, options.other]
    run_report(logs, options.output)
    return 0
