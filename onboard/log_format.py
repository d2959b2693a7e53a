"""How the daemon's own messages look: lines for people, or JSON for programs that collect them."""

from __future__ import annotations

import json
import logging
import sys
from typing import Final, Literal

from onboard.message_thread import MessageThread

LogFormat = Literal["text", "json"]

# What comes from outside, such as an obstacle's id, must not begin a line of its own.
_CONTROL: Final = {
    code: f"\\u{code:04x}" for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)
}


class TextFormatter(logging.Formatter):
    """One line for people; a traceback, if there is one, below it."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  as inherited
        """Return the line, its control characters escaped."""
        return super().formatMessage(record).translate(_CONTROL)


class JsonFormatter(logging.Formatter):
    """One JSON object a line."""

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
    """Send messages from ``level`` on to standard error, without waiting for it."""
    handler = MessageThread(sys.stderr)
    handler.setFormatter(JsonFormatter() if form == "json" else TextFormatter())
    logging.basicConfig(level=level.upper(), handlers=[handler])
