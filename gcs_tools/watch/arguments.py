"""Arguments of ``clearway watch``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs_tools.console.arguments import port


def add_parser(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    parser = commands.add_parser("watch", help="show a flight live on a local page; read-only")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--zenoh-config", type=Path, metavar="F", help="how to reach the daemon; default: scout"
    )
    where.add_argument(
        "--daemon-config", type=Path, metavar="F", help="the daemon's own onboard.yaml"
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve on; default: loopback"
    )
    parser.add_argument(
        "--port", type=port, default=8640, help="default: 8640; 0 for any free port"
    )
    parser.add_argument("--tui", action="store_true", help="in this terminal instead of a page")
    parser.add_argument(
        "--foxglove",
        type=port,
        nargs="?",
        const=8765,
        metavar="PORT",
        help="also as a WebSocket for Foxglove and Lichtblick; default: 8765; 0 for any free port",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from gcs_tools.preflight.live.bus import bus_of  # noqa: PLC0415  loads Zenoh
    from gcs_tools.watch.command import watch  # noqa: PLC0415  loads Zenoh

    bus = bus_of(options.zenoh_config, options.daemon_config)
    watch(
        bus,
        host=options.host,
        port=options.port,
        terminal=options.tui,
        foxglove_port=options.foxglove,
    )
    return 0
