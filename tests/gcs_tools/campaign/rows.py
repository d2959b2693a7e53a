"""Rows of a campaign's table, without flying."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gcs_tools.campaign.flight import FlightRow

GOOD = FlightRow(
    source="quick", campaign_seed=1, number=0, seed=7, variant="none", trigger="", covered=True,
    refused=False, outcome="arrived", reason="", collisions=0, clearance_min_m=0.5, obstacles=1,
    obstacles_avoided=1, true_tracking_error_m=0.1, tracking_share=0.4, plans_qp=1, plans_vertex=0,
    plans_brake=0, violations="", findings="", progress="guaranteed", threaded=False,
    pauses=0, rest_margin_min_m=None, genes="", least_margin_m=None, least_margin_of="", shares="",
    csb_shape="flat", cruise_speed_mps=3.0,
    roll_max_deg=15.0, pitch_max_deg=15.0, obstacle_size_max_m=2.0, separation_m=20.0,
    passive_safety=True, virtual_s=36.0, wall_s=1.0,
)  # fmt: skip


def row(**changes: Any) -> FlightRow:
    return replace(GOOD, **changes)
