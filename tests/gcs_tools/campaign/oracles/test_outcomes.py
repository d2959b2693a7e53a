"""Oracles about the end of a flight, one by one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs_tools.campaign.generator.faults import DISPLACING
from gcs_tools.campaign.oracles.outcomes import (
    KNOWN_OBSTACLES_MAX,
    allowed_outcome,
    bounded_memory,
    defined_end,
    met_expectation,
    no_collision,
    no_exception,
    no_surprise,
)
from onboard.contract.assessment import TICK_S
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.campaign.oracles.evidence import (
    PHASES,
    changed,
    event,
    flown,
    result,
    state,
)

HIT = 120


def hit(kind: str = "gust", **more: object) -> dict[str, object]:
    """A displacing fault in cruise, after which the vehicle hits something."""
    truths = [
        {"position_ned_m": state(tick)["reference_position_ned_m"], "collisions": int(tick >= HIT)}
        for tick in range(len(PHASES))
    ]
    return {
        "truths": truths,
        "ended": result(collisions=1),
        "covered": False,
        "variant": kind,
        "faults": (Fault(kind=kind, phase="cruise", amount=3.0),),  # type: ignore[arg-type]
        **more,
    }


def test_a_collision_is_a_finding_where_it_is_promised_away() -> None:
    assert list(no_collision(flown(ended=result(collisions=2)))) == ["2 collision(s)"]
    assert not list(no_collision(flown(ended=result(collisions=2), covered=False)))
    assert not list(no_collision(flown()))


def test_a_push_without_an_alarm_is_a_surprise() -> None:
    (found,) = no_surprise(flown(**hit()))  # type: ignore[arg-type]
    assert found == "1 collision(s) without an alarm before"


@pytest.mark.parametrize("name", ["violation", "suspicion"])
def test_an_alarm_before_the_collision_excuses_it(name: str) -> None:
    assert not list(no_surprise(flown(**hit(events=[event(name, HIT)]))))  # type: ignore[arg-type]
    late = flown(**hit(events=[event(name, HIT + 1)]))  # type: ignore[arg-type]
    assert len(list(no_surprise(late))) == 1
    other = flown(**hit(events=[event("phase", HIT)]))  # type: ignore[arg-type]
    assert len(list(no_surprise(other))) == 1


def test_a_push_in_standby_is_not_the_service_s() -> None:
    early = (Fault(kind="gust", amount=3.0, start_s=TICK_S),)
    assert not list(no_surprise(flown(**hit(faults=early))))  # type: ignore[arg-type]


def test_only_displacing_faults_can_surprise() -> None:
    assert "detections_hidden" not in DISPLACING
    hidden = hit(variant="detections_hidden")
    assert not list(no_surprise(flown(**hidden)))  # type: ignore[arg-type]
    covered = hit(covered=True)
    assert not list(no_surprise(flown(**covered)))  # type: ignore[arg-type]


def test_an_exception_in_the_service_is_a_finding() -> None:
    own = event("violation", 50, assumption="self_check", unit="exceptions")
    assert list(no_exception(flown(events=[own]))) == ["exception in the service: the text"]
    assert list(no_exception(flown(events=[own], covered=False)))


def test_a_motion_that_does_not_certify_counts_where_something_is_promised() -> None:
    uncertified = event("violation", 50, assumption="self_check", unit="m")
    assert list(no_exception(flown(events=[uncertified])))
    assert not list(no_exception(flown(events=[uncertified], covered=False)))


def test_other_events_are_no_exceptions() -> None:
    others = [
        event("phase", 10, to="avoid"),
        event("violation", 20, assumption="tracking_error", unit="m"),
    ]
    assert not list(no_exception(flown(events=others)))


def test_a_vehicle_that_never_rests_is_a_finding_unless_it_falls() -> None:
    assert list(defined_end(flown(at_rest=False)))
    assert not list(defined_end(flown()))
    assert not list(defined_end(flown(at_rest=False, variant="motor_failed")))


def test_an_outcome_has_to_be_allowed() -> None:
    held = result(outcome="held", reason="obstacle too large")
    (found,) = allowed_outcome(flown(ended=held))
    assert found == "held (obstacle too large), expected arrived"
    (found,) = allowed_outcome(flown(ended=held, outcomes=("arrived", "aborted")))
    assert found.endswith("expected arrived or aborted")
    assert not list(allowed_outcome(flown(ended=held, outcomes=("arrived", "held"))))
    assert not list(allowed_outcome(flown(ended=held, covered=False)))


def test_a_scenario_file_s_expectation_has_to_be_met() -> None:
    held = result(outcome="held", reason="why")
    assert list(met_expectation(flown(ended=held, expectation=True))) == ["held: why"]
    assert not list(met_expectation(flown(ended=held)))
    good = result(obstacles_avoided=3)
    assert not list(met_expectation(flown(ended=good, expectation=True)))


def test_memory_is_bounded_and_ghosts_are_allowed_for() -> None:
    most = changed(60, obstacles_known=KNOWN_OBSTACLES_MAX)
    assert not list(bounded_memory(flown(states=most)))
    over = changed(60, obstacles_known=KNOWN_OBSTACLES_MAX + 1)
    (found,) = bounded_memory(flown(states=over))
    assert found == "201 obstacles are remembered, expected at most 200"
    ghosts = (Fault(kind="detections_ghost", amount=5.0),)
    assert not list(bounded_memory(flown(states=over, faults=ghosts)))
    many = changed(60, obstacles_known=10_000)
    assert list(bounded_memory(flown(states=many, faults=ghosts)))


def test_a_flight_without_a_state_remembers_nothing() -> None:
    evidence = flown(states=[], plans=[])
    assert not list(bounded_memory(replace(evidence, at_rest=False)))
