"""Check each sensor for silence, lateness, and stamps of a wrong clock.

By stamps alone, silence and a wrong clock look alike: the newest stamp grows old.  So the monitor
also keeps when frames arrived: frames that arrive with stamps of another time show the fault of a
clock, and the violation says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from onboard.contract.assessment import Terms
from onboard.monitoring.assumptions import Assumption, Violation

# A frame from farther in the future than this has been stamped by a wrong clock.
CLOCK_TOLERANCE_S: Final = 0.1
# Stamps that are older than this on arrival come from a wrong clock, not from a slow link.
CLOCK_BEHIND_S: Final = 1.0
# Successive stamps may go back by this much, for rounding.
_STAMP_ROUNDING_S: Final = 1e-3


@dataclass
class SensorState:
    """What is known of one sensor, on the service's clock.

    Attributes:
        newest_stamp_s: stamp of the newest frame that could be used.
        first_heard_s, heard_s: arrival of its first frame and of its latest, usable or not.
        ahead_s: stamp less arrival of the latest frame; negative for any honest frame.
        stamp_s, sequence: of the latest frame.
    """

    first_heard_s: float
    heard_s: float
    ahead_s: float
    stamp_s: float
    sequence: int
    newest_stamp_s: float = -math.inf


class DetectionMonitor:
    """Checks age and stamps of what each sensor saw; the flight relies on each one once heard.

    Attributes:
        expected: sensors that the flight relies on before they are heard.
    """

    def __init__(self) -> None:
        self.expected: frozenset[str] = frozenset()
        self._sensors: dict[str, SensorState] = {}

    @property
    def sensors(self) -> Mapping[str, SensorState]:
        """What is known of every sensor that was heard, by its source name."""
        return self._sensors

    def age_s(self, now_s: float) -> float:
        """Time since the stalest sensor's newest frame was taken; infinite before the first."""
        if self._missing():
            return math.inf
        stamps_s = (sensor.newest_stamp_s for sensor in self._sensors.values())
        return now_s - min(stamps_s, default=-math.inf)

    def forget_stamps(self) -> None:
        """Discard every earlier stamp: the clock that they were read with has been set."""
        for sensor in self._sensors.values():
            sensor.newest_stamp_s = sensor.stamp_s = -math.inf

    def on_arrival(
        self, source: str, sequence: int, stamp_s: float, now_s: float
    ) -> Violation | None:
        """Take note of a frame that has arrived, whether or not it can be used.

        Args:
            source: the sensor.
            sequence: the frame's number; a later frame must not have an earlier stamp.
            stamp_s: when it was taken, by its stamp.
            now_s: when it arrived.
        """
        ahead_s = stamp_s - now_s
        sensor = self._sensors.get(source)
        if sensor is None:
            self._sensors[source] = SensorState(now_s, now_s, ahead_s, stamp_s, sequence)
            return _ahead(source, ahead_s)
        back_s = sensor.stamp_s - stamp_s if sequence > sensor.sequence else 0.0
        sensor.heard_s, sensor.ahead_s = now_s, ahead_s
        sensor.stamp_s, sensor.sequence = stamp_s, sequence
        if back_s > _STAMP_ROUNDING_S:
            note = f"its stamps went back by {back_s:.2f} s: was its clock set?"
            return _clock_fault(source, back_s, 0.0, note)
        return _ahead(source, ahead_s)

    def on_frame(
        self, source: str, stamp_s: float, now_s: float, terms: Terms[float]
    ) -> Violation | None:
        """Count a frame that arrived and can be used as sight.

        An obstacle may have come into range just after the frame before: what lies between that and
        now is how long a reaction can take.  What is too old to be a reaction is left to `check`.
        """
        sensor = self._sensors[source]
        previous_s = sensor.newest_stamp_s
        sensor.newest_stamp_s = max(previous_s, min(stamp_s, now_s))
        reaction_s, limit_s = now_s - previous_s, terms.reaction_time_s
        out_of_turn = stamp_s <= previous_s or math.isinf(previous_s)
        too_old = now_s - stamp_s > max(CLOCK_BEHIND_S, terms.frame_age_max_s)
        if out_of_turn or too_old or reaction_s <= limit_s:
            return None
        return Violation(Assumption.REACTION_TIME, reaction_s, limit_s, "s")

    def check(self, now_s: float, terms: Terms[float]) -> Violation | None:
        """Tell whether a sensor has been blind for longer than the contract allows, and why."""
        limit_s = terms.frame_age_max_s
        blind = {
            source: sensor
            for source, sensor in self._sensors.items()
            if now_s - sensor.newest_stamp_s > limit_s
        }
        if not self._sensors:
            note = "no detection frame was ever received"
            return Violation(Assumption.DETECTION_AGE, math.inf, limit_s, "s", "", note)
        if missing := self._missing():
            note = f"{', '.join(missing)} never sent anything that can be used"
            return Violation(
                Assumption.DETECTION_AGE, math.inf, limit_s, "s", ", ".join(missing), note
            )
        for source, sensor in blind.items():
            if now_s - sensor.heard_s > limit_s:
                continue
            if -sensor.ahead_s > max(limit_s, CLOCK_BEHIND_S):
                note = f"frames arrive, but their stamps are {-sensor.ahead_s:.1f} s behind"
                return _clock_fault(source, -sensor.ahead_s, limit_s, note)
            if (fault := _ahead(source, sensor.ahead_s)) is not None:
                return fault
        if not blind:
            return None
        note = "; ".join(self._why_blind(source, now_s, limit_s) for source in blind)
        age_s = self.age_s(now_s)
        return Violation(Assumption.DETECTION_AGE, age_s, limit_s, "s", ", ".join(blind), note)

    def _missing(self) -> list[str]:
        return sorted(self.expected - self._sensors.keys())

    def _why_blind(self, source: str, now_s: float, limit_s: float) -> str:
        sensor = self._sensors[source]
        if -sensor.ahead_s > limit_s >= now_s - sensor.heard_s:
            return f"frames of '{source}' arrive {-sensor.ahead_s:.2f} s late"
        used = sensor.newest_stamp_s >= sensor.stamp_s
        if used or now_s - sensor.heard_s > limit_s:
            successors = [
                f"'{other}' is new"
                for other, state in self._sensors.items()
                if state.first_heard_s > sensor.heard_s
            ]
            return "; ".join([f"source '{source}' silent", *successors])
        return f"frames of '{source}' arrive, but no pose of their time is known"


def _ahead(source: str, ahead_s: float) -> Violation | None:
    if ahead_s <= CLOCK_TOLERANCE_S:
        return None
    note = f"frames arrive, but their stamps are {ahead_s:.1f} s ahead"
    return _clock_fault(source, ahead_s, CLOCK_TOLERANCE_S, note)


def _clock_fault(source: str, measured_s: float, limit_s: float, note: str) -> Violation:
    return Violation(Assumption.SENSOR_CLOCK, measured_s, limit_s, "s", source, note)
