"""Arguments of ``clearway identify``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_output_options, count, positive


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("identify", help="measure contract values in flight logs")
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="file or directory")
    parser.add_argument(
        "--system-id", type=count, metavar="N", help="of the vehicle, in a tlog of several"
    )
    parser.add_argument(
        "--margin",
        type=positive,
        default=0.25,
        metavar="SHARE",
        help="added to what was measured, as a share of it; default: 0.25",
    )
    add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.identify.command import identify  # noqa: PLC0415  loads NumPy and pymavlink

    identify(
        options.logs,
        options.system_id,
        margin=options.margin,
        form=options.form,
        output=options.output,
    )
    return 0
