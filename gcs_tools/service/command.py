"""``clearway service install``: writes the systemd unit of the daemon."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from gcs_tools.console.errors import CommandError
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import load_daemon_config
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml

UNIT: Final = "clearway.service"
TEMPLATE: Final = Path(__file__).parent / UNIT
# Exists where systemd has started the system.
SYSTEMD_RUNS: Final = Path("/run/systemd/system")
_USER: Final = re.compile(r"[a-z_][a-z0-9_-]{0,31}")
_STEPS: Final = "next: sudo systemctl enable --now clearway; then: journalctl -u clearway -f"


def install(config: Path, *, user: str, unit_directory: Path, dry_run: bool) -> None:
    """Write the unit, and have systemd read it.

    Args:
        config: the daemon's configuration; it and the files that it names must be usable.
        user: that runs the daemon; it must exist.
        unit_directory: of systemd.
        dry_run: print the unit to standard output instead.

    Raises:
        FileError: a file of the daemon cannot be used.
        CommandError: the user does not exist, or the unit cannot be written or read.
    """
    if not _USER.fullmatch(user):
        raise CommandError(f"--user {user[:40]!r}: expected a user name, such as clearway")
    path = config.absolute()
    text = unit_text(path, user)
    if dry_run:
        sys.stdout.write(text)
        return
    written = load_daemon_config(path)
    load_yaml(path.parent / written.contract, Contract)
    if not written.mission_from_vehicle:
        load_yaml(path.parent / written.mission, Mission)
    _require_user(user)
    unit = unit_directory / UNIT
    try:
        unit.write_text(text, encoding="utf-8")
    except OSError as error:
        root = "" if os.geteuid() == 0 else "; run it with sudo"
        raise CommandError(f"{unit}: cannot be written: {error.strerror or error}{root}") from error
    sys.stdout.write(f"{unit}: written\n")
    _reload()
    sys.stdout.write(f"{_STEPS}\n")


def unit_text(config: Path, user: str) -> str:
    """Return the unit that runs this installation's daemon.

    Raises:
        CommandError: a path has a character that systemd would read otherwise.
    """
    program = Path(sys.executable).parent / "clearway-onboard"
    if not program.is_file():
        found = shutil.which("clearway-onboard")
        if found is None:
            raise CommandError(f"{program}: not found; install Clearway with pip first")
        program = Path(found)
    text = TEMPLATE.read_text(encoding="utf-8")
    for name, path in (("PROGRAM", program), ("CONFIG", config)):
        text = text.replace(f"@{name}@", _quoted(path))
    return text.replace("@USER@", user)


def _quoted(path: Path) -> str:
    """Return a path for a double-quoted word of ExecStart (systemd.service, "Command lines")."""
    text = str(path)
    if not text.isprintable():
        raise CommandError(f"{text!r:.80}: a path with control characters cannot be in a unit")
    return text.replace("%", "%%").replace("\\", "\\\\").replace('"', '\\"').replace("$", "$$")


def _require_user(user: str) -> None:
    try:
        pwd.getpwnam(user)
    except KeyError as error:
        raise CommandError(
            f"user {user!r} does not exist: sudo useradd --system --groups dialout {user}"
        ) from error


def _reload() -> None:
    """Have systemd read its units again, where it runs."""
    systemctl = shutil.which("systemctl")
    if systemctl is None or not SYSTEMD_RUNS.is_dir():
        sys.stdout.write("systemd does not run here: nothing was reloaded\n")
        return
    command = [systemctl, "daemon-reload"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  its own path
    if done.returncode != 0:
        reason = " ".join(done.stderr.split()) or f"exit code {done.returncode}"
        raise CommandError(f"systemctl daemon-reload failed: {reason}")
