"""What movers that hide behind obstacles ask for: more room beside what stands still (theory M).

A place that an obstacle hides may hold a mover, who may come out at any time.  The shadow behind an
obstacle beside the way never comes nearer to the way than its near face.  So a vehicle that keeps
v_o t_s more from that face rests before any contact, and passes without waiting.
"""

from __future__ import annotations

from dataclasses import replace

from onboard.contract.arithmetic import Arithmetic
from onboard.contract.clause import Clause
from onboard.contract.derivation import Derived, derive, separation_m
from onboard.contract.movers import RASTER_M, stop_of
from onboard.contract.terms import Terms
from onboard.geometry.frames import Q


def emergence_m(terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]) -> Q:
    """Return how much more room is kept beside each obstacle, v_o t_s of the fastest that hides.

    None where none hides, and with best effort, which looks into shadows from rest to rest.
    """
    # Without a ring, any may step behind an obstacle out of view.
    any_may = terms.movers_level == "passive_in_view"
    hiding = [mover.speed_max_mps for mover in terms.movers if mover.hidden or any_may]
    if not terms.movers_meet or terms.best_effort or not hiding:
        return derived.margin_m * 0.0
    time_s = stop_of(terms, derived, ops).time_s(terms.reaction_time_s)
    return max(hiding) * time_s + RASTER_M


def emergence_clauses(
    terms: Terms[Q], derived: Derived[Q], ops: Arithmetic[Q]
) -> tuple[Clause[Q], ...]:
    """Return what passing obstacles requires where movers hide behind them; else nothing."""
    more_m = emergence_m(terms, derived, ops)
    if not ops.anywhere(more_m > 0.0):
        return ()
    wide = derive(replace(terms, obstacle_size_max_m=terms.obstacle_size_max_m + 2.0 * more_m), ops)
    ahead_m = wide.required_detection_range_m - wide.encounter.run_on_m + more_m
    edge_m = wide.edge_offset_m + more_m
    return (
        Clause(
            "emergence",
            separation_m(terms, wide, ops),
            terms.obstacle_separation_min_m,
            "m",
            "beside an obstacle, movers that it hides may come out: more room must be free there",
            concerns="progress",
        ),
        Clause(
            "emergence_range",
            ops.sqrt(ahead_m * ahead_m + edge_m * edge_m),
            terms.detection_range_m,
            "m",
            "passing an obstacle at that distance must be begun earlier",
            concerns="progress",
        ),
    )
