"""Arguments of ``clearway fleet``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_output_options
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("fleet", help="several vehicles at one site: may two ever meet?")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    _add_check(actions)


def _add_check(actions: Any) -> None:
    parser = actions.add_parser(
        "check", help="are all corridors disjoint? exit code 0 yes, 1 no, 2 bad input"
    )
    parser.add_argument("fleet", type=Path, metavar="FLEET", help="fleet file, YAML")
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_check)


def _check(options: argparse.Namespace) -> int:
    from gcs_tools.fleet.check import check_fleet  # noqa: PLC0415  loads rich, Shapely, SciPy

    holds = check_fleet(options.fleet, form=options.form, output=options.output)
    return 0 if holds else EXIT_NO
