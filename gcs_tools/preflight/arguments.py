"""Arguments of ``clearway preflight``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import (
    RenamedOption,
    add_mavlink_key,
    add_operator_key,
    add_output_options,
    natural,
    positive,
)
from gcs_tools.console.errors import EXIT_BAD_INPUT, EXIT_NO
from gcs_tools.contract.arguments import add_contract_options


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser(
        "preflight", help="may this be flown? exit code 0 yes, 1 no, 2 unknown"
    )
    add_contract_options(parser)
    parser.add_argument("--field", type=Path, metavar="F", help="obstacle field, YAML or CSV")
    parser.add_argument("--mission", type=Path, metavar="F", help="mission file, YAML")
    parser.add_argument(
        "--geofence", type=Path, metavar="F", help="geofence file, YAML, that the mission keeps to"
    )
    parser.add_argument(
        "--fleet", type=Path, metavar="F", help="fleet file, YAML, of this vehicle and others"
    )
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw the field: PNG, SVG, PDF"
    )
    parser.add_argument(
        "--parameters", type=Path, metavar="F", help="saved parameters, .params or .param"
    )
    parser.add_argument(
        "--daemon-config", type=Path, metavar="F", help="onboard.yaml, whose sensors are checked"
    )
    parser.add_argument("--vehicle", metavar="URL", help="MAVSDK connection URL of a live vehicle")
    parser.add_argument(
        "--zenoh-config", type=Path, metavar="F", help="how to reach live detections and the daemon"
    )
    parser.add_argument(
        "--system-id", type=natural, metavar="N", help="of the vehicle, if several are heard"
    )
    parser.add_argument("--endurance", type=positive, metavar="S", help="hover time, battery full")
    parser.add_argument(
        "--authorize",
        type=positive,
        metavar="S",
        help="then answer the vehicle's arm requests with the verdict for S seconds",
    )
    parser.add_argument("--authorise", action=RenamedOption, const="--authorize")
    add_mavlink_key(parser)
    add_operator_key(parser)
    add_acceptance(parser)
    add_output_options(parser, "table", "json")
    parser.set_defaults(run=_run)


def add_acceptance(parser: argparse.ArgumentParser) -> None:
    """Add the option to accept for one run that arrival is not guaranteed."""
    parser.add_argument(
        "--accept-no-progress",
        action="store_true",
        help="accept that arrival is not guaranteed; requirements.progress: best_effort, once",
    )


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.preflight.command import run_preflight  # noqa: PLC0415  loads rich, NumPy, SciPy
    from gcs_tools.preflight.files import PreflightFiles  # noqa: PLC0415  loads pydantic

    verdict = run_preflight(
        PreflightFiles(
            contract=options.contract,
            field=options.field,
            mission=options.mission,
            overrides=tuple(options.overrides),
            picture=options.picture,
            geofence=options.geofence,
            parameters=options.parameters,
            daemon=options.daemon_config,
            fleet=options.fleet,
        ),
        vehicle_url=options.vehicle,
        system_id=options.system_id,
        zenoh_config=options.zenoh_config,
        endurance_s=options.endurance,
        authorize_s=options.authorize,
        input_set=options.input_set,
        accept_no_progress=options.accept_no_progress,
        mavlink_key_file=options.mavlink_key,
        operator_key_file=options.operator_key,
        form=options.form,
        output=options.output,
    )
    return {"holds": 0, "broken": EXIT_NO}.get(verdict.value, EXIT_BAD_INPUT)
