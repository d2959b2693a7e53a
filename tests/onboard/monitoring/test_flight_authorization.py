"""Without a recent, passed check of the very contract, the daemon stays in STANDBY."""

from __future__ import annotations

import json
from typing import Any

import pytest

from onboard.autonomy import Autonomy
from onboard.files.contract_file import Contract
from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.files.mission_file import Mission
from onboard.guidance.phases import Phase
from onboard.monitoring.flight_authorization import FlightAuthorization, FlightAuthorizationGate
from onboard.recording.state import state_of
from tests.onboard.test_autonomy import EPOCH_UNIX_S, OFFBOARD, Rig

AGE_MAX_S = 60.0
NOW_UNIX_S = EPOCH_UNIX_S


@pytest.fixture
def guarded(contract: Contract, mission: Mission) -> Rig:
    autonomy = Autonomy(contract, mission, epoch_unix_s=EPOCH_UNIX_S, preflight_age_max_s=AGE_MAX_S)
    return Rig(autonomy, mode=OFFBOARD)


def clearance(contract: Contract, **changes: Any) -> bytes:
    passed = FlightAuthorization(
        contract_sha256=contract.sha256, stamp_unix_s=NOW_UNIX_S, passed=True, checks={}
    )
    return passed.model_copy(update=changes).model_dump_json().encode()


def test_it_departs_once_it_is_cleared(guarded: Rig, contract: Contract) -> None:
    guarded.run(6.0)  # first there were no detections either, and refusals are 5 s apart
    assert guarded.texts("refused")[-1] == "not leaving standby: no pre-flight check"
    assert state_of(guarded.autonomy, guarded.now_s).cleared is False
    guarded.autonomy.receive_flight_authorization(clearance(contract), guarded.now_s)
    assert guarded.phase is Phase.STANDBY
    guarded.run(0.1)
    assert "cruise" in guarded.texts("phase")[-1]
    assert state_of(guarded.autonomy, guarded.now_s).cleared is True


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"passed": False}, "did not pass"),
        ({"contract_sha256": "0" * 64}, "was of contract 000000000000"),
        ({"stamp_unix_s": NOW_UNIX_S - AGE_MAX_S - 1.0}, "s old, limit 60 s"),
        ({"stamp_unix_s": NOW_UNIX_S + 10.0}, "is -10 s old"),
    ],
)
def test_what_does_not_clear(
    guarded: Rig, contract: Contract, changes: dict[str, Any], words: str
) -> None:
    guarded.autonomy.receive_flight_authorization(clearance(contract, **changes), guarded.now_s)
    guarded.run(1.0)
    assert guarded.phase is Phase.STANDBY
    assert words in guarded.texts("refused")[0]


def test_a_failed_check_withdraws_a_passed_one(contract: Contract) -> None:
    gate = FlightAuthorizationGate(contract.sha256, AGE_MAX_S)
    gate.receive(clearance(contract))
    assert gate.refusal(NOW_UNIX_S) is None
    gate.receive(clearance(contract, passed=False))
    assert gate.refusal(NOW_UNIX_S) == "the pre-flight check did not pass"


def test_garbage_is_counted_and_changes_nothing(contract: Contract) -> None:
    gate = FlightAuthorizationGate(contract.sha256, AGE_MAX_S)
    gate.receive(clearance(contract))
    whole = json.loads(clearance(contract))
    garbage = [b"", b"\xff", b"[]", b"{}", json.dumps(whole | {"version": 2}).encode()]
    garbage.append(json.dumps(whole | {"stamp_unix_s": float("nan")}).encode())
    garbage.append(json.dumps(whole | {"contract_sha256": "short"}).encode())
    for payload in garbage:
        with pytest.raises(MalformedPayloadError):
            parse(payload, FlightAuthorization)
        gate.receive(payload)
    assert gate.malformed == len(garbage)
    assert gate.refusal(NOW_UNIX_S) is None


def test_without_the_requirement_nobody_asks(contract: Contract) -> None:
    assert FlightAuthorizationGate(contract.sha256, None).refusal(NOW_UNIX_S) is None
