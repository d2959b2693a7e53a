"""Which movers are flown over: what a contract with heights says of them, and what is measured.

There all that moves is declared to stay on the ground and lower than the flight (theory K), so that
none can be where the vehicle is.  What is not measured to be out of the way counts all the same as
a mover of any height, and one that is measured taller than its class breaks what is declared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from onboard.contract.heights import HeightBand, half_band_m
from onboard.files.contract_terms.mover_terms import UNKNOWN, MoverClass
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.perception.detection import Detection
from onboard.perception.movers.moving_detection import MovingDetection
from onboard.perception.placement import POSE_TIMING_S, PlacedBox


class FlownOver:
    """What moves below one flight.

    Args:
        flight: whose contract and leg count.
    """

    def __init__(self, flight: SupervisedFlight) -> None:
        self._flight = flight
        self._tops_m, self._unknown_top_m = tops_of(flight.assessment.terms.movers)

    def meets(self, box: PlacedBox) -> bool:
        """Tell whether a mover may reach into the heights flown at; unknown heights may."""
        leg, terms = self._flight.leg, self._flight.assessment.terms
        return HeightBand.around(leg.origin_ned_m[2], half_band_m(terms)).meets(box.filled_m)

    def check(self, detection: Detection, box: PlacedBox) -> list[Violation]:
        """Return whether what a sensor says to move is taller than its class, errors included.

        Args:
            detection: as its sensor states it.
            box: where it is.
        """
        if not isinstance(detection, MovingDetection) or detection.motion != "moving":
            return []
        if box.down_m is None or math.isinf(box.down_m[0]):
            return []
        height_m = -box.down_m[0] - self._error_m(detection, box)
        limit_m = self._ground_m() + self._tops_m.get(detection.kind, self._unknown_top_m)
        if height_m <= limit_m:
            return []
        return [Violation(Assumption.MOVER_CLASS, height_m, limit_m, "m", box.track_id)]

    def _error_m(self, detection: Detection, box: PlacedBox) -> float:
        """Return by how much a top may be measured too high, above the true local origin."""
        terms = self._flight.assessment.terms
        error_m = max(detection.down_uncertainty_m or 0.0, terms.position_error_z_m or 0.0)
        if box.pose is not None:
            error_m += abs(box.pose.velocity_ned_mps[2]) * POSE_TIMING_S
        return error_m + (terms.height_drift_m or 0.0) + terms.estimator_reset_max_m

    def _ground_m(self) -> float:
        """Return how high the ground may be above the local origin."""
        terms = self._flight.assessment.terms
        return (terms.terrain_max_m or 0.0) + (terms.terrain_error_m or 0.0)


def tops_of(classes: Sequence[MoverClass]) -> tuple[dict[str, float], float]:
    """Return how high above the ground each class is, and what is of no declared class."""
    tops_m = {each.kind: math.inf if each.top_max_m is None else each.top_max_m for each in classes}
    return tops_m, tops_m.get(UNKNOWN, max(tops_m.values(), default=0.0))
