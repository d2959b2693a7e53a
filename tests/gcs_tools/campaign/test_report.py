"""The summary of a campaign: verdict, classes, findings."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.campaign.flight import replay_command
from gcs_tools.campaign.report import write_report
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.campaign.rows import row


def written(path: Path, *rows: object) -> str:
    write_report(list(rows), path / "summary.html")  # type: ignore[arg-type]
    return (path / "summary.html").read_text(encoding="utf-8")


def test_a_good_campaign_says_so(tmp_path: Path) -> None:
    page = written(tmp_path, row(), row(number=1, clearance_min_m=0.25))
    assert "<h1>Campaign: every flight passed</h1>" in page
    assert "2 flights, 0.0 h flown." in page
    assert "<td>0.25 m</td>" in page
    assert "at 95%" in page
    assert "<pre>" not in page
    assert page.count("<svg") == 1


def test_a_failed_flight_is_named_with_its_command_and_findings(tmp_path: Path) -> None:
    bad = row(number=3, findings="no_collision: 1 collision(s)\noutcome: <held>")
    page = written(tmp_path, row(), bad)
    assert "1 of 2 flights failed" in page
    assert f"<h3>{replay_command(bad)}</h3>" in page
    assert "no_collision: 1 collision(s)\noutcome: &lt;held&gt;" in page
    assert '<tr class="failed">' in page


def test_classes_without_a_promise_are_marked_and_not_in_the_total(tmp_path: Path) -> None:
    page = written(tmp_path, row(), row(number=1, variant="gust", covered=False, collisions=2))
    assert "gust (nothing promised)" in page
    total = page[page.index('<tr class="total">') :]
    assert total.split("<td>")[1:4] == ["all</td>", "covered</td>", "1</td>"]


def test_a_class_that_never_flew_has_no_collision_rate(tmp_path: Path) -> None:
    refused = row(refused=True, outcome="aborted", clearance_min_m=None)
    page = written(tmp_path, refused)
    cells = page[page.index("<td>quick</td>") :].split("</tr>")[0].split("<td>")
    assert cells[9] == "</td>"
    assert cells[12].startswith("</td>")


def test_an_empty_campaign_is_still_a_page(tmp_path: Path) -> None:
    assert "every flight passed" in written(tmp_path)


def test_a_summary_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="cannot be written"):
        write_report([row()], tmp_path / "nowhere" / "summary.html")


def test_a_replay_quotes_its_source() -> None:
    command = replay_command(row(source="my forest.csv", campaign_seed=2, number=9))
    assert command == "clearway campaign 'my forest.csv' --seed 2 --only 9"
