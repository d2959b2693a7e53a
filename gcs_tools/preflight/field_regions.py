"""The regions of influence of many obstacles at once, leg frame."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np

from onboard.contract.arithmetic import ARRAY
from onboard.contract.assessment import Assessment, Terms
from onboard.contract.derivation import stop_region, worst_encounter
from onboard.contract.region import Dimensions, dimensions
from onboard.geometry.frames import FloatArray


@dataclass(frozen=True)
class RegionBoxes:
    """Boxes about N obstacles, each (N, 4): x from, x to, y from, y to.

    Attributes:
        extent_m: their regions of influence.
        apart_m: what has to be disjoint for any two, so that each region is free of the other.
        manoeuvre_m: what an avoidance by Eq. 17 may take.
    """

    extent_m: FloatArray
    apart_m: FloatArray
    manoeuvre_m: FloatArray


def region_boxes(assessment: Assessment, boxes_m: FloatArray) -> RegionBoxes:
    """Return the regions of measured boxes, (N, 4).

    Vectorized form of `Assessment.region_around`.
    """
    terms = assessment.terms
    margin_m = assessment.inflation_m() + assessment.emergence_m
    inflated_m = boxes_m + margin_m * np.array([-1.0, 1.0, -1.0, 1.0])
    x_min_m, x_max_m, y_min_m, y_max_m = inflated_m.T
    numbers: dict[str, Any] = {
        each.name: np.full(len(boxes_m), value)
        for each in fields(terms)
        if isinstance(value := getattr(terms, each.name), float)
    }
    arrays: Terms[FloatArray] = replace(cast("Terms[Any]", terms), **numbers)
    size_m = (x_max_m - x_min_m, y_max_m - y_min_m)
    manoeuvre = dimensions(worst_encounter(arrays, *size_m, ARRAY), ARRAY)
    manoeuvre_m = _placed(inflated_m, manoeuvre)
    if not terms.stops:
        return RegionBoxes(manoeuvre_m, manoeuvre_m, manoeuvre_m)
    stop = stop_region(arrays, *size_m, ARRAY)
    return RegionBoxes(_placed(inflated_m, stop), _placed(inflated_m, stop, 0.5), manoeuvre_m)


def _placed(
    inflated_m: FloatArray, size: Dimensions[FloatArray], overhang_share: float = 1.0
) -> FloatArray:
    """Vectorized form of `onboard.contract.region.placed`; (N, 4) -> (N, 4)."""
    x_min_m, _, y_min_m, y_max_m = inflated_m.T
    return np.column_stack(
        (
            x_min_m - size.front_m,
            x_min_m + size.pob_depth_m,
            y_min_m - overhang_share * (size.overhang_left_m + size.coast_left_m),
            y_max_m + overhang_share * (size.overhang_right_m + size.coast_right_m),
        )
    )
