"""What a rehearsal predicts of a mission; no verdict depends on it: a map may be incomplete."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from onboard.geometry.frames import FloatArray

Point = tuple[float, float]


@dataclass(frozen=True)
class Wait:
    """One pause: where the vehicle stood, and for how long it looked around."""

    position_ned_m: Point
    duration_s: float


@dataclass(frozen=True)
class LegRehearsal:
    """How one leg was rehearsed.

    Attributes:
        name: of the leg.
        passes: whether its end was reached.
        duration_s: of the flight, the first look around included.
        distance_m: that was flown.
        narrowest_gap_m: between two obstacles that it passed between; None without such a pair.
        waits: the pauses, in order.
        path_ned_m: where the reference was, five times a second, (n, 2).
        speed_mps: there, (n,).
    """

    name: str
    passes: bool
    duration_s: float
    distance_m: float
    narrowest_gap_m: float | None
    waits: tuple[Wait, ...]
    path_ned_m: FloatArray
    speed_mps: FloatArray

    @property
    def mean_speed_mps(self) -> float:
        """Way flown over the time that it took, pauses included."""
        return self.distance_m / self.duration_s if self.duration_s else 0.0


@dataclass(frozen=True)
class Rehearsal:
    """A rehearsed mission; legs after one that was not passed are left out."""

    legs: tuple[LegRehearsal, ...]
    legs_total: int

    @property
    def passes(self) -> bool:
        """Whether the end of the mission was reached."""
        return len(self.legs) == self.legs_total and all(leg.passes for leg in self.legs)

    @property
    def mean_speed_mps(self) -> float:
        """Expected mean speed, pauses included."""
        duration_s = sum(leg.duration_s for leg in self.legs)
        return sum(leg.distance_m for leg in self.legs) / duration_s if duration_s else 0.0

    @property
    def narrowest_gap_m(self) -> float | None:
        """The narrowest gap that was flown through."""
        gaps_m = [leg.narrowest_gap_m for leg in self.legs if leg.narrowest_gap_m is not None]
        return min(gaps_m, default=None)

    @property
    def waits(self) -> tuple[Wait, ...]:
        """Every pause of the mission."""
        return tuple(wait for leg in self.legs for wait in leg.waits)

    def sentence(self) -> str:
        """Return the prediction in words."""
        gap_m, waits = self.narrowest_gap_m, self.waits
        says = [f"expected {self.mean_speed_mps:.2f} m/s"]
        if gap_m is not None:
            says.append(f"narrowest gap {gap_m:.2f} m")
        if waits:
            longest = max(waits, key=lambda wait: wait.duration_s)
            north_m, east_m = longest.position_ned_m
            says.append(
                f"{len(waits)} pauses, the longest of {longest.duration_s:.0f} s at "
                f"{north_m:.1f} m north, {east_m:.1f} m east"
            )
        outcome = "passes" if self.passes else f"does not pass {self.legs[-1].name}"
        return f"{outcome}: {', '.join(says)}"

    def document(self) -> dict[str, Any]:
        """Return the prediction as JSON values."""
        return {
            "prediction": True,
            "passes": self.passes,
            "mean_speed_mps": self.mean_speed_mps,
            "narrowest_gap_m": self.narrowest_gap_m,
            "waits": [
                {"position_ned_m": list(wait.position_ned_m), "duration_s": wait.duration_s}
                for wait in self.waits
            ],
            "legs": [
                {
                    "name": leg.name,
                    "passes": leg.passes,
                    "duration_s": leg.duration_s,
                    "distance_m": leg.distance_m,
                    "mean_speed_mps": leg.mean_speed_mps,
                    "narrowest_gap_m": leg.narrowest_gap_m,
                    "waits": len(leg.waits),
                }
                for leg in self.legs
            ],
        }
