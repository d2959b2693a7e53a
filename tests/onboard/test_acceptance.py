"""A pre-flight check may accept once that arrival is not guaranteed: one flight has best effort."""

from __future__ import annotations

from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.guidance.phases import FlightState, Phase
from onboard.monitoring.flight_authorization import ACCEPTANCE_AGE_MAX_S, FlightAuthorization
from onboard.recording.state import state_of
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, ON_GROUND, POSCTL
from tests.onboard.test_resume import SeeingAllRound

MISSION = Mission.model_validate(
    {"altitude_m": 4.0, "legs": [{"end_ned_m": [12.0, 0.0], "target_half_width_m": 8.0}]}
)


@pytest.fixture
def dense(contract: Contract) -> Contract:
    """A contract with best effort neither stated nor superfluous: obstacles stand too close."""
    changes = {
        # It flies by what it has seen free.
        "requirements": contract.requirements.model_copy(update={"stop": True}),
        "sensor": contract.sensor.model_copy(update={"field_of_view_deg": 360.0}),
        "environment": contract.environment.model_copy(update={"obstacle_separation_min_m": 1.0}),
    }
    return contract.model_copy(update=changes)


def waiting(contract: Contract, preflight_age_max_s: float | None = None) -> SeeingAllRound:
    autonomy = Autonomy(
        contract, MISSION, epoch_unix_s=EPOCH_UNIX_S, preflight_age_max_s=preflight_age_max_s
    )
    rig = SeeingAllRound(autonomy, mode=OFFBOARD)
    rig.run(1.0)
    assert rig.phase is Phase.STANDBY
    return rig


def accept(rig: SeeingAllRound, contract: Contract, **changes: Any) -> None:
    said = FlightAuthorization(
        contract_sha256=contract.sha256,
        stamp_unix_s=EPOCH_UNIX_S + rig.now_s,
        passed=True,
        progress="best_effort",
    )
    payload = said.model_copy(update=changes).model_dump_json().encode()
    rig.autonomy.receive_flight_authorization(payload, rig.now_s)


def progress(rig: SeeingAllRound) -> str:
    return state_of(rig.autonomy, rig.now_s).progress


@pytest.mark.parametrize("age_max_s", [None, 60.0])
def test_an_acceptance_flies_once_what_the_contract_does_not_guarantee(
    dense: Contract, age_max_s: float | None
) -> None:
    rig = waiting(dense, age_max_s)
    assert progress(rig) == "guaranteed"
    accept(rig, dense)
    rig.run(0.1)
    assert progress(rig) == "best_effort"
    assert rig.texts("accepted") == [
        "the next flight is not guaranteed to arrive, which was accepted"
    ]
    assert rig.autonomy.navigator.state is FlightState.LOOKING
    rig.run(40.0, until=lambda: rig.phase is Phase.ARRIVED)
    flown = rig.phase
    # The pilot lands: that was the one flight.
    rig.mode, rig.landed_state = POSCTL, ON_GROUND
    rig.run(0.5)
    assert progress(rig) == "guaranteed"
    rig.landed_state, rig.mode = 2, OFFBOARD
    rig.run(1.0)
    assert (flown, rig.phase) == (Phase.ARRIVED, Phase.STANDBY)
    assert "the contract does not comply (separation)" in rig.texts("refused")[-1]


def test_it_stays_while_the_pilot_intervenes(dense: Contract) -> None:
    rig = waiting(dense)
    accept(rig, dense)
    rig.run(8.0)
    flown = rig.phase
    rig.mode = POSCTL
    rig.run(0.2)
    assert (flown, rig.phase) == (Phase.THREAD, Phase.STANDBY)
    rig.velocity_ned_mps = (0.0, 0.0, 0.0)
    rig.run(3.0)
    rig.mode = OFFBOARD
    rig.run(1.0)
    assert rig.phase in (Phase.PAUSE, Phase.THREAD)


@pytest.mark.parametrize(
    "changes",
    [
        {"progress": None},
        {"passed": False},
        {"contract_sha256": "0" * 64},
        {"stamp_unix_s": EPOCH_UNIX_S - ACCEPTANCE_AGE_MAX_S - 10.0},
    ],
)
def test_what_is_not_a_valid_acceptance_changes_nothing(
    dense: Contract, changes: dict[str, Any]
) -> None:
    rig = waiting(dense)
    accept(rig, dense, **changes)
    rig.run(1.0)
    assert rig.phase is Phase.STANDBY
    assert progress(rig) == "guaranteed"
    assert "the contract does not comply (separation)" in rig.texts("refused")[0]


def test_a_later_check_that_fails_withdraws_it_in_flight_too(dense: Contract) -> None:
    rig = waiting(dense)
    accept(rig, dense)
    rig.run(8.0)
    accept(rig, dense, passed=False)
    rig.run(0.2)
    flown = rig.phase  # what flies is safe, and goes on
    rig.mode = POSCTL
    rig.run(0.2)
    rig.mode = OFFBOARD
    rig.velocity_ned_mps = (0.0, 0.0, 0.0)
    rig.run(1.0)
    assert (flown, rig.phase) == (Phase.THREAD, Phase.STANDBY)
    assert progress(rig) == "guaranteed"


def test_without_a_way_to_stop_there_is_nothing_to_accept(dense: Contract) -> None:
    """The pure form has no way to rest: what does not comply is not flown."""
    requirements = dense.requirements.model_copy(update={"stop": False})
    pure = dense.model_copy(update={"requirements": requirements})
    rig = waiting(pure)
    accept(rig, pure)
    rig.run(1.0)
    assert rig.phase is Phase.STANDBY
    assert rig.autonomy.navigator.thread is None
