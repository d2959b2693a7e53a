"""The table from assumptions to evidence: complete, up to date, and of things that exist."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from gcs_tools.campaign.generator.generators import GENERATORS
from gcs_tools.campaign.table import write_table
from onboard.contract.assessment import assess_terms
from onboard.contract.terms import Terms
from onboard.files.contract_file import load_contract
from onboard.monitoring.adaptation import WORSENINGS
from onboard.monitoring.assumptions import Assumption
from tests.gcs_tools.campaign.rows import row
from tests.tools.traceability.__main__ import main
from tests.tools.traceability.chain import (
    ROOT,
    SCENARIOS,
    TERMS,
    chain,
    clauses_of,
    full_assessment,
)
from tests.tools.traceability.figures import Figure, figures_of, stated_figures, write_figures
from tests.tools.traceability.page import HEAD, PAGE, page, table


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_assumption_has_a_row_and_no_cell_is_empty() -> None:
    rows = table()
    assert [cells[0] for cells in rows] == [f"`{each.value}`" for each in Assumption]
    empty = [(cells[0], HEAD[n]) for cells in rows for n, cell in enumerate(cells) if not cell]
    assert empty == []


def test_what_the_rows_name_exists() -> None:
    for link in chain():
        assert {each.name for each in full_assessment().clauses} >= set(link.clauses)
        assert all((ROOT / f"{each.replace('.', '/')}.py").is_file() for each in link.monitors)
        assert all((SCENARIOS / f"{each}.yaml").is_file() for each in link.scenarios)
        assert {term.name for term in dataclasses.fields(Terms)} >= set(link.terms)


def test_figures_are_of_assumptions_and_campaigns_that_exist() -> None:
    for figure in stated_figures():
        assert Assumption(figure.assumption)
        assert figure.campaign in GENERATORS or (ROOT / figure.campaign).is_file()
        assert figure.flights >= figure.failed >= figure.covered >= figure.collided


@pytest.mark.parametrize("which", WORSENINGS, ids=str)
def test_what_is_adapted_to_is_a_term_of_the_row(which: tuple[Assumption, str]) -> None:
    terms = full_assessment().terms
    measured = 1e-3 if which[0] in _SHRINKING else 1e3
    worse = WORSENINGS[which](terms, measured)
    changed = {
        each.name
        for each in dataclasses.fields(Terms)
        if getattr(worse, each.name) != getattr(terms, each.name)
    }
    assert changed & set(TERMS[which[0]])


_SHRINKING = {Assumption.DETECTION_RANGE, Assumption.FIELD_OF_VIEW, Assumption.ROI_INTERSECTION}


def test_every_clause_rests_on_an_assumption() -> None:
    """But the thrust, which is a constant of the airframe."""
    named = {clause for link in chain() for clause in link.clauses}
    assert {each.name for each in full_assessment().clauses} - named == {"thrust"}


def test_the_clauses_of_a_term_are_those_that_move_with_it() -> None:
    assert clauses_of("tracking_error_z_m") == ("ground_clearance",)
    assert clauses_of("obstacle_separation_min_m") == ("separation",)
    assert "passive_safety" in clauses_of("setpoint_loss_timeout_s")


def test_a_contract_that_states_less_has_fewer_clauses() -> None:
    contract = load_contract(ROOT / "config" / "default_contract.yaml")
    stated = {each.name for each in full_assessment().clauses}
    assert {each.name for each in assess_terms(contract, Terms.of(contract)).clauses} < stated


def test_flights_are_counted_by_what_failed_in_them() -> None:
    rows = [
        row(number=0, violations="wind"),
        row(number=1, violations="wind\ntilt_response", collisions=1),
        row(number=2, violations="wind", covered=False, collisions=1),
        row(number=3, violations=""),
        row(number=4, violations="wind", refused=True),
    ]
    source, seed = rows[0].source, rows[0].campaign_seed
    assert figures_of(rows) == [
        Figure("tilt_response", source, seed, 4, 1, 1, 1),
        Figure("wind", source, seed, 4, 3, 2, 1),
    ]


def test_several_directories_are_counted_together_and_each_flight_once(tmp_path: Path) -> None:
    for name, count in (("short", 2), ("long", 4)):
        (tmp_path / name).mkdir()
        rows = [row(number=number, violations="wind") for number in range(count)]
        write_table(rows, tmp_path / name / "flights.parquet")
    kept = [Figure("wind", "faults", 9, 50, 3, 3, 0), Figure("wind", row().source, 1, 9, 9, 9, 0)]
    table = tmp_path / "figures.csv"
    write_figures([tmp_path / "short", tmp_path / "long"], table, kept)
    assert stated_figures(table) == (kept[0], Figure("wind", row().source, 1, 4, 4, 4, 0))


def test_the_command_writes_elsewhere_what_it_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_table([row(violations="wind")], tmp_path / "flights.parquet")
    before = PAGE.read_text(encoding="utf-8")
    out = tmp_path / "out"
    assert main(["--figures", str(tmp_path), "--add", "--output", str(out)]) == 0
    assert PAGE.read_text(encoding="utf-8") == before
    written = (out / PAGE.name).read_text(encoding="utf-8")
    assert f"{row().source}: 1 of 1, 0 collisions" in written
    assert len(stated_figures(out / "campaign_figures.csv")) == len(stated_figures()) + 1
    assert main(["--figures", str(tmp_path / "nowhere"), "--output", str(out)]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_a_bound_is_stated_where_it_says_something() -> None:
    assert str(Figure("wind", "faults", 1, 150, 3, 2, 0)) == "faults: 3 of 150, 0 collisions"
    many = Figure("wind", str(Path("a") / "b.yaml"), 1, 400, 300, 299, 0)
    assert str(many) == "b: 300 of 400, 0 collisions in 299 covered (≤ 1.0%)"
