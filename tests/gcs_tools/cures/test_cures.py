"""Every report of the service and of the pre-flight check has a cause and a cure."""

import pytest

from gcs_tools.cures.assumptions import ASSUMPTION_CURES
from gcs_tools.cures.checks import FINDING_CURES, RULE_CURES, cure_of_finding
from gcs_tools.cures.reports import EVENT_CURES, REFUSAL_CURES
from onboard.events import EventName
from onboard.guidance.departure import RefusalKind
from onboard.monitoring.assumptions import Assumption
from tests.tools.troubleshooting.texts import check_names

# Where the name of a check is not literal: a parameter's, a sensor's, or handed on by a function
# whose callers are searched.
NAMED_ELSEWHERE = {
    "bus.py:authorize",
    "daemon.py:_age_finding",
    "daemon.py:_sensor_finding",
    "detections.py:_check_declared",
    "detections.py:_check_times",
    "detections.py:check_detections",
    "detections.py:finding",
    "field_check.py:_none_of",
    "parameter_file.py:check_parameter_file",
    "parameters.py:rule_finding",
    "sensors.py:check_sources",
    "sensors.py:virtual_finding",
    "vehicle.py:_identity",
    "vehicle.py:_known",
    "vehicle.py:_rate",
    "vehicle.py:_unknown",
}


def test_every_assumption_refusal_and_event_has_a_cure() -> None:
    assert set(ASSUMPTION_CURES) == set(Assumption)
    assert set(REFUSAL_CURES) == set(RefusalKind)
    assert set(EVENT_CURES) == set(EventName)


def test_every_rule_and_finding_of_the_pre_flight_check_has_a_cure() -> None:
    made = check_names() | check_names("onboard/contract/clauses.py")
    made |= check_names("onboard/contract/emergence.py")
    assert made - RULE_CURES.keys() - FINDING_CURES.keys() == NAMED_ELSEWHERE


def test_no_cure_is_empty() -> None:
    tables = (ASSUMPTION_CURES, REFUSAL_CURES, EVENT_CURES, RULE_CURES, FINDING_CURES)
    for table in tables:
        for name, (cause, cure) in table.items():
            assert cause, name
            assert cure, name


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("front age", "raise the frame rate"),
        ("age", "raise the frame rate"),
        ("front_age", "clearway sensor check"),
        ("geofence areas", "correct the fence"),
        ("COM_OF_LOSS_T", "set COM_OF_LOSS_T as it says"),
    ],
)
def test_a_finding_is_known_by_the_end_of_its_name(name: str, cure: str) -> None:
    assert cure in cure_of_finding(name)
