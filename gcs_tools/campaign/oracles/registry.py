"""All oracles, by name.

Each yields one sentence per finding.  An oracle that rests on an assumption is silent where that
assumption was broken: `FlightCase.covered` says whether the contract promises a flight without
collisions, and flights with faults or violations are not checked against the tracking error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from gcs_tools.campaign.oracles import outcomes, plans, references
from gcs_tools.campaign.oracles.detection import detected_in_time
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.campaign.oracles.rest import rest_held

Oracle = Callable[[Evidence], Iterator[str]]

ORACLES: Final[dict[str, Oracle]] = {
    "no_collision": outcomes.no_collision,
    "no_surprise": outcomes.no_surprise,
    "no_exception": outcomes.no_exception,
    "plan_not_expired": plans.plan_not_expired,
    "defined_end": outcomes.defined_end,
    "outcome": outcomes.allowed_outcome,
    "expectation": outcomes.met_expectation,
    "certified_plans": plans.certified_plans,
    "plans_in_region": plans.plans_in_region,
    "tracking": references.tracked_reference,
    "setpoints_in_limits": references.setpoints_in_limits,
    "continuous_reference": references.continuous_reference,
    "entry_condition": references.entry_condition,
    "entered_in_time": plans.entered_in_time,
    "exit_condition": references.exit_condition,
    "rest_held": rest_held,
    "bounded_memory": outcomes.bounded_memory,
    "detected_in_time": detected_in_time,
}


def findings(evidence: Evidence) -> dict[str, str]:
    """Return the first finding of every oracle that has one, by the oracle's name."""
    found = ((name, next(oracle(evidence), None)) for name, oracle in ORACLES.items())
    return {name: text for name, text in found if text is not None}
