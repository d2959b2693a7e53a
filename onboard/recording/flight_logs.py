"""The logs of one flight, written in a thread of their own; an earlier flight's stay untouched."""

from __future__ import annotations

import contextlib
import errno
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, Self

from onboard.recording.flight_log import Direction, FlightLog
from onboard.recording.record import Record
from onboard.recording.rotation import LogParts
from onboard.recording.tlog import TelemetryLog
from onboard.recording.writer_thread import LogThread

log = logging.getLogger(__name__)

_NAMES_MAX: Final = 10_000


class LogFileError(RuntimeError):
    """A flight log that cannot be begun; the message names the file."""


class Logs:
    """The flight log and, beside it, the MAVLink traffic as ``.tlog``; neither delays a tick.

    Args:
        path: of the flight log; where it or its ``.tlog`` exists, the next free name is taken:
            ``flight-2.mcap`` after ``flight.mcap``.
        metadata: what flew.

    Attributes:
        path: the flight log's name at last.

    Raises:
        LogFileError: a file or its directory cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        with contextlib.ExitStack() as stack:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                self.path, self._flight, self._telemetry = _open_free(path, metadata)
            except OSError as error:
                reason = error.strerror or error
                raise LogFileError(f"{path}: the flight log cannot be written: {reason}") from error
            stack.enter_context(self._flight)
            stack.enter_context(self._telemetry)
            # Entered last, so that it has written everything before the files are closed.
            self._thread = stack.enter_context(LogThread())
            self._open = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._open.close()
        except OSError as error:  # said before where a full disk has ended the logs in flight
            if self.failure is None:
                log.error("the flight log ends here: %s", error)  # noqa: TRY400  a full disk is not a defect

    @property
    def failure(self) -> str | None:
        """Why the logs have ended; None as long as they go on."""
        return self._thread.failure

    def write(self, records: list[Record]) -> None:
        """Log what a tick left behind."""
        self._thread.submit(lambda: self._flight.write(records))

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Log bytes of the MAVLink link."""

        def write() -> None:
            self._flight.write_mavlink(direction, time_unix_s, data)
            self._telemetry.write(direction, time_unix_s, data)

        self._thread.submit(write)


def _open_free(path: Path, metadata: Mapping[str, str]) -> tuple[Path, FlightLog, TelemetryLog]:
    """Create both files under the first name that neither has.

    Raises:
        OSError: a file cannot be created.
    """
    for candidate in _names(path):
        try:
            telemetry = TelemetryLog(LogParts(candidate.with_suffix(".tlog")))
        except FileExistsError:
            continue
        try:
            return candidate, FlightLog(LogParts(candidate), metadata), telemetry
        except OSError as error:
            telemetry.close()
            candidate.with_suffix(".tlog").unlink()  # ours, and empty
            if not isinstance(error, FileExistsError):
                raise
    raise FileExistsError(errno.EEXIST, f"{_NAMES_MAX} names like it are taken")


def _names(path: Path) -> Iterator[Path]:
    yield path
    for number in range(2, _NAMES_MAX + 1):
        yield path.with_stem(f"{path.stem}-{number}")
