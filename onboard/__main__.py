"""`clearway-onboard --config F`: arguments -> configuration -> daemon."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import sys
import time
from importlib.metadata import version
from pathlib import Path

import zenoh

from onboard import daemon
from onboard.authentication.key_file import load_key
from onboard.authentication.keys import DaemonKeys
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import (
    DaemonConfig,
    load_daemon_config,
    log_directory,
    state_directory,
)
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, load_yaml
from onboard.fleet.membership import FleetMembership, FlownFiles, read_membership
from onboard.heap import return_freed_arrays
from onboard.log_format import configure_logging
from onboard.mavlink.link_url import LinkError
from onboard.metrics.server import MetricsError
from onboard.perception.movers.permitted_sources import check_permitted
from onboard.recording.directory_quota import MEGABYTE, DirectoryQuota
from onboard.recording.recorder import LogFileError, LogPlace


def main(arguments: list[str] | None = None) -> int:
    """Run the daemon; return the exit code: 0 after SIGINT or SIGTERM, 2 on bad input."""
    parser = argparse.ArgumentParser(prog="clearway-onboard", description=daemon.__doc__)
    parser.add_argument("--config", type=Path, required=True, help="daemon configuration, YAML")
    parser.add_argument(
        "--log-format", choices=("text", "json"), help="of messages; default: the file's log_format"
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {version('clearway')}")
    options = parser.parse_args(arguments)
    try:
        config = load_daemon_config(options.config)
        base = options.config.parent
        config = config.model_copy(update={"zenoh": config.zenoh.relative_to(base)})
        contract = load_yaml(base / config.contract, Contract)
        check_permitted(config.sources, contract, str(options.config))
        mission = None
        if not config.mission_from_vehicle:
            mission = load_yaml(base / config.mission, Mission)
        geofence = load_yaml(base / config.geofence, Geofence) if config.geofence else None
        configure_logging(config.log_level, options.log_format or config.log_format)
        _warn_if_not_compliant(contract, mission, config)
        state = state_directory(base, os.environ)
        keys = DaemonKeys.load(config, base, state, time.time())
        fleet = _membership(config, base, FlownFiles(contract, mission, geofence))
        place = _log_place(base, config)
        return_freed_arrays()
        asyncio.run(daemon.run(config, contract, mission, place, keys, geofence, state, fleet))
    except (FileError, LinkError, LogFileError, MetricsError) as error:
        return _refuse(str(error))
    except zenoh.ZError as error:
        return _refuse(f"{options.config}: no Zenoh session: {error}")
    return 0


def _membership(config: DaemonConfig, base: Path, flown: FlownFiles) -> FleetMembership | None:
    """Read the fleet that the vehicle flies in; None if it is of none.

    Raises:
        FileError: a file of it cannot be used, or the vehicle is not what it says.
    """
    stated = config.fleet
    if stated is None:
        return None
    key = None if stated.key_file is None else load_key(base / stated.key_file)
    return read_membership(base / stated.file, stated.name, flown, key)


def _warn_if_not_compliant(
    contract: Contract, mission: Mission | None, config: DaemonConfig
) -> None:
    altitude_m = None if mission is None else mission.altitude_m
    assessment = assess(contract, config.input_set, mission_altitude_m=altitude_m)
    broken = [c.name for c in assessment.clauses if not c.holds]
    if broken:
        logging.getLogger(__name__).warning("the contract does not comply: %s", ", ".join(broken))


def _log_place(base: Path, config: DaemonConfig) -> LogPlace:
    if config.log_file is not None:
        return LogPlace(base / config.log_file)
    directory = log_directory(base, config, os.environ)
    quota_mb = config.log_quota_mb
    quota = None if quota_mb is None else DirectoryQuota(directory, quota_mb * MEGABYTE)

    def next_path() -> Path:
        return directory / time.strftime("flight-%Y%m%d-%H%M%S.mcap", time.gmtime())

    return LogPlace(next_path(), next_path, quota)


def _refuse(message: str) -> int:
    sys.stderr.write(f"clearway-onboard: error: {message}\n")
    return 2


if __name__ == "__main__":
    sys.exit(main())
