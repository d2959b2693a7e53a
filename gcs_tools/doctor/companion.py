"""What can be seen from the daemon's own files, on its own computer."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gcs_tools.doctor.diagnosis import Diagnosis, contract_diagnosis
from gcs_tools.preflight.finding import Verdict
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig, load_daemon_config, log_directory
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml

# An hour of flight takes a few hundred megabytes.
FREE_MIN_BYTES: Final = 1_000_000_000
_SERIAL: Final = "serial://"


@dataclass(frozen=True)
class DaemonFiles:
    """The daemon's configuration and what it names.

    Attributes:
        path: of the configuration.
        config: its content.
        contract, mission: of the files that it names; no mission where the vehicle has it.
    """

    path: Path
    config: DaemonConfig
    contract: Contract
    mission: Mission | None


def load_daemon_files(path: Path) -> DaemonFiles:
    """Read the daemon's configuration and what it names.

    Raises:
        FileError: one of the files cannot be used.
    """
    config = load_daemon_config(path)
    contract = load_yaml(path.parent / config.contract, Contract)
    mission = None
    if not config.mission_from_vehicle:
        mission = load_yaml(path.parent / config.mission, Mission)
    return DaemonFiles(path, config, contract, mission)


def diagnose_files(files: DaemonFiles) -> Iterator[Diagnosis]:
    """Yield what the daemon's files and this computer say."""
    altitude_m = None if files.mission is None else files.mission.altitude_m
    yield contract_diagnosis(files.contract, altitude_m)
    yield from _serial_device(files.config.mavlink.url)
    yield _disk(files)


def _serial_device(url: str) -> Iterator[Diagnosis]:
    if not url.startswith(_SERIAL):
        return
    device = Path(url.removeprefix(_SERIAL).rpartition(":")[0] or url.removeprefix(_SERIAL))
    name = "serial port"
    if not device.exists():
        cure = "plug the autopilot in, or correct mavlink.url; ls /dev/tty* lists what is there"
        yield Diagnosis(name, Verdict.BROKEN, f"{device} does not exist", cure)
    elif not os.access(device, os.R_OK | os.W_OK):
        cure = "sudo usermod --append --groups dialout NAME, then log in again"
        yield Diagnosis(name, Verdict.BROKEN, f"{device} may not be opened by this user", cure)
    else:
        yield Diagnosis(name, Verdict.HOLDS, f"{device} can be opened")


def _disk(files: DaemonFiles) -> Diagnosis:
    directory = log_directory(files.path.parent, files.config, os.environ)
    # The daemon makes the directory: what counts is where it will be.
    place = next(each for each in (directory, *directory.absolute().parents) if each.exists())
    free_bytes = shutil.disk_usage(place).free
    text = f"{free_bytes / 1e9:.1f} GB free for {directory}"
    if free_bytes >= FREE_MIN_BYTES:
        return Diagnosis("disk", Verdict.HOLDS, text)
    cure = "free the disk, or set log_directory and log_quota_mb in the daemon's file"
    return Diagnosis("disk", Verdict.BROKEN, f"{text}, expected 1 GB", cure)
