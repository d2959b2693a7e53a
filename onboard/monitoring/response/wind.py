"""Check the steady wind, as the trim of the attitude shows it, against the declared one."""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.assessment import Terms
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.response.trim import TrimEstimator

# Trim that wind does not cause: attitude and velocity estimates are off (recorded, in still air: up
# to 0.55, PX4), and the drag of flying is not quite as declared.
TRIM_TOLERANCE_MPS2: Final = 0.6
# Gusts pass; what lasts this long is steady.
CONFIRMATION_S: Final = 3.0


class WindMonitor:
    """Compares the trim, less the drag of flying, with the drag of the declared wind.

    Args:
        trim: the tilt that balances the drag of late.
    """

    def __init__(self, trim: TrimEstimator) -> None:
        self._trim = trim
        self._exceeded_since_s: float | None = None

    def check(self, now_s: float, terms: Terms[float]) -> Violation | None:
        """Tell whether a wind beyond the declared one has lasted; never where none is declared."""
        if terms.wind_max_mps is None or not self._trim.ready:
            self._exceeded_since_s = None
            return None
        (north_mps2, east_mps2), (vn_mps, ve_mps) = self._trim.trim_mps2, self._trim.velocity_mps
        # In still air a vehicle tilts forward against its own airspeed.
        drag_per_s = terms.drag_per_s
        taken_mps2 = math.hypot(north_mps2 - drag_per_s * vn_mps, east_mps2 - drag_per_s * ve_mps)
        limit_mps2 = drag_per_s * terms.wind_max_mps + TRIM_TOLERANCE_MPS2
        if taken_mps2 <= limit_mps2:
            self._exceeded_since_s = None
            return None
        if self._exceeded_since_s is None:
            self._exceeded_since_s = now_s
        if now_s - self._exceeded_since_s < CONFIRMATION_S:
            return None
        # As the contract states it: a wind.  Without drag, no wind explains what is seen.
        if drag_per_s == 0.0:
            return Violation(Assumption.WIND, math.inf, terms.wind_max_mps, "m/s")
        return Violation(Assumption.WIND, taken_mps2 / drag_per_s, limit_mps2 / drag_per_s, "m/s")
