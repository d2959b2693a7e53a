"""Daemons that join the fleet of a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs_tools.fleet.vehicles import Join
from gcs_tools.preflight.offline.fleet_files import Member
from onboard.autonomy import Autonomy
from onboard.fleet.membership import FleetMembership, FlownFiles, read_membership


def joining(path: Path, members: Sequence[Member]) -> Join:
    """Return what makes each daemon that starts a member of its fleet.

    Args:
        path: of the fleet's file.
        members: its vehicles.

    Raises:
        FileError: a vehicle of the file cannot be a member of the fleet.
    """
    memberships = {member.name: _membership(path, member) for member in members}

    def join(service: Autonomy, member: Member, boot: str) -> None:
        service.join_fleet(memberships[member.name], boot)

    return join


def _membership(path: Path, member: Member) -> FleetMembership:
    flown = FlownFiles(member.assessment.contract, member.mission, member.geofence)
    return read_membership(path, member.name, flown)
