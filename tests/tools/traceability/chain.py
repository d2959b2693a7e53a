"""What each assumption rests on and leads to, read from the code's own registries.

Assumption -> terms -> clauses -> monitor -> response -> scenarios -> figures of campaigns.  Only
the terms are stated here; everything else follows from the code, scenario files and flights.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

from gcs_tools.scenario import load_scenario
from onboard.contract.assessment import Assessment, assess_terms
from onboard.contract.terms import Terms
from onboard.files.contract_file import load_contract
from onboard.monitoring.assumptions import Assumption
from tests.onboard.monitoring.test_responses_page import on_a_held_way
from tests.tools.traceability.figures import Figure, named_after, stated_figures

ROOT: Final = Path(__file__).parents[3]
SCENARIOS: Final = ROOT / "config" / "scenarios"

# The terms of the contract whose truth an assumption confirms in flight.
TERMS: Final[dict[Assumption, tuple[str, ...]]] = {
    Assumption.DETECTION_AGE: ("frame_age_max_s",),
    Assumption.REACTION_TIME: ("reaction_time_s",),
    Assumption.DETECTION_RANGE: ("detection_range_m",),
    Assumption.FIELD_OF_VIEW: ("field_of_view_rad",),
    # Each says that an obstacle is where a frame has reported it, within that error.
    Assumption.DETECTION_UNCERTAINTY: ("position_error_m",),
    Assumption.DETECTION_CONSISTENCY: ("position_error_m",),
    Assumption.SENSOR_CONTRADICTION: ("position_error_m",),
    Assumption.SENSOR_CLOCK: ("reaction_time_s",),
    Assumption.OBSTACLE_SIZE: ("obstacle_size_max_m",),
    Assumption.ROI_INTERSECTION: ("obstacle_separation_min_m",),
    Assumption.LATE_FIRST_SIGHT: ("detection_range_m",),
    # Movers are what the contract says of them, and the vehicle rests when it says so.
    Assumption.MOVER_FIRST_SIGHT: ("detection_range_m", "all_round_range_m"),
    Assumption.MOVER_CLASS: ("movers",),
    Assumption.STATIC_CLAIM: ("movers",),
    Assumption.REST_SPEED: ("rest_settle_s",),
    Assumption.YIELD_TIME: ("movers",),
    Assumption.MOVER_VIEW: ("movers",),
    # The vehicle is where its reference is, within that error: by its own controller, as told by a
    # link that is alive, and not by the setpoints of another commander.
    Assumption.TRACKING_ERROR: ("tracking_error_m",),
    Assumption.TELEMETRY_AGE: ("tracking_error_m",),
    Assumption.SECOND_COMMANDER: ("tracking_error_m",),
    Assumption.TRACKING_ERROR_Z: ("tracking_error_z_m",),
    Assumption.VELOCITY_ERROR: ("velocity_error_x_mps", "velocity_error_y_mps"),
    Assumption.TILT_RESPONSE: ("attitude_lag_s",),
    Assumption.ESTIMATOR_RESET: ("estimator_reset_max_m",),
    Assumption.POSITION_QUALITY: ("position_drift_mps",),
    Assumption.HEADING_ERROR: ("heading_error_rad",),
    Assumption.WIND: ("wind_max_mps",),
    Assumption.FLIGHT_TIME: ("flight_time_max_s",),
    # A service that decides too late is like a frame that comes too late; one that stops deciding
    # leaves the vehicle to the autopilot's own timeout.
    Assumption.TICK_OVERRUN: ("reaction_time_s",),
    Assumption.LATE_TICKS: ("setpoint_loss_timeout_s",),
    Assumption.SELF_CHECK: ("setpoint_loss_timeout_s",),
    # There is room to pass and to end a leg.
    Assumption.PLAN_EXISTS: ("obstacle_separation_min_m",),
    Assumption.NO_PASSAGE: ("obstacle_separation_min_m",),
    Assumption.LEG_END_CLEAR: ("obstacle_separation_min_m",),
    Assumption.TARGET_REACHED: ("recentring_speed_mps",),
}
# A contract that states everything a clause can depend on.
_CONTRACT: Final = ROOT / "config" / "recentring_contract.yaml"
_STATED: Final = (
    "environment.wind_max_mps=1.0",
    "vehicle.position_drift_mps=0.0005",
    "requirements.flight_time_max_s=60",
    "vehicle.estimator_reset_max_m=0.05",
    "vehicle.heading_error_deg=1.0",
    "requirements.stop=true",
    "requirements.passive_safety=true",
    "requirements.movers=passive",
    "vehicle.rest_settle_s=0.4",
    "sensor.all_round_range_m=10.0",
    "environment.movers=[{class: person, speed_max_mps: 1.5, size_max_m: 1.0}]",
)
_CHANGE: Final = 0.01


@dataclass(frozen=True)
class Link:
    """One row of the table.

    Attributes:
        assumption: which.
        terms, clauses: of the contract.
        monitors: modules that report it.
        response: where a way to rest is held and passing is guaranteed.
        scenarios: files that break it.
        figures: of campaigns in which it failed.
    """

    assumption: Assumption
    terms: tuple[str, ...]
    clauses: tuple[str, ...]
    monitors: tuple[str, ...]
    response: str
    scenarios: tuple[str, ...]
    figures: tuple[Figure, ...]


def chain(figures: tuple[Figure, ...] | None = None) -> tuple[Link, ...]:
    """Return the row of every assumption, in the order of the code.

    Args:
        figures: of campaigns; by default those that the repository states.
    """
    figures = stated_figures() if figures is None else figures
    return tuple(
        Link(
            each,
            TERMS[each],
            tuple(sorted({clause for term in TERMS[each] for clause in clauses_of(term)})),
            tuple(monitors().get(each.name, ())),
            on_a_held_way(each),
            tuple(sorted(set(_scenarios_of(each, figures)))),
            tuple(figure for figure in figures if figure.assumption == each.value),
        )
        for each in Assumption
    )


@cache
def full_assessment() -> Assessment:
    """Return the assessment of a contract that states everything."""
    contract = load_contract(_CONTRACT, _STATED)
    return assess_terms(contract, Terms.of(contract, mission_altitude_m=4.0))


@cache
def clauses_of(term: str) -> tuple[str, ...]:
    """Return the clauses whose margin moves when one term does."""
    base = full_assessment()
    value = getattr(base.terms, term)
    if isinstance(value, tuple):  # classes of movers
        faster = ({"speed_max_mps": each.speed_max_mps * (1.0 + _CHANGE)} for each in value)
        more: Any = tuple(each.model_copy(update=u) for each, u in zip(value, faster, strict=True))
    else:
        more = value * (1.0 + _CHANGE)
    changed = assess_terms(base.contract, replace(base.terms, **{term: more}))
    before = {clause.name: clause.margin for clause in base.clauses}
    return tuple(
        clause.name for clause in changed.clauses if abs(clause.margin - before[clause.name]) > 1e-9
    )


@cache
def monitors() -> dict[str, tuple[str, ...]]:
    """Return the modules that construct a violation of each assumption, by its name."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "onboard").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for name in _reported(ast.parse(path.read_text(encoding="utf-8"))):
            found.setdefault(name, set()).add(module)
    return {name: tuple(sorted(modules)) for name, modules in found.items()}


def _reported(tree: ast.Module) -> Iterator[str]:
    """Yield the assumptions of which a module makes violations, one by one or from a table."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name("Violation"), args=[first, *_]):
                yield from _named(first)
            case ast.Tuple(elts=[first, _, _, _, _]):  # with subject, measured, limit and unit
                yield from _named(first)


def _named(node: ast.expr) -> Iterator[str]:
    match node:
        case ast.Attribute(value=ast.Name("Assumption" | "assumed"), attr=name):
            yield name


def _scenarios_of(assumption: Assumption, figures: tuple[Figure, ...]) -> Iterator[str]:
    """Yield the files that are named after it, that expect it, or in whose flights it failed."""
    for stem, reason in _reasons():
        if assumption.value in (*named_after(stem), *reason.split()):
            yield stem
    for figure in figures:
        if figure.assumption == assumption.value and figure.campaign.endswith(".yaml"):
            yield Path(figure.campaign).stem


@cache
def _reasons() -> tuple[tuple[str, str], ...]:
    """Return each scenario file's stem, and the words of the reason that it expects for its end."""
    read = ((path.stem, load_scenario(path).expect) for path in sorted(SCENARIOS.glob("*.yaml")))
    return tuple((stem, re.sub(r"\W", " ", expect.reason or "")) for stem, expect in read)
