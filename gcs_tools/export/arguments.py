"""Command line of ``clearway export``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to the parser of all commands."""
    parser = commands.add_parser("export", help="a flight log as a file for other programs")
    parser.add_argument("flight", type=Path, metavar="FLIGHT", help="flight.mcap, or its directory")
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument(
        "--tlog",
        dest="form",
        action="store_const",
        const="tlog",
        help="MAVLink of both directions, for MAVProxy, Mission Planner, QGroundControl",
    )
    form.add_argument(
        "--foxglove",
        dest="form",
        action="store_const",
        const="foxglove",
        help="MCAP with a scene, for Foxglove and Lichtblick with config/layout.json",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="default: beside the log")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.export.command import export  # noqa: PLC0415

    export(options.flight, options.form, options.output)
    return 0
