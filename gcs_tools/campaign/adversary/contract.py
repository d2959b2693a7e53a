"""Contracts for an adversary: all that is declared is only a hair more than what is required."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from gcs_tools.campaign.adversary.genes import Genes
from gcs_tools.campaign.generator.contracts import required_range_m
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract

# What is declared over what is required.
SLACK: Final = 1.0005
# The simulation delivers frames in steps of a tick.
_TICK_S: Final = 0.02
# As many successive frames may miss an obstacle.
EMPTY_FRAMES: Final = 2
_AMPLE_M: Final = 1000.0
# The required range depends on itself by the heading error; it settles within a few steps.
_STEPS: Final = 6
_VIEW_WIDEST_DEG: Final = 240.0
# How a PX4 vehicle runs on, ideal and by default; the service takes no other model of it.
_FROZEN: Final = (
    {"model": "frozen", "gain_per_s": 1.3, "velocity_gain_per_s": 4.5},
    {"model": "frozen", "gain_per_s": 0.95, "velocity_gain_per_s": 1.8},
)
_COAST: Final = {"model": "coast"}


@dataclass(frozen=True)
class Timing:
    """When frames come, and what may be missing in them.

    Attributes:
        period_s, latency_s: of the frames.
        confirm_frames: an obstacle is reported in this frame that has it in view.
        empty_every: every so many frames one is empty; None for none.
    """

    period_s: float
    latency_s: float
    confirm_frames: int
    empty_every: int | None

    @property
    def reaction_s(self) -> float:
        """Longest time from an obstacle in range to a frame that reports it."""
        empty = EMPTY_FRAMES if self.empty_every else 0
        return (self.confirm_frames + empty) * self.period_s + self.latency_s


def timing_of(genes: Genes) -> Timing:
    """Draw the timing; the service needs three successive frames, so that two may miss a box."""
    confirm_frames, empty_every = genes.choice(
        "detector", ((1, None), (1, None), (3, None), (1, 6))
    )
    return Timing(
        period_s=_TICK_S * genes.choice("period", (2, 3, 5)),
        latency_s=_TICK_S * genes.choice("latency", (0, 1, 3, 5)),
        confirm_frames=confirm_frames,
        empty_every=empty_every,
    )


def adversary_contract(genes: Genes, timing: Timing, kind: str) -> Contract | None:
    """Draw a contract whose every clause holds by `SLACK`; None if there is none for the draw."""
    terms = _terms(genes, timing, kind)
    sensor, environment = terms["sensor"], terms["environment"]
    by_axis = genes.choice("separation_by_axis", (False, True))
    for _ in range(_STEPS):
        found = assess(Contract.model_validate(terms))
        sensor["detection_range_m"] = required_range_m(found) * SLACK
    found = assess(Contract.model_validate(terms))
    required = {clause.name: clause.required for clause in found.clauses}
    view_deg = max(required["field_of_view"], required["seen_free_view"]) * SLACK
    if view_deg >= _VIEW_WIDEST_DEG:
        return None
    wide = genes.choice("view", (False, True))
    sensor["field_of_view_deg"] = (
        genes.uniform("view_deg", view_deg, _VIEW_WIDEST_DEG) if wide else view_deg
    )
    separation_m = found.inflated.required_separation_m * SLACK
    environment["obstacle_separation_min_m"] = (
        [each_m * SLACK for each_m in found.inflated.required_separation_box_m]
        if by_axis
        else separation_m
    )
    if kind != "lane":
        terms["requirements"]["progress"] = "best_effort"
        sensor["detection_range_m"] = genes.uniform("range", 5.0, 9.0)
    contract = Contract.model_validate(terms)
    return contract if kind != "lane" or assess(contract).compliant else None


def clause_shares(assessment: Assessment) -> dict[str, float]:
    """Return which share of range, and of a narrow view, the contract requires."""
    by_name = {clause.name: clause for clause in assessment.clauses}
    view = max(by_name["field_of_view"].required, by_name["seen_free_view"].required)
    view_share = view / by_name["field_of_view"].declared
    narrow = {"view": view_share} if view_share > 1.0 / SLACK - 1e-9 else {}
    range_share = required_range_m(assessment) / assessment.terms.detection_range_m
    return {"range": range_share, **narrow}


def _terms(genes: Genes, timing: Timing, kind: str) -> dict[str, dict[str, Any]]:
    speeds_mps = (2.0, 5.0) if kind == "lane" else (1.2, 2.8)
    sizes_m = (0.3, 3.0) if kind == "lane" else (0.3, 1.2)
    passive = genes.choice("passive", (False, True))
    loss = genes.choice("loss", _FROZEN if passive else (*_FROZEN, _COAST))
    return {
        "vehicle": {
            "roll_max_deg": genes.uniform("roll", 8.0, 25.0),
            "pitch_max_deg": genes.uniform("pitch", 8.0, 25.0),
            "thrust_to_weight": 2.0,
            "cruise_speed_mps": genes.uniform("speed", *speeds_mps),
            "radius_m": genes.uniform("radius", 0.15, 0.5),
            "tracking_error_m": genes.uniform("tracking", 0.1, 0.5),
            "velocity_error_mps": [0.25, 0.15],
            "reaction_time_s": timing.reaction_s * SLACK,
            "attitude_lag_s": genes.uniform("lag", 0.15, 0.25),
            "setpoint_loss_timeout_s": genes.choice("timeout", (0.2, 0.5)),
            "recentring_speed_mps": genes.choice("recentring", (0.0, 0.0, 0.3)),
            "heading_error_deg": genes.choice("heading_error", (0.0, 0.0, 0.0, 0.5)),
            "setpoint_loss": loss,
        },
        "requirements": {"stop": True, "passive_safety": passive},
        "sensor": {
            "detection_range_m": 10.0,
            "field_of_view_deg": 359.0,
            "frame_age_max_s": timing.reaction_s + 0.1,
            "position_error_m": genes.uniform("face", 0.03, 0.2),
        },
        "environment": {
            "obstacle_size_max_m": genes.uniform("size_max", *sizes_m),
            "obstacle_size_min_m": 0.0,
            "obstacle_separation_min_m": _AMPLE_M,
        },
    }
