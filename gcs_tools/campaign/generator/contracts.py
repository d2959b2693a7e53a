"""Random contracts that comply: speed, agility and sizes drawn, and what they require declared."""

from __future__ import annotations

import random
from typing import Any, Final

from gcs_tools.campaign.generator.airframes import Airframe
from gcs_tools.campaign.generator.case import Extent
from gcs_tools.campaign.generator.fields import one_obstacle_fits
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract

# Far more than any contract drawn here requires.
_AMPLE_M: Final = 1000.0
_AMPLE_DEG: Final = 359.0
# The range that suffices is found by repetition: an error of the heading, at the range that is
# declared, makes regions larger, which then need more.
_RANGE_ROUNDS: Final = 12
_RANGE_FIRST_M: Final = 10.0
_RANGE_TOLERANCE_M: Final = 0.01


def compliant_contract(
    draw: random.Random,
    extent: Extent,
    airframe: Airframe,
    *,
    stop: bool,
    passive_safety: bool,
    size_max_m: float | None = None,
) -> Contract | None:
    """Draw speed, agility and sizes; declare what they require, and a little more.

    Args:
        draw: the flight's random numbers.
        extent: of the flight.
        airframe: whose errors are declared.
        stop: the contract requires to be able to stop.
        passive_safety: the contract requires passive safety.
        size_max_m: largest obstacle; None draws one.

    Returns:
        the contract; None if it does not comply, or if one obstacle does not fit on a leg.
    """
    terms = _ample_terms(draw, extent, airframe, stop=stop, passive_safety=passive_safety)
    if size_max_m is None:
        size_max_m = draw.uniform(0.5, 5.0)
    terms["environment"]["obstacle_size_max_m"] = size_max_m
    ample = _with_range(terms, spare=draw.uniform(1.01, 1.5))
    if ample is None:
        return None
    required = {clause.name: clause.required for clause in ample.clauses}
    view_deg = max(required["field_of_view"], required.get("seen_free_view", 0.0))
    terms["sensor"]["field_of_view_deg"] = min(
        _AMPLE_DEG, max(60.0, view_deg * draw.uniform(1.01, 1.4))
    )
    terms["environment"]["obstacle_separation_min_m"] = required["separation"] * 1.001
    contract = Contract.model_validate(terms)
    one_fits = one_obstacle_fits(ample, extent.length_m[0])
    return contract if one_fits and assess(contract).compliant else None


def _with_range(terms: dict[str, dict[str, Any]], *, spare: float) -> Assessment | None:
    """Declare as much detection range as is required, times ``spare``.

    Returns:
        what then follows from the contract; None if no range suffices.
    """
    range_m = _AMPLE_M if not terms["vehicle"].get("heading_error_deg") else _RANGE_FIRST_M
    for _ in range(_RANGE_ROUNDS):
        terms["sensor"]["detection_range_m"] = range_m
        assessment = assess(Contract.model_validate(terms))
        needed_m = required_range_m(assessment) * spare
        if needed_m >= _AMPLE_M:
            return None
        if abs(needed_m - range_m) < _RANGE_TOLERANCE_M:
            return assessment
        range_m = needed_m
    return None


def _ample_terms(
    draw: random.Random, extent: Extent, airframe: Airframe, *, stop: bool, passive_safety: bool
) -> dict[str, dict[str, Any]]:
    """Draw a contract whose sensor and separation are ample, to learn what it requires of them."""
    slowest_mps, fastest_mps = extent.speed_mps
    speed_mps = draw.uniform(slowest_mps, min(fastest_mps, airframe.speed_max_mps))
    return {
        "vehicle": {
            "thrust_to_weight": 2.0,
            "cruise_speed_mps": speed_mps,
            "radius_m": draw.uniform(0.2, 0.5),
            "recentring_speed_mps": draw.choice((0.0, 0.0, draw.uniform(0.1, 0.4))),
            **airframe.terms(draw, speed_mps),
        },
        "requirements": {"stop": stop, "passive_safety": passive_safety},
        "sensor": {
            "detection_range_m": _AMPLE_M,
            "field_of_view_deg": _AMPLE_DEG,
            "frame_age_max_s": 0.3,
            "position_error_m": airframe.wander_m + draw.uniform(*airframe.position_error_m),
        },
        "environment": {
            "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": _AMPLE_M,
        },
    }


def required_range_m(assessment: Assessment) -> float:
    """Return the detection range [m] that the most demanding clause about it requires."""
    return max(
        clause.required
        for clause in assessment.clauses
        if clause.declared == assessment.terms.detection_range_m
    )
