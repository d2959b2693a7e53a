"""Rows of a benchmark, without flying."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gcs_tools.benchmark.legs import LegRow

GOOD = LegRow(
    benchmark="sando", field="static_easy", leg="flight 0", number=0, form="planner",
    vehicle="default", seed=1, passable=True, arrived=True, collisions=0, end="arrived",
    length_m=105.0, duration_s=50.0, speed_mps=2.1, first_look_s=8.0, pauses=1,
    clearance_min_m=0.5, distance_min_m=0.8, certified_min_m=0.4, false_cells=0, losses=0,
    losses_unsafe=0, peer_distance_m=None, passed=True, why_not="",
)  # fmt: skip


def row(**changes: Any) -> LegRow:
    return replace(GOOD, **changes)
