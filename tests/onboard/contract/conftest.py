from __future__ import annotations

import pytest

from onboard.files.contract_file import Contract, load_contract
from tests.onboard.conftest import CONTRACTS


@pytest.fixture
def contract() -> Contract:
    """The contract of a vehicle that coasts when the stream stops."""
    return load_contract(CONTRACTS / "precise_vehicle.yaml")
