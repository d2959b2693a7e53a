"""An assessed contract as the JSON document that several commands write."""

from __future__ import annotations

import math
from typing import Any

from onboard.contract.agility import AccelerationLimits
from onboard.contract.assessment import Assessment, Clause, Derived
from onboard.contract.movers import Level


def contract_document(assessment: Assessment) -> dict[str, Any]:
    """Return everything derived from a contract; the keys are a published interface."""
    return {
        "contract_sha256": assessment.contract.sha256,
        "input_set": assessment.terms.input_set,
        "accel_mps2": _accelerations(assessment.limits),
        "nominal": derived_document(assessment.nominal),
        "inflated": derived_document(assessment.inflated),
        "clauses": [clause_document(clause) for clause in assessment.clauses],
        "binding": assessment.binding.name,
        "compliant": assessment.compliant,
        "movers": [_level_document(level) for level in assessment.mover_levels],
    }


def _level_document(level: Level) -> dict[str, Any]:
    """Return what is promised against one class; null where it is not covered.

    `flown_over_above_m` is null where obstacles count as pillars, or no height suffices.
    """
    return {
        "class": level.mover.kind,
        "speed_max_mps": level.mover.speed_max_mps,
        "level": level.level,
        "front_required_m": level.front_m,
        "all_round_required_m": level.ring_m,
        "view_required_deg": level.view_deg,
        "flown_over_above_m": _finite(level.above_m),
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else value


def derived_document(derived: Derived[float]) -> dict[str, Any]:
    """Return one reading of a contract; lengths in metres.

    `required_separation_box_m` is [along, across] the leg: two obstacles have to be apart by one of
    the two.  The lane of the inflated reading includes the coasting after a lost setpoint stream
    (theory H).
    """
    region = derived.region
    return {
        "collision_set_depth_m": region.collision_set_depth_m,
        "csb_shape": "flat" if region.flat else "pointed",
        "lane_overhang_m": {
            "left": region.overhang_left_m + region.coast_left_m,
            "right": region.overhang_right_m + region.coast_right_m,
        },
        "pob_depth_m": region.pob_depth_m,
        "roi_length_m": derived.roi_length_m,
        "roi_width_m": derived.roi_width_m,
        "required_detection_range_m": derived.required_detection_range_m,
        "required_separation_m": derived.required_separation_m,
        "required_separation_box_m": list(derived.required_separation_box_m),
        "stopping_distance_m": derived.stopping_distance_m,
    }


def clause_document(clause: Clause[float]) -> dict[str, Any]:
    """Return one clause; ``required``, ``declared`` and ``margin`` are in ``unit``."""
    return {
        "name": clause.name,
        "required": clause.required,
        "declared": clause.declared,
        "margin": clause.margin,
        "unit": clause.unit,
        "holds": bool(clause.holds),
        "concerns": clause.concerns,
        "reason": clause.reason,
    }


def _accelerations(limits: AccelerationLimits) -> dict[str, float]:
    return {
        "brake": limits.brake_mps2,
        "forward": limits.forward_mps2,
        "left": limits.left_mps2,
        "right": limits.right_mps2,
    }
