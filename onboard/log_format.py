"""Formats the daemon's own messages: as lines for people, or as JSON for log collectors."""

from __future__ import annotations

import json
import logging
import sys
from typing import Final, Literal

from onboard.message_thread import MessageThread

LogFormat = Literal["text", "json"]

# Text from outside, such as an obstacle's id, must not begin a line of its own.
_CONTROL: Final = {
    code: f"\\u{code:04x}" for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)
}


class TextFormatter(logging.Formatter):
    """Formats one line for people, with a traceback below it if there is one."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  as inherited
        """Return the line, its control characters escaped."""
        return super().formatMessage(record).translate(_CONTROL)


class JsonFormatter(logging.Formatter):
    """Formats one JSON object per line."""

    def format(self, record: logging.LogRecord) -> str:
        """Return ``time_unix_s``, ``level``, ``logger``, ``message``.

        Of an event also ``event``, its name, and ``data``; ``exception`` if there is one.
        """
        line = {
            "time_unix_s": round(record.created, 6),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        for name in ("event", "data"):
            if hasattr(record, name):
                line[name] = getattr(record, name)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)


def configure_logging(level: str, form: LogFormat) -> None:
    """Send messages of ``level`` and above to standard error without blocking on it."""
    handler = MessageThread(sys.stderr)
    handler.setFormatter(JsonFormatter() if form == "json" else TextFormatter())
    logging.basicConfig(level=level.upper(), handlers=[handler])
