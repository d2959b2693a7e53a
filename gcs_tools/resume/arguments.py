"""Arguments of ``clearway resume`` and ``clearway return``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_operator_key, add_output_options
from gcs_tools.console.errors import EXIT_NO

_HELP = {
    "resume": "fly on after a hold whose cause has ended; from elsewhere with --operator-key",
    "return": "fly back along the way flown; from elsewhere with --operator-key",
}


def add_parser(commands: Any) -> None:
    """Add both commands to argparse's subparsers."""
    for command, text in _HELP.items():
        _add_parser(commands.add_parser(command, help=text), command)


def _add_parser(parser: argparse.ArgumentParser, command: str) -> None:
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--zenoh-config", type=Path, metavar="F", help="how to reach the daemon")
    where.add_argument(
        "--daemon-config", type=Path, metavar="F", help="the daemon's own onboard.yaml"
    )
    add_operator_key(parser)
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_run, command=command)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.console.keys import operator_key  # noqa: PLC0415  loads pydantic
    from gcs_tools.preflight.live.bus import bus_of  # noqa: PLC0415  loads Zenoh
    from gcs_tools.resume.command import send  # noqa: PLC0415  loads Zenoh

    bus = bus_of(options.zenoh_config, options.daemon_config)
    accepted = send(
        bus,
        options.command,
        operator_key(options.operator_key),
        form=options.form,
        output=options.output,
    )
    return 0 if accepted else EXIT_NO
