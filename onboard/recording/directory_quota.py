"""Keeps the flights of a directory within a quota, by removing the oldest files."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final, NamedTuple

log = logging.getLogger(__name__)

# What the daemon names its logs; other files of the directory are not its to remove.
PATTERN: Final = "flight-*.mcap"
MEGABYTE: Final = 1_000_000


class _File(NamedTuple):
    modified_ns: int
    path: Path
    size_bytes: int


class DirectoryQuota:
    """How many bytes the logs of one directory may take.

    Args:
        directory: of the logs.
        limit_bytes: of all of them together.
    """

    def __init__(self, directory: Path, limit_bytes: int) -> None:
        self._directory = directory
        self._limit_bytes = limit_bytes

    def make_room(self, wanted_bytes: int) -> None:
        """Remove the oldest logs until so many bytes more fit into the quota.

        A log that cannot be removed stays: the flight goes on, and a full disk is reported by
        the log that meets it.
        """
        files = sorted(self._logs())
        excess_bytes = sum(each.size_bytes for each in files) + wanted_bytes - self._limit_bytes
        for each in files:
            if excess_bytes <= 0:
                return
            try:
                each.path.unlink(missing_ok=True)
            except OSError as error:
                log.warning("%s: cannot be removed for the quota: %s", each.path, error.strerror)
                continue
            log.info("%s: removed for the quota of logs", each.path)
            excess_bytes -= each.size_bytes

    def _logs(self) -> list[_File]:
        found = []
        for path in self._directory.glob(PATTERN):
            try:
                status = path.lstat()
            except OSError:  # removed meanwhile
                continue
            if path.is_file() and not path.is_symlink():
                found.append(_File(status.st_mtime_ns, path, status.st_size))
        return found
