"""Key files that are named on the command line."""

from __future__ import annotations

from pathlib import Path

from gcs_tools.console.errors import CommandError
from onboard.authentication.key_file import load_key


def operator_key(path: Path | None) -> bytes | None:
    """Return the operator's key; None where none is named.

    Raises:
        FileError: the file cannot be used.
    """
    return None if path is None else load_key(path)


def mavlink_key(path: Path | None, vehicle_url: str | None) -> bytes | None:
    """Return the key of a vehicle that signs; None where none is named.

    Args:
        path: of the key file.
        vehicle_url: that it is for.

    Raises:
        FileError: the file cannot be used.
        CommandError: there is no vehicle whose messages it would sign.
    """
    if path is None:
        return None
    if vehicle_url is None:
        raise CommandError("--mavlink-key needs --vehicle: it signs what is sent to one")
    return load_key(path)
