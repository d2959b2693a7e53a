"""What the operator states, in one place: contract, mission and daemon configuration."""

from onboard.files.contract_file import (
    LATER_KEYS,
    Contract,
    EnvironmentTerms,
    InputSet,
    Requirements,
    SensorTerms,
    VehicleTerms,
    load_contract,
    pinned_run_on_speed,
)
from onboard.files.daemon_config import DaemonConfig, FilePath, MavlinkLink
from onboard.files.mission_file import LEG_LENGTH_MIN_M, Leg, Mission

__all__ = [
    "LATER_KEYS",
    "LEG_LENGTH_MIN_M",
    "Contract",
    "DaemonConfig",
    "EnvironmentTerms",
    "FilePath",
    "InputSet",
    "Leg",
    "MavlinkLink",
    "Mission",
    "Requirements",
    "SensorTerms",
    "VehicleTerms",
    "load_contract",
    "pinned_run_on_speed",
]
