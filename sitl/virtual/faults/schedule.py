"""When the faults of one flight are present.

The window of a fault counts from the start of the simulation or from the n-th time that the onboard
service enters a phase, so that faults can be put exactly on the transitions of its automaton.
"""

from __future__ import annotations

import random
from collections.abc import Mapping

from sitl.virtual.faults.schema import Fault, FaultKind


class FaultSchedule:
    """State which faults of a flight are present now.

    Args:
        faults: as the scenario states them; of two faults of one kind only the later one in the
            list is present while both windows are open.
        seed: of every random choice.

    Attributes:
        faults, seed: as given.
        now_s: time of the last `advance`.
        chance: random numbers that all appliers share.
    """

    def __init__(self, faults: tuple[Fault, ...], seed: int) -> None:
        self.faults = faults
        self.seed = seed
        self.now_s = 0.0
        self.chance = random.Random(f"faults {seed}")
        self._phase = ""
        self._entries: dict[str, int] = {}
        self._entered_s: dict[tuple[str, int], float] = {}
        self._present: dict[FaultKind, Fault] = {}

    @property
    def any_present(self) -> bool:
        """Whether any fault is present."""
        return bool(self._present)

    @property
    def amounts(self) -> Mapping[FaultKind, float]:
        """Amount of every fault that is present, in the order of the scenario."""
        return {kind: fault.value for kind, fault in self._present.items()}

    def present(self, kind: FaultKind) -> bool:
        """Return whether a fault of this kind is present."""
        return kind in self._present

    def amount(self, kind: FaultKind) -> float | None:
        """Return the amount of a fault of this kind; None while it is not present."""
        fault = self._present.get(kind)
        return None if fault is None else fault.value

    def advance(self, now_s: float, phase: str) -> None:
        """Update what is present.

        Args:
            now_s: time since the start of the simulation.
            phase: of the onboard service.
        """
        self.now_s = now_s
        if phase != self._phase:
            self._phase = phase
            self._entries[phase] = self._entries.get(phase, 0) + 1
            self._entered_s[phase, self._entries[phase]] = now_s
        self._present = {
            fault.kind: fault for fault in self.faults if self._window_is_open(fault, now_s)
        }

    def _window_is_open(self, fault: Fault, now_s: float) -> bool:
        origin_s = 0.0 if fault.phase is None else self._entered_s.get((fault.phase, fault.entry))
        if origin_s is None:
            return False
        age_s = now_s - origin_s - fault.start_s
        return age_s >= 0.0 and (fault.duration_s is None or age_s < fault.duration_s)
