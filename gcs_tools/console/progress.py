"""Progress bars with an estimate of the time left; without a terminal they show nothing."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Final, Protocol, TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from onboard.files.mission_file import Mission

Item = TypeVar("Item")

# Faster updates cannot be followed, and drawing takes time.
_PERIOD_S: Final = 0.1
# Leaves room for a text in a terminal of 80 columns.
_BAR_WIDTH: Final = 16


class Report(Protocol):
    """Takes the current activity, and the vehicle's position once it flies."""

    def __call__(self, text: str, position_ned_m: Sequence[float] | None = None) -> None:
        """Show it."""


class Bar:
    """One line that changes: activity, progress and time left.

    Args:
        progress: draws the bar; None without a terminal.
        task: its line of ``progress``.
    """

    def __init__(self, progress: Progress | None, task: TaskID) -> None:
        self._progress, self._task = progress, task
        self._due_s = -math.inf

    @property
    def due(self) -> bool:
        """Whether a new value is worth computing: a terminal shows it, and the last one is old."""
        return self._progress is not None and time.monotonic() >= self._due_s

    def show(self, done: float | None = None, text: str | None = None) -> None:
        """Show the amount done and the activity; None leaves either unchanged."""
        if self._progress is None:
            return
        self._due_s = time.monotonic() + _PERIOD_S
        description = None if text is None else escape(text)
        self._progress.update(self._task, completed=done, description=description)


@contextmanager
def progress_bar(text: str, total: float | None) -> Iterator[Bar]:
    """Show a bar on standard error while the context lasts, and remove it afterwards.

    Args:
        text: the activity.
        total: amount of work; None if unknown.
    """
    # rich's own test is not reliable: environment variables can make it write colours to a file.
    if not sys.stderr.isatty():
        yield Bar(None, TaskID(0))
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=_BAR_WIDTH),
        TaskProgressColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True, highlight=False)
    with Progress(*columns, console=console, transient=True) as progress:
        yield Bar(progress, progress.add_task(escape(text), total=total))


def tracked(items: Iterable[Item], total: int, text: str) -> Iterator[Item]:
    """Yield items, and show how many of them are done.

    Args:
        items: the work.
        total: number of items.
        text: the activity.
    """
    with progress_bar(text, total) as bar:
        for done, item in enumerate(items, start=1):
            yield item
            if bar.due:
                bar.show(done)
        bar.show(total)


class FlightProgress:
    """Progress of a flight in metres flown: up, along the legs, and down.

    Args:
        mission: that is flown.

    Attributes:
        total_m: of the whole flight.
    """

    def __init__(self, mission: Mission) -> None:
        points = [mission.start_ned_m, *(leg.end_ned_m for leg in mission.legs)]
        self._legs = [leg for leg in pairwise(points) if math.dist(*leg) > 0.0]
        self._height_m = mission.altitude_m
        self._length_m = sum(math.dist(*leg) for leg in self._legs)
        self.total_m = 2.0 * self._height_m + self._length_m
        self._leg = 0
        self._before_m = 0.0
        self._travelled_m = 0.0
        self._climbed_m = 0.0

    def travelled_m(self, position_ned_m: Sequence[float]) -> float:
        """Return the distance flown [m]; never less than before."""
        north_m, east_m, down_m = position_ned_m
        if not all(map(math.isfinite, position_ned_m)):
            return self._travelled_m
        height_m = min(max(-down_m, 0.0), self._height_m)
        self._climbed_m = max(self._climbed_m, height_m)
        # A vehicle that has descended again is landing.
        came_down_m = self._climbed_m - height_m
        landing = self._climbed_m > 0.9 * self._height_m and came_down_m > 0.2 * self._height_m
        flown_m = self._length_m + came_down_m if landing else self._along_m(north_m, east_m)
        self._travelled_m = max(self._travelled_m, self._climbed_m + flown_m)
        return self._travelled_m

    def _along_m(self, north_m: float, east_m: float) -> float:
        if not self._legs:
            return 0.0
        (start_north_m, start_east_m), (end_north_m, end_east_m) = self._legs[self._leg]
        along = end_north_m - start_north_m, end_east_m - start_east_m
        length_m = math.hypot(*along)
        flown_m = (
            (north_m - start_north_m) * along[0] + (east_m - start_east_m) * along[1]
        ) / length_m
        along_m = min(max(flown_m, 0.0), length_m)
        # The vehicle turns at the end of a leg.
        if along_m > length_m - 0.5 and self._leg + 1 < len(self._legs):
            self._leg += 1
            self._before_m += length_m
            return self._before_m
        return self._before_m + along_m
