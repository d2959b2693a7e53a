"""Arguments of ``clearway campaign``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import count, natural
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("campaign", help="fly many seeded flights in virtual time")
    parser.add_argument(
        "scenarios",
        nargs="+",
        metavar="SCENARIO",
        help="nominal, violating, faults, outside, competition, best-effort, best-effort-faults, "
        "movers, faster-movers, passed-movers, ambush, pedestrians, quick, quick-faults, "
        "adversary; scenario files; stem maps (CSV)",
    )
    parser.add_argument(
        "--flights", type=natural, default=100, metavar="N", help="in all; default: 100"
    )
    parser.add_argument(
        "--seed", type=natural, default=1, metavar="S", help="of the campaign; default: 1"
    )
    parser.add_argument("--only", type=natural, metavar="N", help="replay flight number N alone")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=count, metavar="J", help="processes; default: all cores")
    where.add_argument("--dask", metavar="ADDRESS", help="tcp://… of a Dask scheduler")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: campaigns/<scenarios>-<seed>"
    )
    parser.add_argument(
        "--shrink",
        type=natural,
        default=3,
        metavar="N",
        help="reduce N of the failing flights to minimal scenarios; default: 3",
    )
    parser.add_argument(
        "--search",
        type=natural,
        default=0,
        metavar="N",
        help="adversary: so many more flights near those with the least margins; default: 0",
    )
    parser.add_argument(
        "--genes", default="", metavar="G", help="adversary: replay what a search has moved"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.campaign.command import (  # noqa: PLC0415  loads the simulation and PyArrow
        CampaignRequest,
        run_campaign,
    )

    request = CampaignRequest(
        scenarios=tuple(options.scenarios),
        flights=options.flights,
        seed=options.seed,
        only=options.only,
        processes=options.jobs,
        dask=options.dask,
        out=options.out,
        shrink=options.shrink,
        search=options.search,
        genes=options.genes,
    )
    return 0 if run_campaign(request) else EXIT_NO
