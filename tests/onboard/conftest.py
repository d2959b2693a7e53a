from pathlib import Path

import pytest

from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml

CONFIG = Path(__file__).parents[2] / "config"
CONTRACTS = Path(__file__).parents[1] / "contracts"


@pytest.fixture
def contract() -> Contract:
    """A precise vehicle at 15 degrees, which complies with room to spare."""
    # The simulated vehicle that flies it is an ideal PX4.
    loss = "vehicle.setpoint_loss={model: frozen, gain_per_s: 1.3, velocity_gain_per_s: 4.5}"
    return load_contract(CONTRACTS / "precise_vehicle.yaml", (loss, "requirements.stop=false"))


@pytest.fixture
def mission() -> Mission:
    return load_yaml(CONFIG / "paper_mission.yaml", Mission)
