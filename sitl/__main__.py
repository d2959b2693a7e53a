"""``clearway-sitl --config F``: the simulated vehicle, live."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
from importlib.metadata import version
from pathlib import Path

from onboard.files.yaml_file import FileError
from sitl.autopilot.flavours.parameters import ParameterError
from sitl.config import load_sitl_config
from sitl.live.service import ZenohError, serve
from sitl.live.transport import TransportError


def main(arguments: list[str] | None = None) -> int:
    """Run until interrupted; 0 after a clean stop, 2 if it could not start."""
    parser = argparse.ArgumentParser(prog="clearway-sitl", description="A simulated vehicle.")
    parser.add_argument("--config", type=Path, required=True, metavar="F", help="YAML file")
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('clearway')}")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    try:
        asyncio.run(serve(load_sitl_config(options.config)))
    except (FileError, ParameterError, TransportError, ZenohError, OSError) as error:
        sys.stderr.write(f"clearway-sitl: error: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
