from pathlib import Path

import pytest

from onboard.config import Contract, Mission, load_contract
from onboard.yaml_file import load_yaml

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def contract() -> Contract:
    """The shipped example at 15 degrees, which complies."""
    return load_contract(CONFIG / "default_contract.yaml")


@pytest.fixture
def mission() -> Mission:
    return load_yaml(CONFIG / "paper_mission.yaml", Mission)
