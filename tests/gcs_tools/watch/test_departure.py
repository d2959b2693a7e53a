"""What a vehicle lacks before it departs, as the live view says it."""

from __future__ import annotations

from dataclasses import replace

from gcs_tools.watch.departure import DepartureCheck
from onboard.files.contract_file import load_contract
from onboard.recording.messages import EventRecord, SensorRecord, StateRecord
from tests.gcs_tools.running import CONFIG

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
READY = StateRecord(
    time_s=1.79e9,
    phase="standby",
    mode="POSCTL",
    telemetry_age_s=0.05,
    detection_age_s=0.05,
    sensors={"front": SensorRecord(age_s=0.05, heard_age_s=0.05)},
    cleared=True,
)
REFUSED = EventRecord(
    time_s=1.79e9,
    name="refused",
    text="not leaving standby: the start is not seen free",
    data={"reasons": [{"kind": "x", "subject": "", "text": "the start is not seen free"}]},
)


def ready() -> DepartureCheck:
    check = DepartureCheck()
    check.contract = CONTRACT
    check.take(READY)
    return check


def texts(check: DepartureCheck) -> list[str]:
    return [lack.text for lack in check.departure().missing]


def test_a_vehicle_that_lacks_nothing_waits() -> None:
    departure = ready().departure()
    assert (departure.waiting, departure.missing) == (True, ())


def test_before_a_daemon_is_heard_and_once_it_flies_nothing_is_waited_for() -> None:
    assert not DepartureCheck().departure().waiting
    check = ready()
    check.take(replace(READY, phase="cruise", cleared=False))
    assert (check.departure().waiting, check.departure().missing) == (False, ())


def test_each_thing_that_is_missing_has_its_cure() -> None:
    check = ready()
    check.take(replace(READY, cleared=False, detection_age_s=9.0, position_doubt="no GPS fix"))
    missing = check.departure().missing
    assert [lack.text.partition(":")[0] for lack in missing] == [
        "position",
        "sensor",
        "authorization",
    ]
    assert all(lack.cure for lack in missing)


def test_what_could_not_be_confirmed_is_missing() -> None:
    check = DepartureCheck()
    check.take(READY)
    assert any("contract" in text for text in texts(check))


def test_a_refusal_stands_as_long_as_it_is_asked_for() -> None:
    check = ready()
    offboard = replace(READY, mode="OFFBOARD")
    check.take(offboard)
    check.take(REFUSED)
    assert texts(check) == ["departure: the start is not seen free"]
    check.take(offboard)
    assert texts(check) == ["departure: the start is not seen free"]
    check.take(READY)
    assert texts(check) == []
    check.take(REFUSED)
    check.take(replace(offboard, phase="cruise"))
    check.take(READY)
    assert texts(check) == []
