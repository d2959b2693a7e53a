"""What makes a vehicle one of a fleet: the roster, the frame of its messages, and its own files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract, load_contract
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, load_yaml
from onboard.fleet.fleet_file import Fleet, FleetVehicle
from onboard.geometry.local_frame import LocalFrame


@dataclass(frozen=True)
class FlownFiles:
    """What a daemon flies.

    Attributes:
        contract: that it guarantees.
        mission: where it flies; None for the mission on board.
        geofence: that it keeps to.
    """

    contract: Contract
    mission: Mission | None
    geofence: Geofence | None


@dataclass(frozen=True)
class FleetMembership:
    """One vehicle of a fleet.

    Attributes:
        name: of this vehicle.
        contracts: hash of the contract of each vehicle of the roster, this one too, by name.
        frame: of this vehicle, as the fleet's file states it.
        error_m: A, how far its position on the Earth may be off.
        speed_max_mps: no vehicle of the fleet is faster.
        lane_half_width_m: leave is asked for so much on each side of a leg, body and errors beside.
        key: of the fleet; None to send and take messages as they are.
    """

    name: str
    contracts: Mapping[str, str]
    frame: LocalFrame
    error_m: float
    speed_max_mps: float
    lane_half_width_m: float
    key: bytes | None = None


def read_membership(
    path: Path, name: str, flown: FlownFiles, key: bytes | None = None
) -> FleetMembership:
    """Read a fleet's file for one of its vehicles, and check that it flies what that file says.

    Args:
        path: of the fleet's file.
        name: of this vehicle in it.
        flown: what its daemon flies.
        key: of the fleet.

    Raises:
        FileError: a file cannot be used, the vehicle is not of the fleet, it flies otherwise than
            the fleet's file says, or its contract does not keep it in what it has leave for.
    """
    fleet = load_yaml(path, Fleet)
    vehicle = next((each for each in fleet.vehicles if each.name == name), None)
    if vehicle is None:
        names = ", ".join(each.name for each in fleet.vehicles)
        raise FileError(f"{path}: no vehicle is called {name!r}, expected one of {names}")
    _check(path, fleet, vehicle, flown)
    contracts = {
        each.name: load_contract(path.parent / each.contract).sha256 for each in fleet.vehicles
    }
    if contracts[name] != flown.contract.sha256:
        raise FileError(
            f"{path}: contract of {name} = {vehicle.contract}: its hash is {contracts[name][:12]}, "
            f"the daemon flies by {flown.contract.sha256[:12]}"
        )
    return FleetMembership(
        name,
        contracts,
        vehicle.frame,
        vehicle.absolute_position_error_m,
        fleet.speed_max_mps,
        fleet.lane_half_width_m,
        key,
    )


def _check_rest(path: Path, name: str, contract: Contract) -> None:
    """Check that a contract has the vehicle rest in what it has leave for, its daemon dead, too.

    Raises:
        FileError: it does not.
    """
    required = contract.requirements
    for key, value, what in (
        ("stop", required.stop, "every way has to end at rest in what it has leave for"),
        ("passive_safety", required.passive_safety, "so has what is flown on once a daemon died"),
    ):
        if not value:
            raise FileError(
                f"{path}: {name}: requirements.{key} = false in its contract, expected true: "
                f"in a fleet {what}"
            )


def _check(path: Path, fleet: Fleet, vehicle: FleetVehicle, flown: FlownFiles) -> None:
    """Check what the daemon flies against what the fleet's file says of it.

    Raises:
        FileError: it is another one, too fast, or not kept in what it has leave for.
    """
    name, directory = vehicle.name, path.parent
    _check_rest(path, name, flown.contract)
    fence = None if vehicle.geofence is None else load_yaml(directory / vehicle.geofence, Geofence)
    if fence != flown.geofence:
        raise FileError(
            f"{path}: geofence of {name} = {vehicle.geofence}: the daemon keeps to another one"
        )
    mission = flown.mission
    if mission is not None and load_yaml(directory / vehicle.mission, Mission) != mission:
        raise FileError(
            f"{path}: mission of {name} = {vehicle.mission}: the daemon flies another one"
        )
    altitude_m = None if mission is None else mission.altitude_m
    fastest_mps = assess(flown.contract, mission_altitude_m=altitude_m).fastest_mps
    if fleet.speed_max_mps < fastest_mps:
        raise FileError(
            f"{path}: speed_max_mps [m/s] = {fleet.speed_max_mps:g}: {name} may fly "
            f"{fastest_mps:.2f} m/s by its contract, errors included"
        )
