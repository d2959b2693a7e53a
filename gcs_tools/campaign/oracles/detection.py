"""The oracle about monitors: a broken assumption is noticed within its bound."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gcs_tools.campaign.detection_bounds import detection_bound
from gcs_tools.campaign.oracles.evidence import Evidence, onset_s
from onboard.guidance.phases import FLYING_PHASES


def detected_in_time(evidence: Evidence) -> Iterator[str]:
    """A broken assumption is reported within its bound while the vehicle flies the mission."""
    for fault in evidence.case.scenario.faults:
        bound = detection_bound(fault, evidence.case.scenario.contract)
        began_s = onset_s(evidence, fault.phase, fault.entry, fault.start_s)
        if bound is None or began_s is None:
            continue
        names, bound_s = bound
        passing = fault.kind != "tick_stall" and (fault.duration_s or math.inf) <= bound_s
        exposed = [
            state.phase in FLYING_PHASES
            for state in evidence.states
            if began_s <= state.time_s <= began_s + bound_s
        ]
        # A flight that ended sooner was not exposed for long enough.
        whole = evidence.states[-1].time_s >= began_s + bound_s
        if (
            not passing
            and whole
            and all(exposed)
            and not _noticed(evidence, names, began_s + bound_s)
        ):
            what = " or ".join(sorted(names)) or "end of control"
            yield f"{fault.kind} went unnoticed for {bound_s:.2f} s: no {what}"


def _noticed(evidence: Evidence, assumptions: frozenset[str], until_s: float) -> bool:
    """Tell whether one was reported by then; each is reported once, so earlier reports count."""
    return any(
        event.data.get("assumption", event.name) in assumptions and event.time_s <= until_s
        for event in evidence.flight.events
    )
