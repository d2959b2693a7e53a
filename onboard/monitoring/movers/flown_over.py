"""Which movers are flown over: what a contract with heights says of them, and what is measured.

There all that moves is declared to stay on the ground and lower than the flight (theory K), so that
none can be where the vehicle is.  What is not measured to be out of the way counts all the same as
a mover of any height, as does what is of no declared class, however low it is measured: it may
rise.  One that is measured taller than its class breaks what is declared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from onboard.contract.heights import HeightBand, half_band_m
from onboard.files.contract_terms.mover_terms import UNKNOWN, MoverClass
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.perception.detection import Detection
from onboard.perception.movers.moving_detection import MovingDetection, kind_of
from onboard.perception.placement import POSE_TIMING_S, PlacedBox


class FlownOver:
    """What moves below one flight.

    Args:
        flight: whose contract and leg count.
    """

    def __init__(self, flight: SupervisedFlight) -> None:
        self._flight = flight
        self._tops_m, self._unknown_top_m = tops_of(flight.assessment.terms.movers)

    def meets(self, detection: Detection, box: PlacedBox) -> bool:
        """Tell whether a mover may reach into the heights flown at; unknown heights may.

        Args:
            detection: as its sensor states it.
            box: where it is.
        """
        if math.isinf(self._top_m(detection)) or self._is_taller(detection, box):
            return True
        leg, terms = self._flight.leg, self._flight.assessment.terms
        return HeightBand.around(leg.origin_ned_m[2], half_band_m(terms)).meets(box.filled_m)

    def check(self, detection: Detection, box: PlacedBox) -> list[Violation]:
        """Return whether what a sensor says to move is taller than its class, errors included.

        Args:
            detection: as its sensor states it.
            box: where it is.
        """
        moves = isinstance(detection, MovingDetection) and detection.motion == "moving"
        if not moves or not self._is_taller(detection, box):
            return []
        height_m, limit_m = self._height_m(detection, box), self._limit_m(detection)
        return [Violation(Assumption.MOVER_CLASS, height_m, limit_m, "m", box.track_id)]

    def _is_taller(self, detection: Detection, box: PlacedBox) -> bool:
        return self._height_m(detection, box) > self._limit_m(detection)

    def _height_m(self, detection: Detection, box: PlacedBox) -> float:
        """Return how high it reaches at least, above the true local origin."""
        top_m, bottom_m = detection.down_m or (None, None)
        # One whose top is not known reaches higher than its bottom.
        down_m = bottom_m if top_m is None else top_m
        if down_m is None:
            return -math.inf
        from_m = 0.0 if box.moves or box.pose is None else box.pose.position_ned_m[2]
        return -(from_m + down_m) - self._error_m(detection, box)

    def _limit_m(self, detection: Detection) -> float:
        """Return how high its class may reach above the local origin."""
        return self._ground_m() + self._top_m(detection)

    def _top_m(self, detection: Detection) -> float:
        """Return how high above the ground it may be; infinite of no declared class."""
        return self._tops_m.get(kind_of(detection), self._unknown_top_m)

    def _error_m(self, detection: Detection, box: PlacedBox) -> float:
        """Return by how much a top may be measured too high, above the true local origin."""
        terms = self._flight.assessment.terms
        error_m = max(detection.down_uncertainty_m or 0.0, terms.position_error_z_m or 0.0)
        if box.pose is not None:
            error_m += abs(box.pose.velocity_ned_mps[2]) * POSE_TIMING_S
        return error_m + (terms.height_drift_flight_m or 0.0) + terms.estimator_reset_max_m

    def _ground_m(self) -> float:
        """Return how high the ground may be above the local origin."""
        terms = self._flight.assessment.terms
        return (terms.terrain_max_m or 0.0) + (terms.terrain_error_m or 0.0)


def tops_of(classes: Sequence[MoverClass]) -> tuple[dict[str, float], float]:
    """Return how high above the ground each class is, and what is of no declared class.

    The latter is at any height, unless the contract declares the class `unknown`.
    """
    tops_m = {each.kind: math.inf if each.top_max_m is None else each.top_max_m for each in classes}
    return tops_m, tops_m.get(UNKNOWN, math.inf)
