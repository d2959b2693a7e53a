"""What the autopilot says of its batteries: BATTERY_STATUS of each, and SYS_STATUS of the first.

Source: https://mavlink.io/en/messages/common.html#BATTERY_STATUS, #SYS_STATUS.
"""

from __future__ import annotations

from typing import Any, Final

# A vehicle has a few; a broken sender must not fill the memory.
_BATTERIES_MAX: Final = 16


class BatteryReports:
    """Remembers the charge of each battery, and when it was reported.

    A charge that rises in flight is the voltage that recovers, not energy: there the least counts.

    Attributes:
        in_flight: whether that is so; on the ground a battery may be changed.
    """

    def __init__(self) -> None:
        self.in_flight = False
        self._charges: dict[int, tuple[float, float]] = {}
        self._first: tuple[float, float] | None = None

    def hear_battery(self, message: Any, now_s: float) -> None:
        """Take a BATTERY_STATUS; one without a charge, or with an absurd one, says nothing."""
        if 0 <= message.battery_remaining <= 100:
            number = message.id
            if number in self._charges or len(self._charges) < _BATTERIES_MAX:
                before = self._charges.get(number)
                self._charges[number] = self._least(before, message.battery_remaining), now_s

    def hear_system(self, message: Any, now_s: float) -> None:
        """Take a SYS_STATUS, which reports one battery; it counts where no BATTERY_STATUS comes."""
        if 0 <= message.battery_remaining <= 100:
            self._first = self._least(self._first, message.battery_remaining), now_s

    def _least(self, before: tuple[float, float] | None, percent: float) -> float:
        charge = percent / 100.0
        return charge if before is None or not self.in_flight else min(before[0], charge)

    def charge(self, now_s: float, silence_s: float) -> float | None:
        """Return the charge of the emptiest battery, from 0 to 1.

        Args:
            now_s: the time.
            silence_s: a battery that has not been reported for longer is unknown.

        Returns:
            None if that of any battery is unknown.
        """
        known = list(self._charges.values()) or ([] if self._first is None else [self._first])
        if not known or any(now_s - heard_s > silence_s for _, heard_s in known):
            return None
        return min(charge for charge, _ in known)
