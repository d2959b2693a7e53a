"""Every event is also a line of the daemon's own log."""

from __future__ import annotations

import io
import json
import logging
import threading
import time

import pytest

from onboard.events import Event, EventName, Severity
from onboard.log_format import JsonFormatter, TextFormatter
from onboard.message_thread import MessageThread
from onboard.recording.event_log import BURST, RATE_PER_S, EventLog
from onboard.recording.journal import event_record
from onboard.recording.messages import Record, StateRecord


def record(
    text: str = "tracking error 0.40 > 0.25 m", severity: Severity = Severity.WARNING
) -> Record:
    event = Event(1.0, EventName.VIOLATION, severity, text, {"measured": 0.4})
    return event_record(event, 1.7e9)


@pytest.mark.parametrize(
    ("severity", "level"),
    [
        (Severity.CRITICAL, "CRITICAL"),
        (Severity.ERROR, "ERROR"),
        (Severity.WARNING, "WARNING"),
        (Severity.NOTICE, "INFO"),
        (Severity.INFO, "INFO"),
    ],
)
def test_an_event_is_one_line_at_its_level(
    caplog: pytest.LogCaptureFixture, severity: Severity, level: str
) -> None:
    caplog.set_level("DEBUG")
    state = StateRecord(time_s=1.7e9, phase="hold")
    EventLog().write([state, record(severity=severity)], 0.0)
    (line,) = caplog.records
    assert line.levelname == level
    assert line.getMessage() == "violation: tracking error 0.40 > 0.25 m"


def test_a_flood_is_bounded_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("DEBUG")
    log, ticks = EventLog(), 3000
    for tick in range(ticks):
        log.write([record()], tick * 0.02)
    lines = [line.getMessage() for line in caplog.records]
    written = sum(line.startswith("violation") for line in lines)
    assert written <= BURST + RATE_PER_S * ticks * 0.02 + 1
    left_out = sum(int(line.split()[0]) for line in lines if "left out here" in line)
    assert 0 <= ticks - written - left_out <= 1.0 / (RATE_PER_S * 0.02)
    caplog.clear()
    log.write([record()] * BURST, 1e6)  # a calm hour later
    assert len(caplog.records) >= BURST


def formatted(form: logging.Formatter, text: str) -> str:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(form)
    logger = logging.getLogger("onboard.recording.event_log")
    logger.addHandler(handler)
    try:
        EventLog().write([record(text)], 0.0)
    finally:
        logger.removeHandler(handler)
    return stream.getvalue()


def test_json_carries_name_and_numbers() -> None:
    said = json.loads(formatted(JsonFormatter(), "obstacle 7°"))
    assert said["event"] == "violation"
    assert said["data"] == {"measured": 0.4}
    assert said["level"] == "warning"
    assert said["message"] == "violation: obstacle 7°"


@pytest.mark.parametrize("form", [TextFormatter(), JsonFormatter()])
@pytest.mark.parametrize("control", ["\n", "\r", "\x1b[2J", "\x85", "\0", "\u2028"])
def test_a_name_from_outside_begins_no_line_of_its_own(
    form: logging.Formatter, control: str
) -> None:
    line = formatted(form, f"obstacle 1{control}CRITICAL forged")
    assert line.endswith("\n")
    assert len(line[:-1].splitlines()) == 1
    if isinstance(form, TextFormatter):
        assert control not in line[:-1]


class Stuck(io.StringIO):
    """A terminal that takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.go_on = threading.Event()

    def write(self, text: str) -> int:
        self.go_on.wait(10.0)
        return super().write(text)


def test_a_stuck_terminal_delays_no_tick_and_what_is_lost_is_counted() -> None:
    stream = Stuck()
    handler = MessageThread(stream, capacity=10)
    logger = logging.getLogger("stuck terminal")
    logger.propagate = False
    logger.addHandler(handler)
    began_s = time.monotonic()
    for number in range(1000):
        logger.warning("message %d", number)
    assert time.monotonic() - began_s < 5.0
    assert handler.dropped >= 980
    stream.go_on.set()
    while handler.dropped and "message 0" not in stream.getvalue():
        time.sleep(0.01)
    handler.flush()
    lost = handler.dropped
    logger.warning("at last")
    handler.flush()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "message 0"
    assert "at last" in lines
    assert sum(int(line.split()[0]) for line in lines if "were dropped here" in line) == lost


class Gone(io.StringIO):
    def write(self, _: str) -> int:
        raise BrokenPipeError


def test_a_terminal_that_is_gone_is_survived() -> None:
    handler = MessageThread(Gone())
    for _ in range(3):
        handler.handle(logging.LogRecord("x", logging.INFO, "x.py", 1, "hello", None, None))
    handler.flush()
    handler.handle(logging.LogRecord("x", logging.INFO, "x.py", 1, "hello", None, None))
    began_s = time.monotonic()
    handler.flush()  # its thread lives
    assert time.monotonic() - began_s < 0.9
