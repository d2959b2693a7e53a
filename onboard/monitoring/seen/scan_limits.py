"""What a frame that states free ranges shows, as far as the contract lets it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from onboard.contract.terms import Terms
    from onboard.perception.detection import DetectionFrame


def scan_of(frame: DetectionFrame, terms: Terms[float]) -> tuple[float, ...]:
    """Return how far each bearing is free; without a return that is unknown, unless declared."""
    no_return_m = terms.no_return_is_free_to_m or 0.0
    ranges_m = frame.free_range_m or ()
    if None not in ranges_m:
        return cast("tuple[float, ...]", ranges_m)
    return tuple(no_return_m if range_m is None else range_m for range_m in ranges_m)


def resolved_m(frame: DetectionFrame, terms: Terms[float]) -> float:
    """Return the range within which one of a scan's rays meets the thinnest obstacle declared."""
    if terms.thinnest_obstacle_m is None or frame.free_range_m is None:
        return math.inf
    return terms.thinnest_obstacle_m / frame.bin_rad
