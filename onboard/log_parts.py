"""Names of a log's parts: a log that grows too large goes on in the next file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

# A part holds hours; together they are what a log may take of the disk.
PART_BYTES: Final = 64 * 1024 * 1024
PARTS_KEPT: Final = 16


class LogParts:
    """Numbers the parts of one log and removes the oldest beyond those to keep.

    Args:
        path: of the first part; ``flight.mcap`` is followed by ``flight.2.mcap``.
        part_bytes: a part is full at this size.
        kept: how many parts may exist at once, at least one.
    """

    def __init__(self, path: Path, part_bytes: int = PART_BYTES, kept: int = PARTS_KEPT) -> None:
        self.part_bytes = part_bytes
        self._path = path
        self._kept = kept
        self._number = 0

    def next(self) -> Path:
        """Return the path of the next part; afterwards there is room for it.

        Raises:
            OSError: the oldest part cannot be removed.
        """
        self._number += 1
        if self._number > self._kept:
            self._part(self._number - self._kept).unlink(missing_ok=True)
        return self._part(self._number)

    def _part(self, number: int) -> Path:
        if number == 1:
            return self._path
        return self._path.with_suffix(f".{number}{self._path.suffix}")
