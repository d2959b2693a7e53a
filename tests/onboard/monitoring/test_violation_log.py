import pytest

from onboard.event_limiter import EVENT_PERIOD_S
from onboard.events import Event, EventName, Severity
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.violation_log import ViolationLog


def violation(subject: str = "", measured: float = 1.0) -> Violation:
    return Violation(Assumption.OBSTACLE_SIZE, measured, 0.5, "m", subject)


@pytest.fixture
def events() -> list[Event]:
    return []


@pytest.fixture
def log(events: list[Event]) -> ViolationLog:
    return ViolationLog(events.append)


def test_what_lasts_is_said_once(log: ViolationLog, events: list[Event]) -> None:
    for step in range(1000):
        log.report(violation(measured=1.0 + step / 100.0), step * 0.02)
    (event,) = events
    assert event.data["measured"] == 1.0
    assert event.time_s == 0.0


def test_another_subject_or_assumption_is_said_too(log: ViolationLog, events: list[Event]) -> None:
    log.report(violation("front/1"), 0.0)
    log.report(violation("front/2"), 0.0)
    log.report(Violation(Assumption.WIND, 9.0, 5.0, "m/s"), 0.0)
    assert [event.data["subject"] for event in events] == ["front/1", "front/2", ""]


def test_in_the_next_flight_it_is_said_anew(log: ViolationLog, events: list[Event]) -> None:
    log.report(violation(), 0.0)
    log.report_suspicion(violation(), 0.0)
    log.report_merger("a+b", 16.0, 0.0)
    log.begin_flight()
    log.report(violation(), 60.0)
    log.report_suspicion(violation(), 60.0)
    log.report_merger("a+b", 16.0, 60.0)
    assert len(events) == 8
    assert [event.time_s for event in events] == [0.0] * 4 + [60.0] * 4


def test_a_suspicion_is_said_once_whatever_deviates(log: ViolationLog, events: list[Event]) -> None:
    log.report_suspicion(violation("a"), 0.0)
    log.report_suspicion(violation("b"), 9.0)
    (event,) = events
    assert event.text.startswith("vehicle deviates from setpoint (obstacle_size (a): 1.00")
    assert event.text.endswith("pilot takeover or second commander?")


def test_a_suspicion_does_not_silence_the_second_commander_found_later(
    log: ViolationLog, events: list[Event]
) -> None:
    log.report_suspicion(violation(), 0.0)
    log.report(Violation(Assumption.SECOND_COMMANDER, 0.4, 0.15, "m"), 1.0)
    assert len(events) == 2


def test_mergers_are_said_once_each_and_rarely(log: ViolationLog, events: list[Event]) -> None:
    log.report_merger("a+b", 16.0, 0.0)
    log.report_merger("c+d", 16.0, 1.0)  # too soon: later
    log.report_merger("a+b", 16.0, EVENT_PERIOD_S)
    log.report_merger("c+d", 16.0, EVENT_PERIOD_S)
    texts = [event.text for event in events]
    assert texts[1::2] == ["avoiding a+b as one", "avoiding c+d as one"]
    assert texts[0] == "roi_intersection (a+b): 0.00, limit 16.00 m"


def test_a_delay_is_no_violation_and_said_once(log: ViolationLog, events: list[Event]) -> None:
    silent = Violation(Assumption.DETECTION_AGE, 0.5, 0.3, "s", "front")
    log.report_delay(silent, 0.0)
    log.report_delay(silent, 1.0)
    (event,) = events
    assert (event.name, event.severity) == (EventName.DELAYED, Severity.NOTICE)
    assert event.text.endswith("; going on by itself when that is over")
