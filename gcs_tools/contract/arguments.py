"""Arguments of ``clearway contract``, and those of every command that reads a contract."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_output_options


def add_contract_options(parser: argparse.ArgumentParser) -> None:
    """Add the contract file, its overrides and the acceleration set."""
    parser.add_argument(
        "--contract", type=Path, required=True, metavar="F", help="contract file, YAML"
    )
    parser.add_argument(
        "--set",
        dest="overrides",
        action="extend",
        nargs="+",
        default=[],
        metavar="key=value",
        help="override a term, for instance vehicle.cruise_speed_mps=2.8",
    )
    parser.add_argument(
        "--input-set",
        choices=("inner", "paper"),
        default="inner",
        help="accelerations: sound inner box, or Eq. 7 as printed",
    )


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("contract", help="derive what a contract requires")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    _add_show(actions)
    _add_solve(actions)
    _add_surface(actions)


def _add_show(actions: Any) -> None:
    parser = actions.add_parser("show", help="clauses with margins, derived quantities")
    add_contract_options(parser)
    add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(run=_show)


def _add_solve(actions: Any) -> None:
    parser = actions.add_parser("solve", help="largest or smallest value of a key that complies")
    add_contract_options(parser)
    parser.add_argument(
        "--for", dest="key", required=True, metavar="KEY", help="vehicle.cruise_speed_mps, ..."
    )
    add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(run=_solve)


def _add_surface(actions: Any) -> None:
    parser = actions.add_parser("surface", help="a requirement over two keys: Fig. 11, 12, 13, any")
    add_contract_options(parser)
    parser.add_argument(
        "--figure", choices=("11", "12", "13"), help="axes and values of a figure of the paper"
    )
    for axis in ("x", "y"):
        parser.add_argument(
            f"--{axis}", metavar="KEY=LO:HI:N", help="KEY+KEY drives several keys together"
        )
    parser.add_argument("--z", metavar="QUANTITY", help="what to draw; default: the least margin")
    parser.add_argument(
        "--reading",
        choices=("nominal", "inflated"),
        help="the paper's point mass, or all errors of the contract (default)",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it: PNG, SVG or PDF")
    add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(run=_surface)


def _show(options: argparse.Namespace) -> int:
    from gcs_tools.contract.show import show_contract  # noqa: PLC0415  loads rich and NumPy

    show_contract(
        options.contract,
        overrides=tuple(options.overrides),
        input_set=options.input_set,
        form=options.form,
        output=options.output,
    )
    return 0


def _solve(options: argparse.Namespace) -> int:
    from gcs_tools.contract.solve import solve_contract  # noqa: PLC0415  loads rich and NumPy

    solve_contract(
        options.contract,
        key=options.key,
        overrides=tuple(options.overrides),
        input_set=options.input_set,
        form=options.form,
        output=options.output,
    )
    return 0


def _surface(options: argparse.Namespace) -> int:
    from gcs_tools.contract.surface import (  # noqa: PLC0415  loads rich and NumPy
        SurfaceRequest,
        write_surface,
    )

    request = SurfaceRequest(
        figure=options.figure,
        x=options.x,
        y=options.y,
        quantity=options.z,
        reading=options.reading,
    )
    write_surface(
        options.contract,
        request,
        overrides=tuple(options.overrides),
        input_set=options.input_set,
        form=options.form,
        output=options.output,
        plot=options.plot,
    )
    return 0
