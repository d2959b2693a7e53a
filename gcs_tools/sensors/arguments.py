"""Arguments of ``clearway sensor``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import positive
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("sensor", help="what arrives from the sensors of a daemon's file")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    check = actions.add_parser(
        "check", help="who sends what, and why nothing is seen; exit code 0 all deliver, 1 not all"
    )
    check.add_argument(
        "config",
        type=Path,
        nargs="?",
        default=Path("onboard.yaml"),
        metavar="CONFIG",
        help="the daemon's own file; default: onboard.yaml",
    )
    check.add_argument(
        "--for",
        dest="seconds",
        type=positive,
        default=5.0,
        metavar="S",
        help="how long to listen; default: 5",
    )
    check.add_argument(
        "--format",
        dest="form",
        choices=("text", "json"),
        default="text",
        help="text for people (default); json for programs",
    )
    check.set_defaults(run=_check)


def _check(options: argparse.Namespace) -> int:
    from gcs_tools.sensors.command import check_sensors  # noqa: PLC0415  loads Zenoh and NumPy

    delivers = check_sensors(options.config, options.seconds, form=options.form)
    return 0 if delivers else EXIT_NO
