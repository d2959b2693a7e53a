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
    return load_contract(CONTRACTS / "precise_vehicle.yaml", ("requirements.stop=false",))


@pytest.fixture
def mission() -> Mission:
    return load_yaml(CONFIG / "paper_mission.yaml", Mission)
