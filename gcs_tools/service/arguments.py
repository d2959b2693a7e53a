"""Arguments of ``clearway service``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("service", help="run the daemon as a systemd service")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    install = actions.add_parser("install", help="write the unit; needs root")
    install.add_argument(
        "--daemon-config",
        type=Path,
        default=Path("/etc/clearway/onboard.yaml"),
        metavar="F",
        help="the daemon's configuration; default: /etc/clearway/onboard.yaml",
    )
    install.add_argument(
        "--user", default="clearway", metavar="NAME", help="that runs it; default: clearway"
    )
    install.add_argument(
        "--unit-directory",
        type=Path,
        default=Path("/etc/systemd/system"),
        metavar="DIR",
        help="default: /etc/systemd/system",
    )
    install.add_argument(
        "--dry-run", action="store_true", help="print the unit, and change nothing"
    )
    install.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.service.command import install  # noqa: PLC0415  loads every model

    install(
        options.daemon_config,
        user=options.user,
        unit_directory=options.unit_directory,
        dry_run=options.dry_run,
    )
    return 0
