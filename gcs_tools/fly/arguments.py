"""Arguments of ``clearway fly``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import RenamedOption, add_mavlink_key, natural, positive
from gcs_tools.console.errors import EXIT_NO
from gcs_tools.preflight.arguments import add_acceptance


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("fly", help="fly a scenario against the bundled simulation")
    parser.add_argument(
        "scenario", type=Path, nargs="?", metavar="SCENARIO", help="default: the paper's example"
    )
    parser.add_argument("--virtual", action="store_true", help="in virtual time, in one process")
    parser.add_argument(
        "--seed", type=natural, default=1, metavar="N", help="of the simulation; default: 1"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: flights/<scenario>-<seed>"
    )
    parser.add_argument(
        "--fly-outside-contract",
        action="store_true",
        help="fly even if the pre-flight check refuses",
    )
    add_acceptance(parser)
    parser.add_argument(
        "--clearance-wish",
        type=positive,
        metavar="M",
        help="distance to obstacles [m] to prefer with best effort: vehicle.clearance_wish_m, once",
    )
    add_mavlink_key(parser)
    parser.add_argument("--force", action=RenamedOption, const="--fly-outside-contract")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.fly.command import fly  # noqa: PLC0415  loads rich, NumPy and the simulation

    succeeded = fly(
        options.scenario,
        virtual=options.virtual,
        seed=options.seed,
        out=options.out,
        fly_outside_contract=options.fly_outside_contract,
        accept_no_progress=options.accept_no_progress,
        clearance_wish_m=options.clearance_wish,
        mavlink_key_file=options.mavlink_key,
    )
    return 0 if succeeded else EXIT_NO
