"""Whether a vehicle that was told to stop has come to rest, so that it may be landed."""

from __future__ import annotations

import math
from typing import Final

from onboard.geometry.rest import RestDetector

# Rest has to last, since the last half metre of a braking looks like it, but is not waited for
# beyond all measure: a full stop takes a few seconds.
STILL_FOR_S: Final = 1.0
PATIENCE_S: Final = 10.0


class Standstill:
    """Waits for the vehicle that an operator watches to stand still."""

    def __init__(self) -> None:
        self._stopping_since_s = self._still_since_s = math.inf
        self._rest = RestDetector()

    def reached(
        self, now_s: float, position_ned_m: tuple[float, float, float], *, stopping: bool
    ) -> bool:
        """Tell whether it stands, or has had all the time that it may take to.

        Args:
            now_s: time.
            position_ned_m: of the vehicle, as it is told.
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
