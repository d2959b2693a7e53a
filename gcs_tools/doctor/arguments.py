"""Arguments of ``clearway status`` and ``clearway doctor``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import add_mavlink_key, natural, positive


def add_parser(commands: Any) -> None:
    """Add both commands to argparse's subparsers."""
    status = commands.add_parser(
        "status", help="what the daemon does; exit code 0 well, 1 not, 2 not heard"
    )
    _add_where(status)
    status.add_argument(
        "--wait",
        type=positive,
        default=0.0,
        metavar="S",
        help="ask again until all is well, for S seconds at most",
    )
    status.set_defaults(run=_run_status)
    doctor = commands.add_parser(
        "doctor",
        help="what is missing before it will fly, with cures; 0 nothing, 1 some, 2 unknown",
    )
    _add_where(doctor)
    doctor.add_argument(
        "--vehicle", metavar="URL", help="ask the vehicle, too: parameters, battery; MAVSDK URL"
    )
    doctor.add_argument(
        "--system-id", type=natural, metavar="N", help="of the vehicle, if several are heard"
    )
    add_mavlink_key(doctor)
    doctor.set_defaults(run=_run_doctor)


def _add_where(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--daemon-config", type=Path, metavar="F", help="the daemon's own onboard.yaml"
    )
    where.add_argument(
        "--zenoh-config", type=Path, metavar="F", help="how to reach the daemon; default: scout"
    )
    parser.add_argument(
        "--format",
        dest="form",
        choices=("text", "json"),
        default="text",
        help="text for people (default); json for programs",
    )


def _run_status(options: argparse.Namespace) -> int:
    from gcs_tools.doctor.command import status  # noqa: PLC0415  loads Zenoh

    return status(
        options.daemon_config, options.zenoh_config, form=options.form, wait_s=options.wait
    )


def _run_doctor(options: argparse.Namespace) -> int:
    from gcs_tools.doctor.command import doctor  # noqa: PLC0415  loads Zenoh

    return doctor(
        options.daemon_config,
        options.zenoh_config,
        vehicle_url=options.vehicle,
        system_id=options.system_id,
        mavlink_key_file=options.mavlink_key,
        form=options.form,
    )
