"""``clearway``: the operator's command line.  Parses arguments; each command has its own file."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gcs_tools.console.argument_types import count, natural, port, positive
from gcs_tools.console.errors import CommandError
from gcs_tools.console.standard_output import with_output
from onboard.files.yaml_file import FileError

_REFUSED = 1
_BAD_INPUT = 2


class _Parser(argparse.ArgumentParser):
    """argparse says what is wrong on one line, as every other error does."""

    def error(self, message: str) -> None:  # type: ignore[override]  # it does not return either
        self.exit(_BAD_INPUT, f"clearway: error: {message} (see {self.prog} --help)\n")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return its exit code."""
    try:
        return with_output(lambda: _run(arguments))
    except FileError as error:
        return _fail(str(error))
    except CommandError as error:
        return _fail(str(error), error.exit_code)
    except ModuleNotFoundError as error:
        if error.name in {"rich", "matplotlib", "pyulog", "pyarrow", "distributed"}:
            return _fail(f"{error.name} is not installed: pip install 'clearway[ground]'")
        raise
    except KeyboardInterrupt:
        return _fail("interrupted", 128 + 2)


def _run(arguments: list[str] | None) -> int:
    options = build_parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    return command(options)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = _Parser(prog="clearway", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_fly(commands)
    _add_preflight(commands)
    _add_contract(commands)
    _add_report(commands)
    _add_watch(commands)
    _add_identify(commands)
    _add_campaign(commands)
    _add_schema(commands)
    return parser


def _add_fly(commands: Any) -> None:
    parser = commands.add_parser("fly", help="fly a scenario against the bundled simulation")
    parser.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO")
    parser.add_argument("--virtual", action="store_true", help="in virtual time, in one process")
    parser.add_argument("--seed", type=natural, default=1, metavar="N")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: flights/<scenario>-<seed>"
    )
    parser.add_argument(
        "--force", action="store_true", help="fly what the pre-flight check refuses"
    )
    parser.set_defaults(command=_fly)


def _add_preflight(commands: Any) -> None:
    parser = commands.add_parser(
        "preflight", help="may this be flown? exit code 0 yes, 1 no, 2 unknown"
    )
    _add_contract_options(parser)
    parser.add_argument("--field", type=Path, metavar="F", help="obstacle field, YAML or CSV")
    parser.add_argument("--mission", type=Path, metavar="F")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw the field: PNG, SVG, PDF"
    )
    parser.add_argument("--vehicle", metavar="URL", help="MAVSDK connection URL of a live vehicle")
    parser.add_argument(
        "--zenoh-config", type=Path, metavar="F", help="live detections and daemon: how to join"
    )
    parser.add_argument(
        "--system-id", type=natural, metavar="N", help="of the vehicle, if several are heard"
    )
    parser.add_argument("--endurance", type=positive, metavar="S", help="hover time, battery full")
    parser.add_argument(
        "--authorise", type=positive, metavar="S", help="then answer arm requests by the verdict"
    )
    _add_output_options(parser, "table", "json")
    parser.set_defaults(command=_preflight)


def _add_contract(commands: Any) -> None:
    parser = commands.add_parser("contract", help="what follows from a contract")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    show = actions.add_parser("show", help="clauses with margins, derived quantities")
    _add_contract_options(show)
    _add_output_options(show, "table", "json", "csv")
    show.set_defaults(command=_contract_show)
    _add_contract_solve(actions)
    _add_contract_surface(actions)


def _add_contract_solve(actions: Any) -> None:
    parser = actions.add_parser("solve", help="largest or smallest value of a key that complies")
    _add_contract_options(parser)
    parser.add_argument(
        "--for", dest="key", required=True, metavar="KEY", help="vehicle.cruise_speed_mps, ..."
    )
    _add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(command=_contract_solve)


def _add_contract_surface(actions: Any) -> None:
    parser = actions.add_parser("surface", help="a requirement over two keys: Fig. 11, 12, 13, any")
    _add_contract_options(parser)
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
        help="the paper's point mass (default of a figure), or all errors (default otherwise)",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it: PNG, SVG or PDF")
    _add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(command=_contract_surface)


def _add_report(commands: Any) -> None:
    parser = commands.add_parser("report", help="a flight log as one HTML file; two are compared")
    parser.add_argument("log", type=Path, metavar="LOG", help="flight.mcap, or its directory")
    parser.add_argument("other", type=Path, nargs="?", metavar="LOG", help="laid over the first")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: report.html beside the log"
    )
    parser.set_defaults(command=_report)


def _add_watch(commands: Any) -> None:
    parser = commands.add_parser("watch", help="a flight as it happens, on a local page; read-only")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--zenoh-config", type=Path, metavar="F", help="how to join; default: scout")
    where.add_argument(
        "--daemon-config", type=Path, metavar="F", help="the onboard.yaml it runs on"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to serve on (loopback)")
    parser.add_argument("--port", type=port, default=8640, help="0: any that is free")
    parser.add_argument("--tui", action="store_true", help="in this terminal instead")
    parser.set_defaults(command=_watch)


def _add_identify(commands: Any) -> None:
    parser = commands.add_parser("identify", help="contract values measured from flight logs")
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="file or directory")
    parser.add_argument("--system-id", type=count, metavar="N", help="vehicle of a tlog")
    parser.add_argument("--margin", type=positive, default=0.25, metavar="SHARE", help="0.25")
    _add_output_options(parser, "table", "json", "csv")
    parser.set_defaults(command=_identify)


def _add_campaign(commands: Any) -> None:
    parser = commands.add_parser("campaign", help="many seeded flights in virtual time")
    parser.add_argument(
        "scenarios",
        nargs="+",
        metavar="SCENARIO",
        help="nominal, violating, faults, outside, competition, quick, quick-faults; scenario "
        "files; stem maps (CSV)",
    )
    parser.add_argument("--flights", type=natural, default=100, metavar="N")
    parser.add_argument("--seed", type=natural, default=1, metavar="S")
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
    parser.set_defaults(command=_campaign)


def _add_schema(commands: Any) -> None:
    parser = commands.add_parser("schema", help="write JSON Schemas of all files, for editors")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.set_defaults(command=_schema)


def _add_contract_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--contract", type=Path, required=True, metavar="F")
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


def _add_output_options(parser: argparse.ArgumentParser, *forms: str) -> None:
    parser.add_argument("--format", dest="form", choices=forms, default=forms[0])
    parser.add_argument("-o", "--output", type=Path, metavar="FILE")


# Each command's module is imported when it is asked for: a daemon's computer that runs
# `clearway preflight` needs neither matplotlib nor the simulation.


def _fly(options: argparse.Namespace) -> int:
    from gcs_tools.fly.command import fly  # noqa: PLC0415

    succeeded = fly(
        options.scenario,
        virtual=options.virtual,
        seed=options.seed,
        out=options.out,
        force=options.force,
    )
    return 0 if succeeded else _REFUSED


def _preflight(options: argparse.Namespace) -> int:
    from gcs_tools.preflight.command import PreflightFiles, run_preflight  # noqa: PLC0415

    verdict = run_preflight(
        PreflightFiles(
            contract=options.contract,
            field=options.field,
            mission=options.mission,
            overrides=tuple(options.overrides),
            picture=options.picture,
        ),
        vehicle_url=options.vehicle,
        system_id=options.system_id,
        zenoh_config=options.zenoh_config,
        endurance_s=options.endurance,
        authorise_s=options.authorise,
        input_set=options.input_set,
        form=options.form,
        output=options.output,
    )
    return {"holds": 0, "broken": _REFUSED}.get(verdict.value, _BAD_INPUT)


def _contract_show(options: argparse.Namespace) -> int:
    from gcs_tools.contract.show import show_contract  # noqa: PLC0415

    show_contract(
        options.contract,
        overrides=tuple(options.overrides),
        input_set=options.input_set,
        form=options.form,
        output=options.output,
    )
    return 0


def _contract_solve(options: argparse.Namespace) -> int:
    from gcs_tools.contract.solve import solve_contract  # noqa: PLC0415

    solve_contract(
        options.contract,
        key=options.key,
        overrides=tuple(options.overrides),
        input_set=options.input_set,
        form=options.form,
        output=options.output,
    )
    return 0


def _contract_surface(options: argparse.Namespace) -> int:
    from gcs_tools.contract.surface import SurfaceRequest, write_surface  # noqa: PLC0415

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


def _report(options: argparse.Namespace) -> int:
    from gcs_tools.flight_report.command import run_report  # noqa: PLC0415

    logs = [options.log] if options.other is None else [options.log, options.other]
    run_report(logs, options.output)
    return 0


def _watch(options: argparse.Namespace) -> int:
    from gcs_tools.watch.command import bus_of, watch  # noqa: PLC0415

    bus = bus_of(options.zenoh_config, options.daemon_config)
    watch(bus, host=options.host, port=options.port, terminal=options.tui)
    return 0


def _identify(options: argparse.Namespace) -> int:
    from gcs_tools.identify.command import identify  # noqa: PLC0415

    paths, number = options.logs, options.system_id
    identify(paths, number, margin=options.margin, form=options.form, output=options.output)
    return 0


def _campaign(options: argparse.Namespace) -> int:
    from gcs_tools.campaign.command import CampaignRequest, run_campaign  # noqa: PLC0415

    request = CampaignRequest(
        scenarios=tuple(options.scenarios),
        flights=options.flights,
        seed=options.seed,
        only=options.only,
        jobs=options.jobs,
        dask=options.dask,
        out=options.out,
        shrink=options.shrink,
    )
    return 0 if run_campaign(request) else _REFUSED


def _schema(options: argparse.Namespace) -> int:
    from gcs_tools.schemas import write_schemas  # noqa: PLC0415

    write_schemas(options.output)
    return 0


def _fail(message: str, code: int = _BAD_INPUT) -> int:
    with contextlib.suppress(OSError):  # the exit code is heard all the same
        sys.stderr.write(f"clearway: error: {message}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
