"""What a pre-flight check reads and connects to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from gcs_tools.console.errors import CommandError
from gcs_tools.console.keys import operator_key

_SYSTEM_ID_MAX: Final = 255


@dataclass(frozen=True)
class PreflightFiles:
    """Files that a check reads.

    Attributes:
        contract, field, mission, geofence, parameters: all but the first may be None.
        daemon: whose sensors are checked; may be None.
        fleet: whose vehicles must not meet; may be None.
        overrides: of the contract, as given to ``--set``.
        picture: to draw the field to; None for no picture.
    """

    contract: Path
    field: Path | None
    mission: Path | None
    overrides: tuple[str, ...]
    picture: Path | None
    geofence: Path | None = None
    parameters: Path | None = None
    daemon: Path | None = None
    fleet: Path | None = None


class LiveTargets(NamedTuple):
    """What a live check connects to."""

    vehicle_url: str | None
    system_id: int | None
    zenoh_config: Path | None
    endurance_s: float | None
    mavlink_key: bytes | None
    operator_key: bytes | None


def check_options(
    files: PreflightFiles,
    vehicle_url: str | None,
    system_id: int | None,
    authorize_s: float | None,
) -> None:
    """Refuse options that do not fit together."""
    if files.picture is not None and files.field is None:
        raise CommandError("--picture needs --field: it draws the obstacle field")
    if vehicle_url is not None and files.parameters is not None:
        raise CommandError("--parameters is for a vehicle that is not asked: leave out --vehicle")
    if vehicle_url is None and authorize_s is not None:
        raise CommandError("--authorize needs --vehicle: it answers the vehicle's requests to arm")
    if system_id is None:
        return
    if not 1 <= system_id <= _SYSTEM_ID_MAX:
        raise CommandError(f"--system-id {system_id}: expected 1 to {_SYSTEM_ID_MAX}")
    if vehicle_url is None:
        raise CommandError("--system-id needs --vehicle: it selects one of a connection's vehicles")


def daemon_key(path: Path | None, zenoh_config: Path | None) -> bytes | None:
    """Return the key that the daemon expects; None where none is named.

    Raises:
        FileError: the file cannot be used.
        CommandError: there is no daemon that would be sent anything.
    """
    if path is not None and zenoh_config is None:
        raise CommandError("--operator-key needs --zenoh-config: it signs what the daemon is sent")
    return operator_key(path)
