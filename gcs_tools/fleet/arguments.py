"""Arguments of ``clearway fleet``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_output_options, count, natural, positive
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("fleet", help="several vehicles at one site: may two ever meet?")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    _add_check(actions)
    _add_simulate(actions)
    _add_fly(actions)


def _add_check(actions: Any) -> None:
    parser = actions.add_parser(
        "check", help="are all corridors disjoint? exit code 0 yes, 1 no, 2 bad input"
    )
    parser.add_argument("fleet", type=Path, metavar="FLEET", help="fleet file, YAML")
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_check)


def _add_simulate(actions: Any) -> None:
    parser = actions.add_parser(
        "simulate", help="fly the missions by reservation, as point masses over a bad network"
    )
    parser.add_argument("fleet", type=Path, metavar="FLEET", help="fleet file, YAML")
    parser.add_argument(
        "--episodes", type=count, default=100, metavar="N", help="how many; default: 100"
    )
    _add_network(parser)
    parser.add_argument(
        "--restarts",
        type=positive,
        default=120.0,
        metavar="S",
        help="mean time between restarts of a daemon in flight; default: 120",
    )
    parser.add_argument(
        "--ahead",
        type=positive,
        default=40.0,
        metavar="M",
        help="how much of its way a vehicle asks for at a time; default: 40",
    )
    parser.add_argument(
        "--duration", type=positive, default=240.0, metavar="S", help="of an episode; default: 240"
    )
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_simulate)


def _add_fly(actions: Any) -> None:
    parser = actions.add_parser(
        "fly", help="fly the missions by the whole service, in virtual time over a bad network"
    )
    parser.add_argument("fleet", type=Path, metavar="FLEET", help="fleet file, YAML")
    parser.add_argument(
        "--episodes",
        type=count,
        default=1,
        metavar="N",
        help="how many flights; only a single one leaves logs; default: 1",
    )
    _add_network(parser)
    parser.add_argument(
        "--restarts",
        type=positive,
        default=120.0,
        metavar="S",
        help="mean time until a daemon dies and is started again; default: 120",
    )
    parser.add_argument(
        "--duration", type=positive, default=300.0, metavar="S", help="at most; default: 300"
    )
    parser.add_argument(
        "--jobs", type=count, metavar="J", help="processes for several flights; default: all cores"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="DIR", help="default: flights/<fleet>-<seed>"
    )
    parser.set_defaults(run=_fly)


def _add_network(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed", type=natural, default=1, metavar="S", help="of the first episode; default: 1"
    )
    parser.add_argument(
        "--loss", type=_share, default=0.3, metavar="SHARE", help="of all messages; default: 0.3"
    )
    parser.add_argument(
        "--delay", type=positive, default=8.0, metavar="S", help="of a late message; default: 8"
    )
    parser.add_argument(
        "--partitions",
        type=_share,
        default=0.25,
        metavar="SHARE",
        help="of the time in which the network is in two parts; default: 0.25",
    )


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a share from 0 to below 1")
    return value


def _simulate(options: argparse.Namespace) -> int:
    from gcs_tools.fleet.episode import EpisodeTerms  # noqa: PLC0415  loads NumPy
    from gcs_tools.fleet.network import NetworkTerms  # noqa: PLC0415  likewise
    from gcs_tools.fleet.simulate import SimulateRequest, simulate_fleet  # noqa: PLC0415  loads rich

    network = NetworkTerms(options.loss, options.delay, options.partitions)
    terms = EpisodeTerms(options.duration, options.restarts, network=network)
    request = SimulateRequest(options.fleet, options.episodes, options.seed, terms, options.ahead)
    good = simulate_fleet(request, form=options.form, output=options.output)
    return 0 if good else EXIT_NO


def _fly(options: argparse.Namespace) -> int:
    from gcs_tools.fleet.flight import FlightTerms  # noqa: PLC0415  loads the simulator
    from gcs_tools.fleet.fly import FlyRequest, fly_fleet_file  # noqa: PLC0415  loads rich, too
    from gcs_tools.fleet.network import NetworkTerms  # noqa: PLC0415  loads no simulator, but late

    network = NetworkTerms(options.loss, options.delay, options.partitions)
    terms = FlightTerms(network, options.restarts, options.duration)
    processes = options.jobs or os.cpu_count() or 1
    request = FlyRequest(
        options.fleet, options.episodes, options.seed, terms, processes, options.out
    )
    return 0 if fly_fleet_file(request) else EXIT_NO


def _check(options: argparse.Namespace) -> int:
    from gcs_tools.fleet.check import check_fleet  # noqa: PLC0415  loads rich, Shapely, SciPy

    holds = check_fleet(options.fleet, form=options.form, output=options.output)
    return 0 if holds else EXIT_NO
