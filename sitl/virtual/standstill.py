"""Whether a vehicle that should stop has come to rest, so that the operator may land it."""

from __future__ import annotations

import math
from typing import Final

from onboard.geometry.rest import RestDetector

# Rest has to last, because the last half metre of braking looks the same; a full stop takes a few
# seconds, so that waiting longer is pointless.
STILL_FOR_S: Final = 1.0
PATIENCE_S: Final = 10.0


class Standstill:
    """Detect that the vehicle which an operator watches stands still."""

    def __init__(self) -> None:
        self._stopping_since_s = self._still_since_s = math.inf
        self._rest = RestDetector()

    def reached(
        self, now_s: float, position_ned_m: tuple[float, float, float], *, stopping: bool
    ) -> bool:
        """Return whether it stands, or the time allowed for stopping has passed.

        Args:
            now_s: time.
            position_ned_m: of the vehicle, as reported.
            stopping: whether it should stand by now.
        """
        if not stopping:
            self._stopping_since_s = self._still_since_s = math.inf
            self._rest = RestDetector()
            return False
        self._stopping_since_s = min(self._stopping_since_s, now_s)
        self._rest.add(now_s, position_ned_m)
        self._still_since_s = min(self._still_since_s, now_s) if self._rest.at_rest else math.inf
        return now_s - self._still_since_s >= STILL_FOR_S or (
            now_s - self._stopping_since_s >= PATIENCE_S
        )
