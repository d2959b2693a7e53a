from pathlib import Path

import pytest

from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml

CONFIG = Path(__file__).parents[2] / "config"
CONTRACTS = Path(__file__).parents[1] / "contracts"


# Of the ideal PX4 that the rigs simulate, which flies on to the last setpoint.
FROZEN = "vehicle.setpoint_loss={model: frozen, gain_per_s: 1.3, velocity_gain_per_s: 4.5}"


@pytest.fixture
def px4_contract() -> Contract:
    """A precise vehicle at 15 degrees, which complies with room to spare, flown by a PX4."""
    return load_contract(CONTRACTS / "precise_vehicle.yaml", (FROZEN, "requirements.stop=false"))


@pytest.fixture
def contract(px4_contract: Contract) -> Contract:
    """The same: directories without a simulated autopilot have their own."""
    return px4_contract


@pytest.fixture
def mission() -> Mission:
    return load_yaml(CONFIG / "paper_mission.yaml", Mission)
