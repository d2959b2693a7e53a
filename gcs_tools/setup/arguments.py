"""Arguments of ``clearway init``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("init", help="write a folder of files that fit together")
    parser.add_argument("directory", type=Path, metavar="DIR", help="created if it is missing")
    parser.add_argument(
        "--vehicle", choices=("px4", "ardupilot"), default="px4", help="autopilot; default: px4"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.setup.command import init  # noqa: PLC0415  loads every model

    init(options.directory, options.vehicle)
    return 0
