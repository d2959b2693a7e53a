"""The daemon's flight recorder: a log under a free name, written in a thread of its own."""

from __future__ import annotations

import contextlib
import errno
import logging
import uuid
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, Self

from onboard.recording.directory_quota import DirectoryQuota
from onboard.recording.flight_log import Direction, FlightLog
from onboard.recording.messages import Record, StateRecord
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
        next_path: names the log that begins when the vehicle has disarmed, so that each flight has
            its own; None writes one log for all of them.
        quota: of the directory; None for no quota.

    Attributes:
        path: the name that was free.

    Raises:
        LogFileError: the file or its directory cannot be written.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        next_path: Callable[[], Path] | None = None,
        quota: DirectoryQuota | None = None,
    ) -> None:
        self._metadata, self._quota, self._next_path = dict(metadata), quota, next_path
        self._armed = False
        with contextlib.ExitStack() as stack:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                self.path, self._log = self._open_free(path)
            except OSError as error:
                reason = error.strerror or error
                raise LogFileError(f"{path}: the flight log cannot be written: {reason}") from error
            stack.callback(self._close)
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
        """Log the records of a tick; after one that says disarmed, the next log begins."""
        self._thread.submit(lambda: self._log.write(records))
        for record in records:
            if isinstance(record, StateRecord) and record.armed is not None:
                ended, self._armed = self._armed and not record.armed, record.armed
                if ended and self._next_path is not None:
                    self._thread.submit(partial(self._begin, self._next_path()))

    def write_mavlink(self, direction: Direction, time_unix_s: float, data: bytes) -> None:
        """Log bytes of the MAVLink link."""
        self._thread.submit(lambda: self._log.write_mavlink(direction, time_unix_s, data))

    def _close(self) -> None:
        self._log.close()

    def _begin(self, path: Path) -> None:
        """Go on in the next log; runs in the thread that writes.

        Raises:
            OSError: it cannot be written.
        """
        self.path, successor = self._open_free(path)
        finished, self._log = self._log, successor
        finished.go_on_in(successor)
        log.info("the next flight is logged in %s", self.path)

    def _open_free(self, path: Path) -> tuple[Path, FlightLog]:
        """Create the log under the first free name.

        Raises:
            OSError: the file cannot be created.
        """
        # Parts of another flight may have names like ours.
        metadata = {**self._metadata, "log_id": uuid.uuid4().hex}
        for candidate in _names(path):
            with contextlib.suppress(FileExistsError):
                return candidate, FlightLog(LogRotation(candidate, quota=self._quota), metadata)
        raise FileExistsError(errno.EEXIST, f"{_NAMES_MAX} names like it are taken")


class LogPlace(NamedTuple):
    """Where flights are logged; see `FlightRecorder`.

    Attributes:
        path: of the first log.
        next_path: names the log of the next flight; None for one log of all flights.
        quota: of the directory; None for no quota.
    """

    path: Path
    next_path: Callable[[], Path] | None = None
    quota: DirectoryQuota | None = None

    def recorder(self, metadata: Mapping[str, str]) -> FlightRecorder:
        """Begin the first log.

        Raises:
            LogFileError: the file or its directory cannot be written.
        """
        return FlightRecorder(self.path, metadata, self.next_path, self.quota)


def _names(path: Path) -> Iterator[Path]:
    yield path
    for number in range(2, _NAMES_MAX + 1):
        yield path.with_stem(f"{path.stem}-{number}")
