"""Arguments of ``clearway identify``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_output_options, count, positive


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser(
        "identify", help="measure contract values in flight logs, or in a flight made for it"
    )
    parser.add_argument("logs", type=Path, nargs="*", metavar="LOG", help="file or directory")
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
    flight = parser.add_argument_group(
        "a flight for it", "swerves and stops in free air, flown in the daemon's place"
    )
    flight.add_argument("--fly", action="store_true", help="fly, and measure the flight's log")
    flight.add_argument(
        "--daemon-config",
        type=Path,
        metavar="F",
        help="onboard.yaml: link, keys, contract, geofence; default: onboard.yaml",
    )
    flight.add_argument(
        "--free-air",
        type=_free_air,
        metavar="LENGTHxWIDTH",
        help="metres ahead of the nose and across that the operator vouches for",
    )
    flight.add_argument(
        "--speed", type=positive, metavar="MPS", help="of the passes; default: the contract's"
    )
    flight.add_argument(
        "--run-on", action="store_true", help="let the stream of setpoints end in the last pass"
    )
    flight.add_argument(
        "--vouch", action="store_true", help="vouch for the free air here, without being asked"
    )
    flight.add_argument("--log", type=Path, metavar="FILE", help="of the flight, MCAP")
    parser.set_defaults(run=lambda options: _run(options, parser))


def _free_air(text: str) -> Any:
    from gcs_tools.identify.flight.free_air import free_air  # noqa: PLC0415  loads NumPy

    return free_air(text)


def _run(options: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    if options.fly:
        return _run_flight(options, parser)
    stated = [
        name
        for name in ("daemon_config", "free_air", "speed", "run_on", "vouch", "log")
        if getattr(options, name)
    ]
    if stated:
        parser.error(f"--{stated[0].replace('_', '-')} needs --fly: it is of a flight")
    if not options.logs:
        parser.error("expected LOG, a flight log or a directory of them, or --fly")
    from gcs_tools.identify.command import identify  # noqa: PLC0415  loads NumPy and pymavlink

    identify(
        options.logs,
        options.system_id,
        margin=options.margin,
        form=options.form,
        output=options.output,
    )
    return 0


def _run_flight(options: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    if options.logs:
        parser.error(f"--fly measures its own log: leave out {options.logs[0]}")
    if options.free_air is None:
        parser.error(
            "--fly needs --free-air LENGTHxWIDTH: metres ahead of the nose and across, such as "
            "60x20, that are free of obstacles and people"
        )
    from gcs_tools.identify.flight.command import (  # noqa: PLC0415  loads NumPy and pymavlink
        FlightRequest,
        fly_and_identify,
    )

    request = FlightRequest(
        daemon=options.daemon_config or Path("onboard.yaml"),
        air=options.free_air,
        speed_mps=options.speed,
        run_on=options.run_on,
        vouched=options.vouch,
        log=options.log,
    )
    return fly_and_identify(request, options.margin)
