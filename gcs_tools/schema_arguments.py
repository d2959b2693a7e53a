"""Arguments of ``clearway schema``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("schema", help="write JSON Schemas of all files, for editors")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="created if it is missing"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.schemas import write_schemas  # noqa: PLC0415  loads every model

    write_schemas(options.output)
    return 0
