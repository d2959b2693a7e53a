"""The geofence as a limit of what is certified, and of the missions that are taken."""

import numpy as np
import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig
from tests.onboard.test_resume import SeeingAllRound

MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": [{"end_ned_m": [14.0, 0.0]}]})


# Far from every leg here.
HOLE = {"keep": "outside", "center_ned_m": [200.0, 0.0], "radius_m": 20.0}


def fence(half_width_m: float, length_m: float = 30.0) -> Geofence:
    corners = [(-20.0, half_width_m), (length_m, half_width_m)]
    corners += [(length_m, -6.0), (-20.0, -6.0)]
    area = {"keep": "inside", "corners_ned_m": corners}
    return Geofence.model_validate({"areas": [area, HOLE]})


def best_effort(contract: Contract) -> Contract:
    requirements = contract.requirements.model_copy(
        update={"stop": True, "progress": "best_effort"}
    )
    sensor = contract.sensor.model_copy(update={"field_of_view_deg": 360.0})
    return contract.model_copy(update={"requirements": requirements, "sensor": sensor})


def test_nothing_beyond_the_fence_is_free_whatever_the_sensor_sees(contract: Contract) -> None:
    """So that every way to rest, which is certified in what is free, keeps the body inside."""
    autonomy = Autonomy(best_effort(contract), MISSION, epoch_unix_s=EPOCH_UNIX_S)
    border_m = autonomy.assessment.inflation_m() + 0.3
    autonomy.keep_in(fence(border_m))
    rig = SeeingAllRound(autonomy, mode=OFFBOARD)
    rig.run(20.0, until=lambda: rig.position_ned_m[0] > 1.0)
    assert rig.phase is Phase.THREAD
    grid = autonomy.supervisor.seen.grid()
    x_m = np.full(40, 4.0)
    beyond_m = border_m + np.linspace(0.0, 4.0, 40)
    assert not grid.are_free(x_m, x_m, beyond_m, beyond_m).any()
    # The cells at the border are turned by nothing here: all but one of them may be used.
    assert grid.is_free(4.0, 4.2, -3.0, border_m - 0.21)
    way = autonomy.navigator.thread
    assert way is not None
    assert way.way.certified is True


@pytest.mark.parametrize("stops", [True, False])
def test_a_mission_that_leaves_the_fence_is_refused(contract: Contract, stops: bool) -> None:
    contract = best_effort(contract) if stops else contract
    autonomy = Autonomy(contract, MISSION, epoch_unix_s=EPOCH_UNIX_S)
    autonomy.keep_in(fence(30.0, length_m=14.2))
    rig = (SeeingAllRound if stops else Rig)(autonomy, mode=OFFBOARD)
    rig.run(0.5)
    assert rig.phase is Phase.STANDBY
    assert "legs.0 comes within" in rig.texts("refused")[-1]
    away = Mission.model_validate({"altitude_m": 4.0, "legs": [{"end_ned_m": [0.0, 80.0]}]})
    autonomy.receive_mission(away.model_dump_json().encode(), rig.now_s)
    rig.tick()
    assert rig.texts("mission_refused")[0].startswith("mission refused: legs.0 comes within")
    assert rig.texts("mission_changed") == []
