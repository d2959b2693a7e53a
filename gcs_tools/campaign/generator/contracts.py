"""Random contracts that comply: speed, agility and sizes drawn, and what they require declared."""

from __future__ import annotations

import random
from typing import Any, Final

from gcs_tools.campaign.generator.case import Extent
from gcs_tools.campaign.generator.fields import one_obstacle_fits
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract

# Far more than any contract drawn here requires.
_AMPLE_M: Final = 1000.0
_AMPLE_DEG: Final = 359.0
# Contains the latency and confirmation time that the simulated sensor needs.
_REACTION_TIME_S: Final = (0.15, 0.25)
# This share of contracts is drawn for ArduPilot at field realism; its tilt overshoots by 1.4.
# Known defect: `compliant_contract` rejects all of them, because their heading error at the ample
# range makes a region longer than any leg.  A fix changes the flight that each seed means.
_FIELD_SHARE: Final = 0.5
_FIELD_TILT_MAX_DEG: Final = 15.0
# The others are flown by an ideal PX4 (`sitl.plant.controller.ControllerGains`).
_IDEAL_TERMS: Final = {
    "setpoint_loss": {"model": "frozen", "gain_per_s": 1.3, "velocity_gain_per_s": 4.5}
}


def compliant_contract(
    draw: random.Random,
    extent: Extent,
    *,
    stop: bool,
    passive_safety: bool,
    size_max_m: float | None = None,
) -> Contract | None:
    """Draw speed, agility and sizes; declare what they require, and a little more.

    Args:
        draw: the flight's random numbers.
        extent: of the flight.
        stop: the contract requires to be able to stop.
        passive_safety: the contract requires passive safety.
        size_max_m: largest obstacle; None draws one.

    Returns:
        the contract; None if it does not comply, or if one obstacle does not fit on a leg.
    """
    terms = _ample_terms(draw, extent, stop=stop, passive_safety=passive_safety)
    if size_max_m is None:
        size_max_m = draw.uniform(0.5, 5.0)
    terms["environment"]["obstacle_size_max_m"] = size_max_m
    ample = assess(Contract.model_validate(terms))
    required = {clause.name: clause.required for clause in ample.clauses}
    terms["sensor"]["detection_range_m"] = required_range_m(ample) * draw.uniform(1.01, 1.5)
    view_deg = max(required["field_of_view"], required.get("seen_free_view", 0.0))
    terms["sensor"]["field_of_view_deg"] = min(
        _AMPLE_DEG, max(60.0, view_deg * draw.uniform(1.01, 1.4))
    )
    terms["environment"]["obstacle_separation_min_m"] = required["separation"] * 1.001
    contract = Contract.model_validate(terms)
    one_fits = one_obstacle_fits(ample, extent.length_m[0])
    return contract if one_fits and assess(contract).compliant else None


def _ample_terms(
    draw: random.Random, extent: Extent, *, stop: bool, passive_safety: bool
) -> dict[str, dict[str, Any]]:
    """Draw a contract whose sensor and separation are ample, to learn what it requires of them."""
    as_in_the_field = draw.random() < _FIELD_SHARE
    return {
        "vehicle": {
            "roll_max_deg": draw.uniform(8.0, 22.0),
            "pitch_max_deg": draw.uniform(8.0, 22.0),
            "thrust_to_weight": 2.0,
            "cruise_speed_mps": draw.uniform(*extent.speed_mps),
            "radius_m": draw.uniform(0.2, 0.5),
            "tracking_error_m": draw.uniform(0.2, 0.35),
            "velocity_error_mps": [0.25, 0.15],
            "reaction_time_s": draw.uniform(*_REACTION_TIME_S),
            "attitude_lag_s": draw.uniform(0.15, 0.2),
            "setpoint_loss_timeout_s": 0.5,
            "recentring_speed_mps": draw.choice((0.0, 0.0, draw.uniform(0.1, 0.4))),
            **(_field_terms(draw) if as_in_the_field else _IDEAL_TERMS),
        },
        "requirements": {"stop": stop, "passive_safety": passive_safety},
        "sensor": {
            "detection_range_m": _AMPLE_M,
            "field_of_view_deg": _AMPLE_DEG,
            "frame_age_max_s": 0.3,
            "position_error_m": draw.uniform(0.02, 0.08),
        },
        "environment": {
            "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": _AMPLE_M,
        },
    }


def _field_terms(draw: random.Random) -> dict[str, Any]:
    """Draw what a tuned ArduPilot vehicle declares at field realism."""
    return {
        "roll_max_deg": draw.uniform(8.0, _FIELD_TILT_MAX_DEG),
        "pitch_max_deg": draw.uniform(8.0, _FIELD_TILT_MAX_DEG),
        "tracking_error_m": draw.uniform(0.35, 0.5),
        "velocity_error_mps": [0.55, 0.6],
        "attitude_lag_s": draw.uniform(0.25, 0.3),
        "heading_error_deg": 1.2,
    }


def flies_as_in_the_field(contract: Contract) -> bool:
    """Tell whether the contract is one for field realism (`_field_terms`)."""
    return contract.vehicle.heading_error_deg > 0.0


def required_range_m(assessment: Assessment) -> float:
    """Return the detection range [m] that the most demanding clause about it requires."""
    return max(
        clause.required
        for clause in assessment.clauses
        if clause.declared == assessment.terms.detection_range_m
    )
