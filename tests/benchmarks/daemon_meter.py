"""The daemon with a meter in it: ``python -m tests.benchmarks.daemon_meter --config FILE``.

It runs `onboard.__main__` as it is, and notes processor time, memory, when it was ready, and how
long a detection takes from its arrival in Zenoh's thread to the setpoint that answers it:

* in cruise and avoidance, the setpoint of the tick that has read the frame;
* in dense flight, the first setpoint of the first plan that was begun with the frame in it.

The figures are written when the daemon ends, to the file that `OUTPUT` names.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from onboard.__main__ import main as run_daemon
from onboard.autonomy import Autonomy
from onboard.guidance.dense.sliced_planning import SlicedPlanning
from onboard.guidance.dense.way_to_rest import WayToRest
from onboard.guidance.phases import Phase
from onboard.service_manager import ServiceManager

# Environment of the process: where the figures go, and when it was started (monotonic clock).
OUTPUT: Final = "CLEARWAY_METER_OUTPUT"
STARTED: Final = "CLEARWAY_METER_STARTED_S"
ALONG_LEG: Final = (Phase.CRUISE, Phase.AVOID)


class DaemonMeter:
    """Notes what the daemon does, by `hooks` in its classes.

    Args:
        clock: elapsed seconds.
        processor_clock: seconds of processor time of this process.

    Attributes:
        wall_s, processor_s: by phase, from tick to tick.
        latencies_s: from a detection to its setpoint, by phase.
        ready_s: on the clock, when the daemon was ready; None before.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        processor_clock: Callable[[], float] = time.process_time,
    ) -> None:
        self._clock, self._processor_clock = clock, processor_clock
        self.wall_s: dict[str, float] = defaultdict(float)
        self.processor_s: dict[str, float] = defaultdict(float)
        self.latencies_s: dict[str, list[float]] = defaultdict(list)
        self.ready_s: float | None = None
        self._last: tuple[float, float] | None = None
        self._phase = Phase.STANDBY
        self._arrived: dict[int, float] = {}
        self._unread: list[float] = []
        self._unplanned: list[float] = []
        self._planned: list[float] = []
        self._answered: list[float] = []

    def arrives(self, payload: bytes) -> None:
        """Note a message in the thread that has received it."""
        self._arrived[id(payload)] = self._clock()

    def taken(self, payload: bytes) -> None:
        """Note that the service latches a detection."""
        self._unread.append(self._arrived.pop(id(payload), self._clock()))

    def tick_begins(self) -> None:
        """Note that the service is about to decide; all that it has latched is read now."""
        now = self._clock(), self._processor_clock()
        if self._last is not None:
            self.wall_s[self._phase] += now[0] - self._last[0]
            self.processor_s[self._phase] += now[1] - self._last[1]
        self._last = now
        self._unplanned += self._unread

    def plan_begins(self) -> None:
        """Note that a plan of dense flight begins, with every frame read so far in it."""
        self._planned, self._unplanned = self._planned + self._unplanned, []

    def node_passed(self) -> None:
        """Note that what the newest plan has decided takes over."""
        self._answered, self._planned = self._planned, []

    def sends(self, phase: Phase, *, setpoint: bool) -> None:
        """Note that the bytes of a tick go to the link."""
        now_s, self._phase = self._clock(), phase
        if setpoint and phase in ALONG_LEG:
            self.latencies_s[phase] += [now_s - arrived_s for arrived_s in self._unread]
        if setpoint and phase is Phase.THREAD:
            self.latencies_s[phase] += [now_s - arrived_s for arrived_s in self._answered]
        if phase is not Phase.THREAD:
            self._unplanned, self._planned = [], []
        self._unread, self._answered = [], []

    def document(self, started_s: float) -> dict[str, Any]:
        """Return the figures, with the names of phases as keys."""
        return {
            "start_s": None if self.ready_s is None else self.ready_s - started_s,
            "peak_mb": _peak_mb(),
            "wall_s": dict(self.wall_s),
            "processor_s": dict(self.processor_s),
            "latencies_s": dict(self.latencies_s),
        }

    def note_ready(self) -> None:
        """Note that the daemon serves."""
        self.ready_s = self._clock()


def _peak_mb() -> float:
    """Return the most memory that this process has had, in megabytes."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = (each for each in status.splitlines() if each.startswith("VmHWM:"))
    return int(line.split()[1]) / 1e3


def hooks(meter: DaemonMeter) -> list[tuple[type, str, Callable[..., Any]]]:
    """Return which methods of which classes give way to which."""
    take, tick, send = Autonomy.receive_detection, Autonomy.tick, Autonomy.mavlink_to_send
    hand_over = asyncio.BaseEventLoop.call_soon_threadsafe
    begin, passing, ready = SlicedPlanning._begin_plan, WayToRest.pass_nodes, ServiceManager.ready

    def call_soon_threadsafe(loop: Any, callback: Any, *arguments: Any, **options: Any) -> Any:
        # Zenoh's thread hands a message over to the event loop.
        if arguments and isinstance(arguments[0], bytes):
            meter.arrives(arguments[0])
        return hand_over(loop, callback, *arguments, **options)

    def receive_detection(self: Autonomy, payload: bytes, now_s: float) -> None:
        meter.taken(payload)
        take(self, payload, now_s)

    def ticking(self: Autonomy, now_s: float) -> None:
        meter.tick_begins()
        tick(self, now_s)

    def mavlink_to_send(self: Autonomy) -> bytes:
        data = send(self)
        meter.sends(self.navigator.phase, setpoint=bool(data))
        return data

    def begin_plan(self: SlicedPlanning, *arguments: Any) -> None:
        meter.plan_begins()
        begin(self, *arguments)

    def pass_nodes(self: WayToRest, now_s: float) -> bool:
        passed = passing(self, now_s)
        if passed:
            meter.node_passed()
        return passed

    def readiness(self: ServiceManager) -> None:
        meter.note_ready()
        ready(self)

    return [
        (asyncio.BaseEventLoop, "call_soon_threadsafe", call_soon_threadsafe),
        (Autonomy, "receive_detection", receive_detection),
        (Autonomy, "tick", ticking),
        (Autonomy, "mavlink_to_send", mavlink_to_send),
        (SlicedPlanning, "_begin_plan", begin_plan),
        (WayToRest, "pass_nodes", pass_nodes),
        (ServiceManager, "ready", readiness),
    ]


def main() -> int:
    """Run the daemon; write the figures when it has ended."""
    meter = DaemonMeter()
    for owner, name, hook in hooks(meter):
        setattr(owner, name, hook)
    code = run_daemon()
    figures = meter.document(float(os.environ[STARTED]))
    Path(os.environ[OUTPUT]).write_text(json.dumps(figures), encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(main())
