"""One row of a campaign, made of a flight's case and result."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from gcs_tools.campaign import flight
from gcs_tools.campaign.adversary.shares import ErrorMeter
from gcs_tools.campaign.flight import _time_limit_s, fly_numbered
from gcs_tools.campaign.generator.case import FlightCase
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.campaign.oracles.evidence import Evidence
from gcs_tools.scenario import Scenario
from tests.gcs_tools.campaign.oracles.evidence import flown, result


@dataclass(frozen=True)
class OneCase:
    """A source of one flight."""

    one: FlightCase
    name: str = "quick"

    def case(self, _seed: int, _number: int) -> FlightCase:
        return self.one


CASE = generated("quick", 1, 0)
REFUSED = replace(
    CASE,
    scenario=replace(
        CASE.scenario,
        contract=CASE.scenario.contract.model_copy(
            update={
                "sensor": CASE.scenario.contract.sensor.model_copy(
                    update={"detection_range_m": 1.0}
                )
            }
        ),
    ),
)


def test_a_row_has_the_numbers_of_its_contract_and_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def fly(case: FlightCase, _: ErrorMeter) -> Evidence:
        return replace(flown(ended=result(collisions=1, violations=("a", "b"))), case=case)

    monkeypatch.setattr(flight, "fly_case", fly)
    row = fly_numbered(OneCase(CASE), 5, 6)
    vehicle = CASE.scenario.contract.vehicle
    assert (row.source, row.campaign_seed, row.number, row.seed) == ("quick", 5, 6, CASE.seed)
    assert (row.cruise_speed_mps, row.roll_max_deg) == (
        vehicle.cruise_speed_mps,
        vehicle.roll_max_deg,
    )
    assert (row.collisions, row.obstacles) == (1, len(CASE.scenario.obstacles))
    assert row.violations == "a\nb"
    assert row.tracking_share == row.true_tracking_error_m / vehicle.tracking_error_m
    assert "no_collision: 1 collision(s)" in row.findings.splitlines()
    assert not row.good
    assert row.csb_shape in {"flat", "pointed"}


def test_a_refusal_of_a_flight_that_must_arrive_is_a_finding() -> None:
    row = fly_numbered(OneCase(REFUSED), 1, 0)
    assert row.refused
    assert row.outcome == "aborted"
    assert row.reason.startswith("refused: ")
    assert row.findings == f"outcome: {row.reason}"
    assert row.virtual_s == 0.0


@pytest.mark.parametrize("changes", [{"refusable": True}, {"outcomes": ("aborted",)}])
def test_an_expected_refusal_is_no_finding(changes: dict[str, object]) -> None:
    row = fly_numbered(OneCase(replace(REFUSED, **changes)), 1, 0)  # type: ignore[arg-type]
    assert row.refused
    assert row.good


def test_a_flight_outside_its_contract_is_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    reached: list[Scenario] = []

    def fly(case: FlightCase, _: ErrorMeter) -> Evidence:
        reached.append(case.scenario)
        raise ZeroDivisionError("far enough")

    monkeypatch.setattr(flight, "fly_case", fly)
    outside = replace(REFUSED, scenario=replace(REFUSED.scenario, fly_outside_contract=True))
    row = fly_numbered(OneCase(outside), 1, 0)
    assert reached == [outside.scenario]
    assert not row.refused
    assert row.outcome == "aborted"
    assert row.reason == "ZeroDivisionError: far enough"
    assert row.findings.startswith("exception: ")


def test_a_field_that_is_not_known_is_not_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    violating = next(
        case
        for case in (generated("violating", 1, number) for number in range(50))
        if not case.scenario.field_known
    )
    monkeypatch.setattr(flight, "fly_case", lambda case, _: replace(flown(), case=case))
    assert not fly_numbered(OneCase(violating), 1, 0).refused
    known = replace(violating, scenario=replace(violating.scenario, field_known=True))
    assert fly_numbered(OneCase(known), 1, 0).refused


def test_a_longer_or_slower_mission_has_more_time() -> None:
    requirements = CASE.scenario.contract.requirements.model_copy(update={"stop": False})
    pure = CASE.scenario.contract.model_copy(update={"requirements": requirements})
    scenario = replace(CASE.scenario, contract=pure)
    limit_s = _time_limit_s(scenario)
    (leg,) = scenario.mission.legs
    north_m, east_m = leg.end_ned_m
    farther = leg.model_copy(update={"end_ned_m": (2.0 * north_m, 2.0 * east_m)})
    longer = replace(scenario, mission=scenario.mission.model_copy(update={"legs": (farther,)}))
    assert _time_limit_s(longer) - 90.0 == pytest.approx(2.0 * (limit_s - 90.0))
    vehicle = scenario.contract.vehicle
    slow = vehicle.model_copy(update={"cruise_speed_mps": vehicle.cruise_speed_mps / 2.0})
    contract = scenario.contract.model_copy(update={"vehicle": slow})
    slower = _time_limit_s(replace(scenario, contract=contract))
    assert slower == pytest.approx(_time_limit_s(longer))
