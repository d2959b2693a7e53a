"""Which modules a detection visits on its way from the Zenoh payload to the setpoint's bytes.

A virtual flight is traced up to its first avoidance.  On the way, the detection becomes one thing
after another: a frame, an obstacle, a certified plan, a setpoint, bytes.  A module is *visited* if
it makes such a thing for the first time, or calls the maker and takes the thing from it: these are
the files to read in order to follow a detection.  Modules farther out on the call stack dispatch
only (`Walk.dispatching`).  Not visited are modules that only look at it (the monitors), modules
that were called and have returned by then (the QP's matrices, the trajectory's polynomials), and
the rooms of formats and mathematics that everything calls (`BASE_ROOMS`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Final

from gcs_tools.scenario import load_scenario
from sitl.virtual.simulation import SimulatedFlight, Simulation
from tests.tools.structure import ROOT, room_of

# What a detection becomes, in order: the name, the type of what is returned, and the function that
# returns it where others return the same type without a detection.
STATIONS: Final = (
    ("frame", "DetectionFrame", None),
    ("obstacle", "Obstacle", None),
    ("certificate", "Certificate", "certify_avoidance"),
    ("plan", "Plan", None),
    ("setpoint", "Setpoint", None),
    ("bytes", "bytes", "bytes_to_send"),
)
# The simulation stands in for the daemon, which hands over Zenoh's payload and sends the bytes.
DAEMON: Final = "onboard.bus"
# Formats and mathematics that are independent of detections.
BASE_ROOMS: Final = ("onboard.files", "onboard.geometry", "onboard.motion")
_FLIGHT_MAX_S: Final = 60.0


@dataclass
class Walk:
    """The walk of one detection.

    Attributes:
        stations: the modules on the call stack, the outermost first, when each thing was made.
        executed: every module of the daemon of which any function ran in the ticks of the stations.
    """

    stations: dict[str, list[str]] = field(default_factory=dict)
    executed: set[str] = field(default_factory=set)

    @property
    def visited(self) -> list[str]:
        """The makers of all stations and their callers, in the order in which they are visited."""
        inside = [module for modules in self._counted for module in modules[-2:]]
        return list(dict.fromkeys([DAEMON, *inside]))

    @property
    def dispatching(self) -> list[str]:
        """The other modules on the call stacks: they pass the call on and do not see the thing."""
        outside = [module for modules in self._counted for module in modules[:-2]]
        return [module for module in dict.fromkeys(outside) if module not in self.visited]

    @property
    def _counted(self) -> list[list[str]]:
        return [
            [module for module in modules if room_of(module) not in BASE_ROOMS]
            for modules in self.stations.values()
        ]

    @property
    def lines(self) -> int:
        """The lines of all modules that are visited."""
        paths = [ROOT.joinpath(*module.split(".")).with_suffix(".py") for module in self.visited]
        return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)

    @property
    def complete(self) -> bool:
        """Whether the detection has become a setpoint's bytes."""
        return len(self.stations) == len(STATIONS)


class _Tracer:
    """Notes the call stack when the next station of the walk is reached."""

    def __init__(self) -> None:
        self.walk = Walk()
        self._ran: set[str] = set()
        self._names: dict[str, str | None] = {}

    def begin_tick(self) -> None:
        self._ran = set()

    def end_tick(self, stations_before: int) -> None:
        if len(self.walk.stations) > stations_before:
            self.walk.executed |= self._ran

    def traced(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a call of the service that is traced while it lasts."""

        def wrapper(*arguments: Any) -> Any:
            sys.setprofile(self._trace)
            try:
                return call(*arguments)
            finally:
                sys.setprofile(None)

        return wrapper

    def _trace(self, frame: FrameType, event: str, returned: Any) -> None:
        """Take an event of `sys.setprofile`."""
        module = self._module(frame)
        if module is None:
            return
        if event == "call":
            self._ran.add(module)
        elif event == "return" and not self.walk.complete:
            made, type_name, function = STATIONS[len(self.walk.stations)]
            is_type = type(returned).__name__ == type_name and self._carries(returned)
            if is_type and function in {None, frame.f_code.co_name}:
                self.walk.stations[made] = self._stack(frame)

    @staticmethod
    def _carries(returned: Any) -> bool:
        """Tell whether a frame has obstacles, or there are any bytes."""
        return bool(getattr(returned, "obstacles", returned))

    def _stack(self, frame: FrameType | None) -> list[str]:
        found: list[str] = []
        while frame is not None:
            module = self._module(frame)
            if module is not None and module not in found:
                found.append(module)
            frame = frame.f_back
        return found[::-1]

    def _module(self, frame: FrameType) -> str | None:
        """Return the daemon's module that a call belongs to; None for all other code."""
        file = frame.f_code.co_filename
        if file not in self._names:
            inside = file.startswith(str(ROOT / "onboard"))
            path = Path(file).relative_to(ROOT) if inside else None
            self._names[file] = None if path is None else ".".join(path.with_suffix("").parts)
        return self._names[file]


def walk_of_a_detection() -> Walk:
    """Fly the paper's example up to its first avoidance and return the walk of a detection.

    Raises:
        RuntimeError: the detection did not become a setpoint.
    """
    scenario = load_scenario(ROOT / "config" / "paper.yaml")
    simulation = Simulation(
        SimulatedFlight(
            contract=scenario.contract,
            mission=scenario.mission,
            sitl=scenario.sitl_config(),
            obstacles=scenario.obstacles,
        )
    )
    tracer = _Tracer()
    service = simulation.autonomy
    for name in ("receive_detection", "tick", "mavlink_to_send"):
        setattr(service, name, tracer.traced(getattr(service, name)))
    while not tracer.walk.complete and simulation.now_s < _FLIGHT_MAX_S:
        before = len(tracer.walk.stations)
        tracer.begin_tick()
        simulation.advance()
        tracer.end_tick(before)
    if not tracer.walk.complete:
        raise RuntimeError(f"the walk ends at {list(tracer.walk.stations)}, expected {STATIONS}")
    return tracer.walk
