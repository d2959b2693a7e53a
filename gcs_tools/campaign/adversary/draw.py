"""Draws one adversarial flight: contract, course and plant, each at its limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from gcs_tools.campaign.adversary.contract import (
    Timing,
    adversary_contract,
    clause_shares,
    timing_of,
)
from gcs_tools.campaign.adversary.fields import Course, course_of
from gcs_tools.campaign.adversary.genes import Genes, genes_text
from gcs_tools.campaign.adversary.plant import adversary_plant, strategy_of
from gcs_tools.campaign.generator.allowances import Adversary
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.generator.scenarios import ATTEMPTS_MAX
from gcs_tools.preflight.command import check
from gcs_tools.preflight.tier import face_distances_m, start_clear_radius_m
from gcs_tools.scenario import Expectation, Scenario
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission

SOURCE: Final = "adversary"
_ALTITUDE_M: Final = 3.0
_KINDS: Final = ("lane", "lane", "lane", "corner", "forest")
_SEED_MAX: Final = 2**31 - 1
_SEARCHING_MAX_S: Final = 30.0


class _Draw(NamedTuple):
    kind: str
    contract: Contract
    timing: Timing
    course: Course
    mission: Mission


def adversary_case(
    campaign_seed: int, number: int, moved: Mapping[str, float] | None = None
) -> FlightCase:
    """Draw flight ``number``; the same for the same arguments.

    Args:
        campaign_seed: of the campaign.
        number: of the flight.
        moved: genes that a search has moved; the contract stays what it was drawn as.  Where the
            field that they give is refused, the flight is, too; where they give none, because it
            does not fit, the field stays as it was.

    Raises:
        AssertionError: `ATTEMPTS_MAX` draws were all refused, which is a defect of this package.
    """
    genes, found = _permitted(campaign_seed, number)
    if moved:
        genes = Genes(genes.seed, moved)
        found = _drawn(genes) or found
    name = f"{SOURCE}-{campaign_seed}-{number}"
    return _case(genes, found, name)


def adversary_genes(campaign_seed: int, number: int) -> Genes:
    """Return the genes of a flight as they were drawn."""
    return _permitted(campaign_seed, number)[0]


def _permitted(campaign_seed: int, number: int) -> tuple[Genes, _Draw]:
    """Draw until the pre-flight check permits the flight."""
    for attempt in range(ATTEMPTS_MAX):
        genes = Genes(f"{SOURCE} {campaign_seed} {number} {attempt}")
        found = _drawn(genes)
        if found is not None and _may_fly(found):
            return genes, found
    raise AssertionError(f"{ATTEMPTS_MAX} draws gave no flight that may be flown")


def _drawn(genes: Genes) -> _Draw | None:
    kind = genes.choice("kind", _KINDS)
    timing = timing_of(genes)
    contract = adversary_contract(genes, timing, kind)
    if contract is None:
        return None
    assessment = assess(contract)
    course = course_of(genes, assessment, kind)
    if course is None or not len(course.obstacles):
        return None
    # What the operator says of the start must be true.
    clear_m = start_clear_radius_m(assessment)
    if face_distances_m(course.obstacles, (0.0, 0.0)).min() < clear_m:
        return None
    mission = Mission.model_validate(
        {
            "altitude_m": _ALTITUDE_M,
            "heading": genes.choice("nose", ("leg", "path")) if kind != "lane" else "leg",
            "start_clear_m": clear_m,
            "legs": [
                {"end_ned_m": end_m, "target_half_width_m": course.half_width_m}
                for end_m in course.ends_ned_m
            ],
        }
    )
    return _Draw(kind, contract, timing, course, mission)


def _may_fly(found: _Draw) -> bool:
    """Tell whether the pre-flight check permits it; of a lane it knows the field, too."""
    known = found.course.obstacles if found.kind == "lane" else None
    checked = check(found.contract, known, found.mission)
    return checked.compliant if found.kind == "lane" else checked.may_fly


def _case(genes: Genes, found: _Draw, name: str) -> FlightCase:
    contract, timing, course = found.contract, found.timing, found.course
    plant = adversary_plant(genes, contract, timing, _ALTITUDE_M, course.heading_rad)
    lane = found.kind == "lane"
    shares = {"reaction": timing.reaction_s / contract.vehicle.reaction_time_s}
    if lane:
        shares |= clause_shares(assess(contract))
    text = genes_text(genes.moved)
    scenario = Scenario(
        name=f"{name} {text}" if text else name,
        contract=contract,
        mission=found.mission,
        obstacles=course.obstacles,
        plant=plant,
        faults=(),
        field_known=lane,
        fly_outside_contract=False,
        expect=Expectation.model_validate({}),
    )
    return FlightCase(
        scenario,
        seed=round(genes.value("simulation") * _SEED_MAX),
        variant=found.kind,
        trigger=strategy_of(genes, contract),
        outcomes=("arrived", "held") if lane else ("arrived", "held", "aborted"),
        # A moved draw may break the rules of fields, which is not a finding.
        refusable=bool(genes.moved),
        # Without a promise of arrival a vehicle may look for another way for minutes.
        time_limit_s=None if lane else _SEARCHING_MAX_S,
        adversary=Adversary(
            kind=found.kind,
            strategy=strategy_of(genes, contract),
            genes=genes.moved,
            by_draw=shares,
        ),
    )
