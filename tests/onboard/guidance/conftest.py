import pytest

from onboard.files.contract_file import Contract, load_contract
from tests.onboard.conftest import CONTRACTS
from tests.onboard.guidance.perfect_flight import PerfectFlight, mission_to


@pytest.fixture
def contract() -> Contract:
    """A precise vehicle that coasts when the stream stops: no autopilot is simulated here."""
    return load_contract(CONTRACTS / "precise_vehicle.yaml", ("requirements.stop=false",))


@pytest.fixture
def flight(contract: Contract) -> PerfectFlight:
    """A leg of 60 m north, before control is granted."""
    return PerfectFlight(contract, mission_to((60.0, 0.0)))


@pytest.fixture
def cruising(flight: PerfectFlight) -> PerfectFlight:
    """The same at full speed."""
    flight.cruise_at_full_speed()
    return flight


@pytest.fixture
def avoiding(flight: PerfectFlight) -> PerfectFlight:
    """The same in the avoidance of a box of 1 m, 25 m ahead of the start."""
    flight.avoid()
    return flight
