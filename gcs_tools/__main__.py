"""``clearway``: the operator's command line.

Lists the commands.  Each brings its own arguments (``arguments.py`` of its room) and loads its code
only when it runs, so that ``--help`` and ``--version`` answer at once and a companion computer that
runs ``clearway preflight`` needs neither matplotlib nor the simulation.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Callable
from typing import Final

from gcs_tools import schema_arguments
from gcs_tools.benchmark import arguments as benchmark_arguments
from gcs_tools.campaign import arguments as campaign_arguments
from gcs_tools.console.arguments import VersionOption
from gcs_tools.console.errors import EXIT_BAD_INPUT, CommandError
from gcs_tools.console.standard_output import with_output
from gcs_tools.contract import arguments as contract_arguments
from gcs_tools.doctor import arguments as doctor_arguments
from gcs_tools.export import arguments as export_arguments
from gcs_tools.fleet import arguments as fleet_arguments
from gcs_tools.flight_report import arguments as report_arguments
from gcs_tools.fly import arguments as fly_arguments
from gcs_tools.identify import arguments as identify_arguments
from gcs_tools.missions import arguments as mission_arguments
from gcs_tools.preflight import arguments as preflight_arguments
from gcs_tools.replay import arguments as replay_arguments
from gcs_tools.resume import arguments as resume_arguments
from gcs_tools.sensors import arguments as sensor_arguments
from gcs_tools.service import arguments as service_arguments
from gcs_tools.setup import arguments as init_arguments
from gcs_tools.watch import arguments as watch_arguments

# In the order of ``clearway --help``.
COMMANDS: Final = (
    init_arguments,
    fly_arguments,
    preflight_arguments,
    fleet_arguments,
    contract_arguments,
    mission_arguments,
    report_arguments,
    export_arguments,
    watch_arguments,
    resume_arguments,
    doctor_arguments,
    sensor_arguments,
    replay_arguments,
    identify_arguments,
    campaign_arguments,
    benchmark_arguments,
    service_arguments,
    schema_arguments,
)
# Import names of what the extra ``ground`` installs.
_GROUND: Final = frozenset(
    {
        "distributed",
        "foxglove",
        "jinja2",
        "markupsafe",
        "matplotlib",
        "mavsdk",
        "pyarrow",
        "pyulog",
        "shapely",
    }
)


class _Parser(argparse.ArgumentParser):
    """Reports a usage error on one line, as every other error is."""

    def error(self, message: str) -> None:  # type: ignore[override]  # it does not return either
        self.exit(EXIT_BAD_INPUT, f"clearway: error: {message} (see {self.prog} --help)\n")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return its exit code."""
    try:
        return with_output(lambda: _run(arguments))
    except CommandError as error:
        return _fail(str(error), error.exit_code)
    except ModuleNotFoundError as error:
        if error.name in _GROUND:
            return _fail(f"{error.name} is not installed: pip install 'clearway[ground]'")
        raise
    except KeyboardInterrupt:
        return _fail("interrupted", 128 + signal.SIGINT)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = _Parser(prog="clearway", description="Clearway: the operator's command line.")
    parser.add_argument("--version", action=VersionOption)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for each in COMMANDS:
        each.add_parser(commands)
    return parser


def _run(arguments: list[str] | None) -> int:
    options = build_parser().parse_args(arguments)
    # pydantic takes longer to load than --help and --version take in all.
    from onboard.files.yaml_file import FileError  # noqa: PLC0415

    run: Callable[[argparse.Namespace], int] = options.run
    try:
        return run(options)
    except FileError as error:
        raise CommandError(str(error)) from error


def _fail(message: str, code: int = EXIT_BAD_INPUT) -> int:
    with contextlib.suppress(OSError):  # standard error may be closed; the exit code remains
        sys.stderr.write(f"clearway: error: {message}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
