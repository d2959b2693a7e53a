"""Names and sizes of the files of one log: a full file is followed by the next one."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import BinaryIO, Final, cast

from onboard.recording.directory_quota import DirectoryQuota

# A part holds some 20 minutes, and the index of an open part stays in memory: about 1 MB for each
# 20 MB of log.  All parts together are what a log may take of the disk.
PART_BYTES: Final = 32 * 1024 * 1024
PARTS_KEPT: Final = 32


class LogRotation:
    """Opens the parts of one log and removes the oldest of them beyond those to keep.

    Args:
        path: of the first part; ``flight.mcap`` is followed by ``flight.2.mcap``.
        part_bytes: a part is full at this size.
        kept: how many parts may exist at once, at least one.
        overwrite: whether to replace an existing file; a simulation may, a flight must not.
        quota: of the directory, in which each part makes room for itself; None for no quota.
    """

    def __init__(
        self,
        path: Path,
        part_bytes: int = PART_BYTES,
        kept: int = PARTS_KEPT,
        *,
        overwrite: bool = False,
        quota: DirectoryQuota | None = None,
    ) -> None:
        self.part_bytes = part_bytes
        self._path = path
        self._kept = kept
        self._overwrite = overwrite
        self._quota = quota
        self._number = 0
        self._own: deque[Path] = deque()

    def open_next(self) -> BinaryIO:
        """Open the next part for writing; afterwards there is room for it.

        A number whose file exists, left by another log, is passed over.  The first part has no
        other name to take.

        Raises:
            FileExistsError: the first part exists and must not be overwritten.
            OSError: the part cannot be opened, or the oldest part cannot be removed.
        """
        if self._quota is not None:
            self._quota.make_room(self.part_bytes)
        while True:
            self._number += 1
            path = self._part(self._number)
            try:
                file = self._open(path)
            except FileExistsError:
                if self._number == 1:
                    raise
                continue
            self._own.append(path)
            while len(self._own) > self._kept:
                self._own.popleft().unlink(missing_ok=True)
            return file

    def _open(self, path: Path) -> BinaryIO:
        # A device such as /dev/null holds no log that could be destroyed.
        mode = "wb" if self._overwrite or path.is_char_device() else "xb"
        return cast("BinaryIO", path.open(mode))

    def _part(self, number: int) -> Path:
        if number == 1:
            return self._path
        return self._path.with_suffix(f".{number}{self._path.suffix}")
