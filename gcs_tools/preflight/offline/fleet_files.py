"""Reads a fleet and the files that it names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import load_contract
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, load_yaml
from onboard.fleet.fleet_file import Fleet, FleetVehicle
from onboard.geometry.local_frame import LocalFrame


@dataclass(frozen=True)
class Member:
    """One vehicle of a fleet, with its files read.

    Attributes:
        vehicle: as the fleet's file states it.
        assessment: of its contract, at the height of its mission.
        mission: its own.
        geofence: its own; None if there is none.
    """

    vehicle: FleetVehicle
    assessment: Assessment
    mission: Mission
    geofence: Geofence | None

    @property
    def name(self) -> str:
        """Its name in the fleet."""
        return self.vehicle.name

    @property
    def error_m(self) -> float:
        """A, the error of its position on the Earth."""
        return self.vehicle.absolute_position_error_m

    @property
    def frame(self) -> LocalFrame:
        """Its local frame."""
        return self.vehicle.frame

    @property
    def margin_m(self) -> float:
        """Rho of its contract, which covers body, tracking error and the error of faces."""
        return self.assessment.inflated.margin_m

    @property
    def fastest_mps(self) -> float:
        """How fast its contract lets it be over ground: at cruise, and swerving (theory A, D)."""
        return self.assessment.fastest_mps


def read_fleet(path: Path) -> tuple[Fleet, tuple[Member, ...]]:
    """Read a fleet's file and all files of its vehicles.

    Raises:
        FileError: a file cannot be used, or a contract lets its vehicle fly faster than the fleet's
            file says that any does.
    """
    fleet = load_yaml(path, Fleet)
    members = tuple(_member(vehicle, path.parent) for vehicle in fleet.vehicles)
    for number, member in enumerate(members):
        fastest_mps = member.fastest_mps
        if fleet.speed_max_mps < fastest_mps:
            raise FileError(
                f"{path}: speed_max_mps [m/s] = {fleet.speed_max_mps:g}: vehicles.{number}, "
                f"{member.name}, may fly {fastest_mps:.2f} m/s by its contract, errors included"
            )
    return fleet, members


def _member(vehicle: FleetVehicle, directory: Path) -> Member:
    mission = load_yaml(directory / vehicle.mission, Mission)
    contract = load_contract(directory / vehicle.contract)
    fence = vehicle.geofence
    return Member(
        vehicle,
        assess(contract, mission_altitude_m=mission.altitude_m),
        mission,
        None if fence is None else load_yaml(directory / fence, Geofence),
    )
