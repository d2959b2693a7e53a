"""A hold is ended by the operator only where what failed has held again for a while."""

import pytest

from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.resumption import QUIET_S, RESUMABLE, FailureTimes, resume_objections

HELD_S = 100.0


def violated(assumption: Assumption) -> Violation:
    return Violation(assumption, 1.0, 0.0, "m")


@pytest.mark.parametrize("assumption", Assumption)
def test_what_is_not_confirmed_again_by_the_service_is_the_pilots_for_ever(
    assumption: Assumption,
) -> None:
    objections = resume_objections(assumption, HELD_S, FailureTimes(), HELD_S + 3600.0)
    if assumption in RESUMABLE:
        assert objections == {}
    else:
        text = f"{assumption} has failed: only the pilot may end this hold"
        assert objections == {assumption: text}


@pytest.mark.parametrize(
    "doubt",
    [
        Assumption.POSITION_QUALITY,
        Assumption.ESTIMATOR_RESET,
        Assumption.HEADING_ERROR,
        Assumption.TELEMETRY_AGE,
        Assumption.SECOND_COMMANDER,
        Assumption.SELF_CHECK,
        Assumption.SENSOR_CONTRADICTION,
        Assumption.TRACKING_ERROR,
    ],
)
def test_a_doubt_during_the_hold_leaves_it_to_the_pilot(doubt: Assumption) -> None:
    failures = FailureTimes()
    failures.note(violated(doubt), HELD_S - 1.0)
    later_s = HELD_S + 20.0
    assert not resume_objections(Assumption.DETECTION_AGE, HELD_S, failures, later_s)
    failures.note(violated(doubt), HELD_S + 2.0)
    assert list(resume_objections(Assumption.DETECTION_AGE, HELD_S, failures, later_s)) == [doubt]


def test_nothing_may_have_failed_for_a_while() -> None:
    failures, cause = FailureTimes(), Assumption.DETECTION_RANGE
    last_s = HELD_S + 7.0
    failures.note(violated(cause), HELD_S)
    failures.note(violated(cause), last_s)
    early = resume_objections(cause, HELD_S, failures, last_s + QUIET_S - 0.5)
    assert early == {cause: "detection_range failed 2.5 s ago (limit 3 s)"}
    assert not resume_objections(cause, HELD_S, failures, last_s + QUIET_S)


def test_every_objection_is_stated() -> None:
    failures = FailureTimes()
    for assumption in (Assumption.REACTION_TIME, Assumption.SECOND_COMMANDER):
        failures.note(violated(assumption), HELD_S + 1.0)
    objections = resume_objections(Assumption.DETECTION_AGE, HELD_S, failures, HELD_S + 2.0)
    assert set(objections) == {
        Assumption.DETECTION_AGE,
        Assumption.REACTION_TIME,
        Assumption.SECOND_COMMANDER,
    }
