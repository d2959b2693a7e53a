"""Arguments of ``clearway replay``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import positive
from gcs_tools.console.errors import EXIT_NO


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser(
        "replay",
        help="what the daemon sees of a ROS 2 bag or MCAP; exit code 0 every sensor, 1 not all",
    )
    parser.add_argument(
        "recording", type=Path, metavar="FILE", help="ROS 2 bag (folder, .db3) or .mcap"
    )
    parser.add_argument(
        "--daemon-config",
        type=Path,
        metavar="F",
        help="onboard.yaml whose sources and contract count; default: every topic that can be read",
    )
    _add_meaning(parser)
    parser.add_argument(
        "--format",
        dest="form",
        choices=("text", "json"),
        default="text",
        help="text for people (default); json for programs",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="a flight log (.mcap), or the obstacles as a field (.yaml, .csv)",
    )
    parser.set_defaults(run=_run)


def _add_meaning(parser: argparse.ArgumentParser) -> None:
    """Add what the recording does not say by itself."""
    parser.add_argument(
        "--range",
        dest="range_m",
        type=positive,
        default=10.0,
        metavar="M",
        help="range of the sensors where no file states it; default: 10",
    )
    parser.add_argument(
        "--pose",
        metavar="TOPIC",
        help="Odometry, PoseStamped or TFMessage; `none`: at rest; default: the first of them",
    )
    parser.add_argument(
        "--align-clock",
        action="store_true",
        help="take the first stamp for the time of its arrival, as for stamps of a simulation",
    )


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.replay.command import ReplayRequest, replay  # noqa: PLC0415  loads NumPy

    request = ReplayRequest(
        recording=options.recording,
        daemon_config=options.daemon_config,
        range_m=options.range_m,
        pose_topic=options.pose,
        align_clock=options.align_clock,
        output=options.output,
    )
    return 0 if replay(request, form=options.form) else EXIT_NO
