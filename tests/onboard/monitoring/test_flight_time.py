"""A flight that lasts as long as the contract allows for ends in a hold, to be landed."""

from __future__ import annotations

import math
from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.contract.assessment import assess
from onboard.contract.terms import Terms
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, validate
from onboard.guidance.phases import Phase
from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.flight_time import FlightTimeMonitor
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, ON_GROUND, POSCTL, Rig

LIMIT_S = 20.0
LEGS = [{"end_ned_m": [60.0, 0.0], "target_half_width_m": 8.0}]
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": LEGS})


def drifting(
    contract: Contract, drift_mps: float = 0.0, time_s: float | None = LIMIT_S
) -> Contract:
    document = contract.model_dump()
    document["vehicle"]["position_drift_mps"] = drift_mps
    document["requirements"]["flight_time_max_s"] = time_s
    return validate(document, Contract, source="contract.yaml")


def test_time_runs_from_take_off_to_landing() -> None:
    monitor = FlightTimeMonitor()
    assert not monitor.follow(None, 0.0)
    assert not monitor.follow(False, 1.0)
    assert monitor.check(1e6, LIMIT_S) is None
    assert monitor.follow(True, 100.0)
    assert not monitor.follow(True, 101.0)
    # What is not known goes on as it was.
    assert not monitor.follow(None, 102.0)
    assert monitor.check(100.0 + LIMIT_S - 0.1, LIMIT_S) is None
    assert monitor.check(1e6, None) is None
    over = monitor.check(100.0 + LIMIT_S, LIMIT_S)
    assert over is not None
    assert over.assumption is Assumption.FLIGHT_TIME
    assert str(over) == "flight_time: 20 s since take-off (limit 20 s): land now"
    assert not monitor.follow(False, 130.0)
    assert monitor.check(1e6, LIMIT_S) is None
    assert monitor.follow(True, 200.0)


def test_the_flight_ends_in_a_hold_that_asks_to_land(contract: Contract) -> None:
    rig = Rig(Autonomy(drifting(contract), MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=OFFBOARD)
    rig.run(LIMIT_S - 0.2)
    before = rig.phase
    rig.run(0.4)
    assert (before, rig.phase) == (Phase.CRUISE, Phase.HOLD)
    assert rig.texts("violation") == ["flight_time: 20 s since take-off (limit 20 s): land now"]


def test_a_hover_is_asked_to_land_and_no_flight_begins_afterwards(contract: Contract) -> None:
    rig = Rig(Autonomy(drifting(contract), MISSION, epoch_unix_s=EPOCH_UNIX_S), mode=POSCTL)
    rig.run(LIMIT_S + 1.0)
    rig.mode = OFFBOARD
    rig.run(1.0)
    refused, before = rig.texts("refused")[-1], rig.phase
    assert "20 s since take-off (limit 20 s): land now" in refused.replace("21 s", "20 s")
    rig.landed_state = ON_GROUND
    rig.run(0.2)
    rig.mode, rig.landed_state = POSCTL, 2
    rig.run(0.5)
    rig.mode = OFFBOARD
    rig.run(1.0)
    assert (before, rig.phase) == (Phase.STANDBY, Phase.CRUISE)


def test_drift_is_allowed_for_in_body_and_map_beforehand(contract: Contract) -> None:
    still, terms = Terms.of(contract), Terms.of(drifting(contract, 0.01, 60.0))
    assert terms.drift_m == pytest.approx(0.6)
    assert terms.body_m == pytest.approx(still.body_m + 0.6)
    assert terms.map_error_m == pytest.approx(still.position_error_m + 0.6)
    # What a frame and the tracking are checked against stays.
    assert terms.position_error_m == still.position_error_m
    assert terms.tracking_error_m == still.tracking_error_m
    wide, narrow = assess(drifting(contract, 0.01, 60.0)), assess(contract)
    # A box that stands across the leg is off by both components of the drift.
    both_m = 0.6 + math.sqrt(2.0) * 0.6
    assert wide.inflation_m() == pytest.approx(narrow.inflation_m() + both_m)
    assert wide.inflated.region.front_m >= narrow.inflated.region.front_m


def test_without_drift_nothing_changes(contract: Contract) -> None:
    limited = assess(drifting(contract, 0.0, 300.0))
    assert limited.terms.drift_m == 0.0
    assert limited.inflated == assess(contract).inflated


def test_drift_without_an_end_is_refused(contract: Contract) -> None:
    with pytest.raises(FileError) as caught:
        drifting(contract, 0.02, None)
    assert str(caught.value).endswith(
        "vehicle.position_drift_mps = 0.02 m/s needs requirements.flight_time_max_s [s], "
        "which bounds what it adds up to"
    )


@pytest.mark.parametrize(("drift_mps", "voided"), [(0.0, False), (0.001, True)])
def test_what_was_seen_on_the_ground_is_void_where_the_position_drifts(
    contract: Contract, drift_mps: float, *, voided: bool
) -> None:
    drifted: dict[str, Any] = {"landed_state": ON_GROUND, "mode": POSCTL}
    autonomy = Autonomy(drifting(contract, drift_mps), MISSION, epoch_unix_s=EPOCH_UNIX_S)
    rig = Rig(autonomy, **drifted)
    rig.run(1.0)
    seen = autonomy.supervisor.seen
    assert seen.size > 0
    rig.landed_state = 2
    rig.tick()
    assert bool(seen.void_reason) is voided
