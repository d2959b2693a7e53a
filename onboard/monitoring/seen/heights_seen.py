"""Which heights around the leg the seen-free set speaks of, and which boxes are in their way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from onboard.contract.heights import LEVEL_M, HeightBand, half_band_m
from onboard.monitoring.supervised_flight import SupervisedFlight
from onboard.perception.detection import Corners, Detection, DetectionFrame, DownRange
from onboard.perception.heights import heights_shown_m
from onboard.vehicle_state import Pose


class HeightsSeen:
    """The band of heights of one flight's seen-free set (theory K).

    Args:
        flight: whose contract and map count.
    """

    def __init__(self, flight: SupervisedFlight) -> None:
        self._flight = flight
        self._half_m = half_band_m(flight.assessment.terms)
        # Of the leg from the height at which the oldest cells were seen, positive down.
        self._off_m = 0.0

    @property
    def level_m(self) -> float:
        """How far from the height of the leg the set still holds; infinite among pillars."""
        return LEVEL_M - abs(self._off_m) if math.isfinite(self._half_m) else math.inf

    def leave(self, moved_m: float) -> bool:
        """Tell whether what was seen is of another height, now that the leg has moved against it.

        Many small moves are a large one.

        Args:
            moved_m: by how much, positive down.
        """
        self._off_m += moved_m
        error_z_m = self._flight.assessment.terms.tracking_error_z_m
        if math.isinf(self._half_m):
            return abs(moved_m) > error_z_m
        return abs(self._off_m) > min(LEVEL_M, error_z_m)

    def forget(self) -> None:
        """Nothing has been seen: what comes is seen at the height of the leg."""
        self._off_m = 0.0

    def have_grown(self) -> bool:
        """Tell, once, whether the band has grown: what was free is not so at every height of it."""
        before_m, self._half_m = self._half_m, half_band_m(self._flight.assessment.terms)
        return self._half_m > before_m

    def in_way(
        self,
        frame: DetectionFrame,
        placed_ned_m: Sequence[Corners],
        filled_m: Callable[[Detection, Corners], DownRange],
    ) -> tuple[list[Detection], list[Corners]]:
        """Return the boxes of a frame that may reach into the band.

        The others hide none of it: a line of sight from the vehicle to a place in the band stays in
        the band.

        Args:
            frame: what a sensor saw.
            placed_ned_m: corners of its boxes, in local NED.
            filled_m: heights that a box may fill.
        """
        obstacles, terms = self._flight.obstacles, self._flight.assessment.terms
        if math.isinf(self._half_m):
            return list(frame.obstacles), list(placed_ned_m)
        error_m = terms.map_error_m
        kept = [
            (seen, corners_m)
            for seen, corners_m in zip(frame.obstacles, placed_ned_m, strict=True)
            if not obstacles.is_passed_over(
                frame.track_id(seen),
                corners_m,
                max(seen.uncertainty_m, error_m),
                filled_m(seen, corners_m),
            )
        ]
        return [seen for seen, _ in kept], [corners_m for _, corners_m in kept]

    def surely_in_way(self, frame: DetectionFrame, detection: Detection, pose: Pose) -> bool:
        """Tell whether a box reaches into what was seen free, whatever the errors of its heights.

        One that only may do so contradicts nothing: earlier frames have measured it otherwise, each
        within its error.  Since then the height may have drifted.

        Args:
            frame: what a sensor saw.
            detection: the box.
            pose: of the body at the stamp.
        """
        terms = self._flight.assessment.terms
        if math.isinf(self._half_m) or terms.height_drift_m is None:
            return True
        half_m = self._half_m - terms.height_drift_m - LEVEL_M
        band = HeightBand.around(self._flight.leg.origin_ned_m[2], half_m)
        return band.meets(heights_shown_m(frame, detection, pose, terms))
