"""The daemon's messages as JSON lines."""

from __future__ import annotations

import json
import logging

from onboard.log_format import JsonFormatter


def test_a_message_is_one_json_object_a_line() -> None:
    record = logging.LogRecord("onboard.x", logging.WARNING, "x.py", 1, "tick %d ms", (61,), None)
    line = JsonFormatter().format(record)
    said = json.loads(line)
    assert "\n" not in line
    assert (said["level"], said["logger"], said["message"]) == (
        "warning", "onboard.x", "tick 61 ms",
    )  # fmt: skip
    assert said["time_unix_s"] > 1e9
    assert "exception" not in said


def test_an_exception_stays_on_its_line() -> None:
    error = ValueError("broken\nin two")
    caught = (ValueError, error, None)
    line = JsonFormatter().format(
        logging.LogRecord("x", logging.ERROR, "x.py", 1, "failed", None, caught)
    )
    assert "\n" not in line
    assert "ValueError: broken" in json.loads(line)["exception"]
