"""Arguments of ``clearway resume``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_operator_key, add_output_options
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser(
        "resume",
        help="fly on after a hold whose cause has ended; from elsewhere with --operator-key",
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--zenoh-config", type=Path, metavar="F", help="how to reach the daemon")
    where.add_argument(
        "--daemon-config", type=Path, metavar="F", help="the daemon's own onboard.yaml"
    )
    add_operator_key(parser)
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.console.keys import operator_key  # noqa: PLC0415  loads pydantic
    from gcs_tools.preflight.live.bus import bus_of  # noqa: PLC0415  loads Zenoh
    from gcs_tools.resume.command import resume  # noqa: PLC0415  loads Zenoh

    bus = bus_of(options.zenoh_config, options.daemon_config)
    accepted = resume(
        bus, operator_key(options.operator_key), form=options.form, output=options.output
    )
    return 0 if accepted else EXIT_NO
