"""Writes every event as a line of the daemon's own log, which journald keeps."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from typing import Final

from onboard.events import Severity
from onboard.recording.messages import EventRecord, Record

log = logging.getLogger(__name__)

# One event per tick for a second, then five a second: a flood must not fill the disk.
BURST: Final = 50
RATE_PER_S: Final = 5.0

_LEVELS: Final = {
    Severity.CRITICAL: logging.CRITICAL,
    Severity.ERROR: logging.ERROR,
    Severity.WARNING: logging.WARNING,
    Severity.NOTICE: logging.INFO,
    Severity.INFO: logging.INFO,
}


class EventLog:
    """Writes the events among a tick's records to the log; counts those beyond the allowed rate."""

    def __init__(self) -> None:
        self._allowance = float(BURST)
        self._allowed_s = -math.inf
        self._left_out = 0

    def write(self, records: Iterable[Record], now_s: float) -> None:
        """Write the events of the tick at ``now_s``."""
        if math.isfinite(self._allowed_s):
            earned = (now_s - self._allowed_s) * RATE_PER_S
            self._allowance = min(self._allowance + earned, float(BURST))
        self._allowed_s = now_s
        for record in records:
            if isinstance(record, EventRecord):
                self._write(record)

    def _write(self, event: EventRecord) -> None:
        if self._allowance < 1.0:
            self._left_out += 1
            return
        self._allowance -= 1.0
        if self._left_out:
            log.warning("%d events left out here; the flight log has them", self._left_out)
            self._left_out = 0
        level = _LEVELS[Severity[event.severity.upper()]]
        fields = {"event": event.name, "data": event.data}
        log.log(level, "%s: %s", event.name, event.text, extra=fields)
