"""Checks how long the vehicle has been in the air: what a drifting estimate may add has an end."""

from __future__ import annotations

from onboard.monitoring.assumptions import Assumption, Violation


class FlightTimeMonitor:
    """Measures the time since take-off; a vehicle of unknown state goes on being in the air."""

    def __init__(self) -> None:
        self._took_off_s: float | None = None

    def follow(self, airborne: bool | None, now_s: float) -> bool:
        """Take note of what the autopilot says; tell whether the vehicle has just taken off."""
        if airborne is False:
            self._took_off_s = None
        took_off = airborne is True and self._took_off_s is None
        if took_off:
            self._took_off_s = now_s
        return took_off

    def check(self, now_s: float, limit_s: float | None) -> Violation | None:
        """Tell whether the flight has lasted as long as the contract allows for.

        Args:
            now_s: the time.
            limit_s: of the contract; None if it states none.
        """
        if self._took_off_s is None or limit_s is None or now_s - self._took_off_s < limit_s:
            return None
        flown_s = now_s - self._took_off_s
        sentence = f"{flown_s:.0f} s since take-off (limit {limit_s:g} s): land now"
        return Violation(Assumption.FLIGHT_TIME, flown_s, limit_s, "s", sentence=sentence)
