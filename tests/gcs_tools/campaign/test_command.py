"""`clearway campaign` around its flights: what it goes on with, what it prints, what it keeps."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console

from gcs_tools.campaign import command
from gcs_tools.campaign.command import (
    CampaignRequest,
    _cells,
    _flown_before,
    _prepared,
    _print_failures,
    run_campaign,
    scenario_document,
)
from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.campaign.search import SearchJob
from gcs_tools.campaign.shrink import Shrunk
from gcs_tools.campaign.sources import GeneratedSource
from gcs_tools.campaign.statistics import summarize
from gcs_tools.campaign.table import read_table, write_table
from gcs_tools.campaign.workers import FlightJob
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.campaign.rows import row

QUICK = GeneratedSource("quick")


def request(out: Path, **changes: Any) -> CampaignRequest:
    return CampaignRequest(
        **{"scenarios": ("quick",), "flights": 4, "seed": 1, "out": out, **changes}
    )


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Fly by rule: flight 2 fails; return the numbers that were flown."""
    numbers: list[int] = []

    def fly(jobs: Iterable[FlightJob], _: int) -> Iterator[FlightRow]:
        for job in jobs:
            numbers.append(job.number)
            findings = "no_collision: 1 collision(s)" if job.number == 2 else ""
            yield row(
                source=job.source.name,
                campaign_seed=job.campaign_seed,
                number=job.number,
                findings=findings,
            )

    monkeypatch.setattr(command, "fly_locally", fly)
    monkeypatch.setattr(command, "shrink", lambda *_: None)
    return numbers


def test_a_campaign_leaves_table_summary_and_failed_scenarios(
    flown: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_campaign(request(tmp_path)) is False
    assert flown == [0, 1, 2, 3]
    assert [each.number for each in read_table(tmp_path / "flights.parquet")] == [0, 1, 2, 3]
    assert "1 of 4 flights failed" in (tmp_path / "summary.html").read_text(encoding="utf-8")
    (kept,) = (tmp_path / "failed").iterdir()
    text = kept.read_text(encoding="utf-8")
    assert text.startswith(
        "# clearway campaign quick --seed 1 --only 2\n# no_collision: 1 collision(s)\n"
    )
    assert yaml.safe_load(text) == scenario_document(generated("quick", 1, 2).scenario)
    out = capsys.readouterr().out
    assert "failed no_collision: 1 collision(s)" in out
    assert "clearway campaign quick --seed 1 --only 2" in out


def test_a_good_campaign_leaves_no_scenarios(flown: list[int], tmp_path: Path) -> None:
    assert run_campaign(request(tmp_path, flights=2)) is True
    assert flown == [0, 1]
    assert not (tmp_path / "failed").exists()


def test_flights_in_the_table_are_not_flown_again(
    flown: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_table([row(number=0), row(number=3)], tmp_path / "flights.parquet")
    run_campaign(request(tmp_path))
    assert flown == [1, 2]
    assert "2 flights are already in" in capsys.readouterr().out


def test_what_was_flown_before_an_interruption_is_kept(
    flown: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fly(jobs: Iterable[FlightJob], _: int) -> Iterator[FlightRow]:
        for job in jobs:
            if job.number == 2:
                raise KeyboardInterrupt
            yield row(number=job.number)

    monkeypatch.setattr(command, "fly_locally", fly)
    with pytest.raises(KeyboardInterrupt):
        run_campaign(request(tmp_path))
    assert [each.number for each in read_table(tmp_path / "flights.parquet")] == [0, 1]


def test_progress_is_written_now_and_then(
    flown: list[int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(command, "_ROWS_BETWEEN_WRITES", 2)
    run_campaign(request(tmp_path))
    out = capsys.readouterr().out
    assert "2 of 4 flights, 0 failed" in out
    assert "4 of 4 flights, 1 failed" in out


def test_a_failed_flight_is_shrunk_to_a_scenario_and_a_command(
    flown: list[int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[tuple[frozenset[str], int]] = []

    def shrink(document: Any, oracles: frozenset[str], seed: int, _: int) -> Shrunk:
        asked.append((oracles, seed))
        return Shrunk({**document, "faults": []}, "no_collision: still", 12)

    monkeypatch.setattr(command, "shrink", shrink)
    run_campaign(request(tmp_path))
    seed = generated("quick", 1, 2).seed
    assert asked == [(frozenset({"no_collision"}), seed)]
    minimal = tmp_path / "failed" / "minimal-quick-1-2.yaml"
    text = minimal.read_text(encoding="utf-8")
    assert text.startswith(f"# clearway campaign {minimal} --seed {seed} --only 0\n")
    assert "# no_collision: still\n" in text
    assert "shrunk in 12 flights" in capsys.readouterr().out


def test_no_failed_flight_is_shrunk_if_none_is_to_be(
    flown: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shrink(*_: Any) -> None:
        raise AssertionError("was not asked for")

    monkeypatch.setattr(command, "shrink", shrink)
    run_campaign(request(tmp_path, shrink=0))


# ---------------------------------------------------------------------------- parts


def test_a_directory_is_named_after_what_it_is_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    several = CampaignRequest(scenarios=("a.yaml", "quick", "faults", "x"), flights=1, seed=7)
    assert _prepared(several) == Path("campaigns/a-quick-faults-7")
    replay = CampaignRequest(scenarios=("quick",), flights=1, seed=7, only=12)
    assert _prepared(replay) == Path("campaigns/quick-7-12")
    assert Path("campaigns/quick-7-12").is_dir()


def test_a_directory_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CommandError, match="cannot be written"):
        _prepared(request(tmp_path / "file" / "out"))


def test_a_table_of_another_campaign_is_not_added_to(tmp_path: Path) -> None:
    path = tmp_path / "flights.parquet"
    write_table([row(campaign_seed=8)], path)
    with pytest.raises(CommandError, match="has flights of another campaign: use another --out"):
        _flown_before(path, [FlightJob(QUICK, 1, 0)])
    assert _flown_before(tmp_path / "none.parquet", [FlightJob(QUICK, 1, 0)]) == []


def test_only_the_first_failures_are_printed() -> None:
    text = io.StringIO()
    failed = [row(number=number, findings=f"outcome: [held] {number}") for number in range(23)]
    _print_failures(failed, Console(file=text, width=200))
    lines = text.getvalue().splitlines()
    assert lines[0] == "failed outcome: [held] 0"
    assert len(lines) == 2 * 20 + 1
    assert lines[-1] == "… and 3 more, in the table"


@pytest.mark.parametrize(
    ("changes", "rate"),
    [
        ({}, "≤ 95.00%"),
        ({"collisions": 1}, "5.00% to 100.00%"),
        ({"refused": True}, ""),
    ],
)
def test_a_class_has_a_collision_rate_if_it_flew(changes: dict[str, Any], rate: str) -> None:
    (summary,) = summarize([row(**changes)])
    assert _cells(summary)[9] == rate
    assert _cells(summary)[10] == "0.50 m"


@pytest.mark.parametrize("changes", [{"search": 5}, {"genes": "late=0.5"}])
def test_only_an_adversary_searches(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(CommandError, match="--search and --genes: only the scenario adversary"):
        run_campaign(request(tmp_path, **changes))


def test_an_adversary_searches_near_its_worst_flights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fly(jobs: Iterable[FlightJob], _: int) -> Iterator[FlightRow]:
        for job in jobs:
            yield row(source="adversary", number=job.number, least_margin_m=1.0 + job.number)

    def search(jobs: Iterable[SearchJob], _: int) -> Iterator[list[FlightRow]]:
        for job in jobs:
            yield [
                row(
                    source="adversary", number=job.number, least_margin_m=0.25,
                    least_margin_of="rest", genes="late=0.5000",
                )
            ] * job.flights  # fmt: skip

    monkeypatch.setattr(command, "fly_locally", fly)
    monkeypatch.setattr(command, "search_locally", search)
    for _ in range(2):  # the second time goes on from the first, and searches again
        assert run_campaign(request(tmp_path, scenarios=("adversary",), search=3))
        assert len(read_table(tmp_path / "flights.parquet")) == 7
    said = capsys.readouterr().out
    assert "clearway campaign adversary --seed 1 --only 0 --genes late=0.5000" in said
