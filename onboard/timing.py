"""The daemon's clock: time since its start, and how it relates to Unix time.

A companion computer without a battery clock starts in the past and is set later, by GNSS or NTP.
Time since the start never jumps; what jumps is the Unix time of its zero, and that is followed only
while the vehicle is disarmed: in flight, frames stamped before and after a step could not be told
apart.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from onboard.events import Event, EventData, EventName, Severity

log = logging.getLogger(__name__)

# The lowest real-time priority: ahead of every ordinary process, behind the kernel's own threads.
REALTIME_PRIORITY: Final = 1
# Less than the time in which a frame's stamp and the vehicle's pose have to agree.  A slow
# adjustment by NTP moves both clocks alike: not a step.
STEP_MIN_S: Final = 0.01
# New threads are looked for as often as this, in looks: every second.
_LIST_EVERY: Final = 50
# A process that was interrupted between two readings cannot compare them.
_READING_MAX_S: Final = 0.002


def elapsed_s() -> float:
    """Return a time that is never set and, where the kernel can tell, counts suspension too.

    Telemetry received before the computer slept must not look fresh afterwards.
    """
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


@dataclass(frozen=True)
class ClockStep:
    """The system's clock was set.

    Attributes:
        step_s: by how much, forward if positive.
        followed: whether stamps are read by the new time from now on.
    """

    step_s: float
    followed: bool

    def event(self, now_s: float) -> Event:
        """Return what the operator should know."""
        direction = "forward" if self.step_s > 0.0 else "back"
        text = f"system clock set {direction} by {abs(self.step_s):.2f} s"
        if self.followed:
            severity, rest = Severity.NOTICE, "stamps are read by the new time"
        else:
            severity, rest = Severity.WARNING, "in flight: stamps are read by the old time"
        data: EventData = {"step_s": round(self.step_s, 6), "followed": self.followed}
        return Event(now_s, EventName.CLOCK_STEP, severity, f"{text}; {rest}", data)


class Clock:
    """Time since the start that no clock adjustment can move, and the Unix time of that start.

    Args:
        elapsed_s: reads a clock that is never set.
        unix_s: reads the system's clock.

    Attributes:
        epoch_unix_s: Unix time at zero; `follow` may change it.
    """

    def __init__(
        self,
        elapsed_s: Callable[[], float] = elapsed_s,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self._elapsed_s, self._unix_s = elapsed_s, unix_s
        self._start_s = elapsed_s()
        self.epoch_unix_s = unix_s()
        self._reported_s = 0.0

    def now_s(self) -> float:
        """Return the time since the start."""
        return self._elapsed_s() - self._start_s

    def follow(self, accept: Callable[[float], bool]) -> ClockStep | None:
        """Detect a step of the system's clock, and follow it if ``accept`` agrees.

        Args:
            accept: takes the Unix time of zero by the clock as it is now; refuses it in flight.

        Returns:
            What has happened since the last call; each step is reported once, and again when it is
            followed at last.
        """
        before_s = self.now_s()
        unix_s = self._unix_s()
        after_s = self.now_s()
        if after_s - before_s > _READING_MAX_S:
            return None
        step_s = unix_s - after_s - self.epoch_unix_s
        if abs(step_s) < STEP_MIN_S:
            self._reported_s = 0.0
            return None
        if accept(self.epoch_unix_s + step_s):
            self.epoch_unix_s += step_s
            self._reported_s = 0.0
            return ClockStep(step_s, followed=True)
        if abs(step_s - self._reported_s) < STEP_MIN_S:
            return None
        self._reported_s = step_s
        return ClockStep(step_s, followed=False)


class ProcessorTimes:
    """How long this process ran, and waited while others ran, from one look to the next.

    The main thread may have to wait for another thread of ours that holds the interpreter's lock
    and waits itself: what counts is the longest wait of any.

    Args:
        tasks: where the kernel keeps the statistics of each thread; none are known where it is
            missing (https://docs.kernel.org/scheduler/sched-stats.html#proc-pid-schedstat).
    """

    def __init__(self, tasks: Path = Path("/proc/self/task")) -> None:
        self._tasks, self._looks = tasks, 0
        self._files: dict[str, int] = {}
        self._before: dict[str, tuple[int, int]] = {}

    def since_last(self) -> tuple[float, float]:
        """Return how long the main thread ran, and the longest wait, in seconds.

        Both are 0 at the first look.
        """
        if self._looks % _LIST_EVERY == 0:
            self._list()
        self._looks += 1
        ran_ns = waited_ns = 0
        main = str(os.getpid())
        for name, file in list(self._files.items()):
            try:
                fields = os.pread(file, 128, 0).split()
                now_ns = int(fields[0]), int(fields[1])
            except (OSError, IndexError, ValueError):  # the thread has ended
                os.close(self._files.pop(name))
                self._before.pop(name, None)
                continue
            before_ns = self._before.get(name, now_ns)
            self._before[name] = now_ns
            waited_ns = max(waited_ns, now_ns[1] - before_ns[1])
            if name == main:
                ran_ns = now_ns[0] - before_ns[0]
        return ran_ns / 1e9, waited_ns / 1e9

    def _list(self) -> None:
        """Open the statistics of threads that have begun since the last time."""
        with contextlib.suppress(OSError):
            for task in self._tasks.iterdir():
                if task.name not in self._files:
                    path = task / "schedstat"
                    self._files[task.name] = os.open(path, os.O_RDONLY | os.O_CLOEXEC)


def request_realtime_priority() -> None:
    """Ask Linux to run this process, with all threads of Python, before ordinary ones.

    A tick that waits for another process is late, and a late tick ends in a hover.  Threads that
    are started later inherit the priority.  Those that run already must have it, too: the tick
    waits for an ordinary one that holds the interpreter's lock.
    """
    if not hasattr(os, "sched_setscheduler"):
        return
    try:
        for thread in threading.enumerate():
            # One that has ended since it was listed needs none.
            with contextlib.suppress(ProcessLookupError):
                parameters = os.sched_param(REALTIME_PRIORITY)
                os.sched_setscheduler(thread.native_id or 0, os.SCHED_RR, parameters)
    except PermissionError:
        log.info("cannot set real-time priority (needs CAP_SYS_NICE)")
