from collections.abc import Callable

import pytest

from onboard.files.contract_file import Contract
from tests.onboard.guidance.dense.field_flight import FieldFlight, IdealSeenSpace, Stem
from tests.onboard.guidance.perfect_flight import mission_to


@pytest.fixture
def best_effort(contract: Contract) -> Contract:
    """The precise vehicle, where passing obstacles is not guaranteed."""
    changes = {"progress": "best_effort", "stop": True}
    requirements = contract.requirements.model_copy(update=changes)
    return contract.model_copy(update={"requirements": requirements})


FlightOver = Callable[..., FieldFlight]


@pytest.fixture
def flight_over(best_effort: Contract) -> FlightOver:
    """Make a flight through stems to the ends of some legs, on foreknown ground by default."""

    def make(
        *stems: Stem,
        ends_ned_m: tuple[tuple[float, float], ...] = ((20.0, 0.0),),
        heading: str = "path",
        seen: IdealSeenSpace | None = None,
    ) -> FieldFlight:
        mission = mission_to(*ends_ned_m).model_copy(update={"heading": heading})
        return FieldFlight(best_effort, mission, stems, seen or IdealSeenSpace(start_known=True))

    return make
