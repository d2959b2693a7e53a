"""Where the flights of a campaign come from."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.campaign.command import CampaignRequest, _jobs, _source, scenario_document
from gcs_tools.campaign.forest import ForestSource
from gcs_tools.campaign.generator.case import NO_FAULT
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.campaign.sources import AdversarySource, FileSource, GeneratedSource
from gcs_tools.console.errors import CommandError
from gcs_tools.scenario import load_scenario
from sitl.virtual.faults.schema import Fault
from tests.gcs_tools.running import CONFIG

PAPER = load_scenario(CONFIG / "paper.yaml")


def test_a_generator_draws_by_seed_and_number() -> None:
    source = GeneratedSource("quick")
    assert source.case(3, 4).scenario.name == "quick-3-4"
    assert source.case(3, 4).seed == generated("quick", 3, 4).seed


def test_a_file_is_flown_with_one_seed_after_another() -> None:
    source = FileSource("paper.yaml", PAPER)
    cases = [source.case(10, number) for number in range(3)]
    assert [case.seed for case in cases] == [10, 11, 12]
    assert all(case.scenario is PAPER for case in cases)
    assert {case.variant for case in cases} == {NO_FAULT}
    assert all(case.expectation and case.covered for case in cases)


def test_a_file_s_first_fault_is_its_variant_and_a_collision_its_expectation() -> None:
    faulty = replace(
        PAPER,
        faults=(Fault(kind="gust", amount=3.0),),
        expect=PAPER.expect.model_copy(update={"collisions": 1, "outcome": "collided"}),
    )
    case = FileSource("gust.yaml", faulty).case(1, 0)
    assert (case.variant, case.covered, case.outcomes) == ("gust", False, ("collided",))


@pytest.mark.parametrize("source", [GeneratedSource("quick"), FileSource("paper.yaml", PAPER)])
def test_sources_travel_to_other_processes(source: Any) -> None:
    again = pickle.loads(pickle.dumps(source))  # noqa: S301  our own bytes
    assert again.name == source.name
    assert scenario_document(again.case(1, 2).scenario) == scenario_document(
        source.case(1, 2).scenario
    )


def test_a_name_tells_the_kind_of_source(
    tmp_path: Path, written: Callable[[str, Any], Path]
) -> None:
    assert _source("nominal") == GeneratedSource("nominal")
    assert _source("adversary", "late=0.5") == AdversarySource((("late", 0.5),))
    path = written("drawn.yaml", scenario_document(PAPER))
    assert isinstance(_source(str(path)), FileSource)
    stems = tmp_path / "stems.csv"
    stems.write_text("x_m,y_m,dbh_cm\n1.0,2.0,30.0\n", encoding="utf-8")
    assert isinstance(_source(str(stems)), ForestSource)
    with pytest.raises(CommandError, match="absent: unknown scenario; expected a scenario file"):
        _source("absent")


def request(**changes: Any) -> CampaignRequest:
    return replace(CampaignRequest(scenarios=("quick", "nominal"), flights=5, seed=9), **changes)


def test_flights_are_divided_evenly_and_numbered_per_source() -> None:
    sources = [GeneratedSource("quick"), GeneratedSource("nominal")]
    jobs = [(job.source.name, job.campaign_seed, job.number) for job in _jobs(sources, request())]
    assert jobs == [
        ("quick", 9, 0), ("nominal", 9, 0), ("quick", 9, 1), ("nominal", 9, 1), ("quick", 9, 2),
    ]  # fmt: skip


def test_a_replay_is_one_number_of_each_source() -> None:
    sources = [GeneratedSource("quick"), GeneratedSource("nominal")]
    jobs = _jobs(sources, request(only=77))
    assert [(job.source.name, job.number) for job in jobs] == [("quick", 77), ("nominal", 77)]


def test_no_flights_are_no_jobs() -> None:
    assert _jobs([GeneratedSource("quick")], request(flights=0)) == []
