"""What the daemon saves while it runs: time stamps of signatures, the progress of the mission.

A thread writes: a disk may be slow, and no tick waits for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from onboard.authentication.keys import SAVE_PERIOD_S, DaemonKeys
from onboard.authentication.state_file import load_state, save_state
from onboard.files.yaml_file import FileError
from onboard.missions.progress import MissionProgress, SavedProgress

log = logging.getLogger(__name__)

PROGRESS_FILE: Final = "progress.json"
# At 3 m/s the place that was saved last is 6 m behind: less than a leg is wide.
PROGRESS_PERIOD_S: Final = 2.0


def load_progress(state: Path) -> SavedProgress:
    """Return what the last process has left; nothing where that cannot be read.

    A flight begins at its first leg then: a file of the past must not keep the daemon from flying.
    """
    try:
        return load_state(state / PROGRESS_FILE, SavedProgress)
    except FileError as error:
        log.warning("the flight before cannot be resumed: %s", error)
        return SavedProgress()


def restore(progress: MissionProgress, state: Path | None) -> None:
    """Hand on what the last process has left in a directory; None: nothing is kept."""
    if state is not None:
        progress.restore(load_progress(state))


class _ProgressFile:
    """Writes the progress when it has changed."""

    def __init__(self, progress: MissionProgress, state: Path) -> None:
        self._progress, self._path = progress, state / PROGRESS_FILE
        self._saved = progress.saved

    def save(self) -> None:
        """Replace the file, if there is anything new.

        Raises:
            FileError: it cannot be written.
        """
        saved = self._progress.saved
        if saved != self._saved:
            save_state(self._path, saved)
            self._saved = saved


async def _keep(save: Callable[[], None], period_s: float) -> None:
    while True:
        await asyncio.sleep(period_s)
        try:
            await asyncio.to_thread(save)
        except FileError as error:
            log.warning("%s", error)


@contextlib.contextmanager
def kept(keys: DaemonKeys, progress: MissionProgress, state: Path | None) -> Iterator[None]:
    """Save now and then, and at the end.

    Args:
        keys: whose time stamps are saved.
        progress: of the mission.
        state: directory for the progress; None to save none.
    """
    file = None if state is None else _ProgressFile(progress, state)
    tasks = [asyncio.create_task(_keep(keys.save, SAVE_PERIOD_S))]
    if file is not None:
        tasks.append(asyncio.create_task(_keep(file.save, PROGRESS_PERIOD_S)))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
    keys.save()
    if file is not None:
        file.save()
