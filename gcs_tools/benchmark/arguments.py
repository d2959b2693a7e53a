"""Arguments of ``clearway benchmark``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import count, natural, positive
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser(
        "benchmark", help="fly public scenes, beside what peers report of them"
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        help="sando, sando-dynamic, dodgedrone, competition, longleaf, forest, or walls (our own)",
    )
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="of sando: easy, medium, hard, of sando-dynamic the first two; of dodgedrone these or "
        "easy_0 ...; of forest: stems a hectare; of walls: slalom, slalom-tight, s:GAP, "
        "door:WIDTH, trap; default: all",
    )
    parser.add_argument(
        "--data", type=Path, metavar="PATH", help="file or folder of the benchmark's scenes"
    )
    parser.add_argument(
        "--legs", type=count, metavar="N", help="of each scene; default: the benchmark's own"
    )
    parser.add_argument(
        "--every", type=count, default=1, metavar="N", help="fly each Nth leg only; default: 1"
    )
    parser.add_argument(
        "--seed", type=natural, default=1, metavar="S", help="of legs and errors; default: 1"
    )
    parser.add_argument("--jobs", type=count, metavar="J", help="processes; default: all cores")
    _add_manner(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write the legs to a .parquet file"
    )
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write this benchmark's section of a .md page"
    )
    parser.set_defaults(run=_run)


def _add_manner(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--vehicle",
        choices=("default", "ardupilot", "px4"),
        help="the latter two are safe when the setpoint stream ends; default: default, with "
        "--service ardupilot",
    )
    parser.add_argument(
        "--service",
        action="store_true",
        help="through the whole service in virtual time; default: the planner alone, against worst "
        "errors",
    )
    parser.add_argument(
        "--clearance-wish",
        type=positive,
        metavar="M",
        help="distance to obstacles [m] to prefer; default: the benchmark's own",
    )
    parser.add_argument(
        "--tracking-error", type=positive, metavar="M", help="of the planner's vehicle [m]"
    )
    parser.add_argument(
        "--first-look", action="store_true", help="the planner's vehicle turns on the spot first"
    )
    parser.add_argument(
        "--ablation",
        choices=("unseen-is-free",),
        help="the planner takes what was not seen as free: shows that the check can fail",
    )


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.benchmark.command import (  # noqa: PLC0415  loads planner and simulation
        BenchmarkRequest,
        run_benchmark,
    )

    request = BenchmarkRequest(
        name=options.name,
        scenes=tuple(options.scenes),
        data=options.data,
        legs=options.legs,
        every=options.every,
        seed=options.seed,
        processes=options.jobs,
        vehicle=options.vehicle,
        service=options.service,
        wish_m=options.clearance_wish,
        tracking_error_m=options.tracking_error,
        first_look=options.first_look,
        unseen_is_free=options.ablation == "unseen-is-free",
        output=options.output,
        page=options.page,
    )
    return 0 if run_benchmark(request) else EXIT_NO
