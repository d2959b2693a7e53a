"""The daemon's flight recorder: a log under a free name, written in a thread of its own."""

from __future__ import annotations

import contextlib
import errno
import logging
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, Self

from onboard.recording.flight_log import Direction, FlightLog
from onboard.recording.messages import Record
from onboard.recording.rotation import LogRotation
from onboard.recording.writer_thread import LogThread

log = logging.getLogger(__name__)

_NAMES_MAX: Final = 10_000


class LogFileError(RuntimeError):
    """A flight log that cannot be begun; the message names the file."""


class FlightRecorder:
    """Writes the flight log without delaying a tick.

    Args:
        path: of the log; where it exists, the next free name is taken: ``flight-2.mcap`` after
            ``flight.mcap``.
        metadata: what flies.

    Attributes:
        path: the name that was free.

    Raises:
        LogFileError: the file or its directory cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        with contextlib.ExitStack() as stack:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                # Parts of another flight may have names like ours.
                self.path, self._log = _open_free(path, {**metadata, "log_id": uuid.uuid4().hex})
            except OSError as error:
                reason = error.strerror or error
                raise LogFileError(f"{path}: the flight log cannot be written: {reason}") from error
            stack.enter_context(self._log)
            # Entered last, so that it has written everything before the file is closed.
            self._thread = stack.enter_context(LogThread())
            self._open = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._open.close()
        except OSError as error:
            # Reported already, if a full disk has ended the log in flight.
            if self.failure is None:
                log.error("the flight log ends here: %s", error)  # noqa: TRY400  a full disk is not a defect

    @property
    def failure(self) -> str | None:
        """Why the log has ended; None while it is written."""
        return self._thread.failure

    def write(self, records: list[Record]) -> None:
        """Log the records of a tick."""
        self._thread.submit(lambda: self._log.write(records))

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Log bytes of the MAVLink link."""
        self._thread.submit(lambda: self._log.write_mavlink(direction, time_unix_s, data))


def _open_free(path: Path, metadata: Mapping[str, str]) -> tuple[Path, FlightLog]:
    """Create the log under the first free name.

    Raises:
        OSError: the file cannot be created.
    """
    for candidate in _names(path):
        with contextlib.suppress(FileExistsError):
            return candidate, FlightLog(LogRotation(candidate), metadata)
    raise FileExistsError(errno.EEXIST, f"{_NAMES_MAX} names like it are taken")


def _names(path: Path) -> Iterator[Path]:
    yield path
    for number in range(2, _NAMES_MAX + 1):
        yield path.with_stem(f"{path.stem}-{number}")
