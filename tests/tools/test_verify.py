"""The long shows as one command: what is run, what is judged bad, and where it goes on."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from gcs_tools.benchmark.suites import BENCHMARKS
from gcs_tools.campaign.flight import FlightRow
from gcs_tools.campaign.table import write_table
from tests.gcs_tools.campaign.rows import row
from tests.tools.mutation.__main__ import PARTS
from tests.tools.verify.__main__ import main
from tests.tools.verify.judging import (
    judge_ambush,
    judge_bench,
    judge_campaign,
    judge_mutants,
    judge_traceability,
)
from tests.tools.verify.plan import ROOT, Request, Step, plan
from tests.tools.verify.running import Record, run_steps, summary

COMMIT = "abc1234"


def steps(*, short: bool = False, data: Path | None = None) -> dict[str, Step]:
    request = Request(Path("out"), short, data, jobs=2)
    return {step.name: step for step in plan(request)}


# ------------------------------------------------------------------ what is run


def test_the_full_form_flies_what_is_shown() -> None:
    full = {name: " ".join(step.command) for name, step in steps().items()}
    for name, size in {
        "adversary": "adversary --flights 2000 --seed 1 --search 480",
        "nominal": "nominal --flights 10000 --seed 1",
        "faults": "faults --flights 3000 --seed 1",
        "movers": "movers --flights 1000 --seed 1",
        "pedestrians": "pedestrians --flights 200 --seed 1",
    }.items():
        assert full[name] == f"clearway campaign {size} --jobs 2 --out out/{name}"
    assert full["scenarios"].count(".yaml") == len(list((ROOT / "config/scenarios").glob("*.yaml")))
    assert {f"benchmark-{name}" for name in BENCHMARKS} <= full.keys()
    assert {f"mutation-{part}" for part in PARTS} <= full.keys()
    assert list(full)[-1] == "traceability"


def test_mutants_are_the_samples_of_the_page() -> None:
    page = (ROOT / "docs" / "mutation.md").read_text(encoding="utf-8")
    stated = re.findall(r"^python -m tests.tools.mutation (.*)$", page, re.MULTILINE)
    planned = [
        " ".join(step.command).partition("tests.tools.mutation ")[2].removesuffix(" --resume")
        for step in steps().values()
        if step.name.startswith("mutation-")
    ]
    assert sorted(planned) == sorted(stated)


def test_the_short_form_runs_every_kind_of_step_on_little() -> None:
    short, full = steps(short=True), steps()
    kinds = {name.partition("-")[0] for name in full}
    assert {name.partition("-")[0] for name in short} == kinds
    for name in ("adversary", "nominal", "faults", "movers", "pedestrians"):
        command = short[name].command
        assert int(command[command.index("--flights") + 1]) <= 20
    assert len(short["scenarios"].command) < len(full["scenarios"].command) / 4
    assert "--small" in short["bench"].command
    # The full form has to fill every cell by what it flies itself.
    assert "--add" in short["traceability"].command
    assert "--add" not in full["traceability"].command
    assert all("--legs" in step.command for name, step in short.items() if "benchmark-" in name)


def test_benchmarks_without_their_data_are_skipped_with_a_sentence(tmp_path: Path) -> None:
    without, given = steps(), steps(data=tmp_path)
    skipped = {name for name, step in without.items() if step.skipped}
    files = ("longleaf", "competition", "sando", "sando-dynamic", "dodgedrone")
    assert skipped == {f"benchmark-{name}" for name in files}
    assert all("DATA=" in without[name].skipped for name in skipped)
    assert not any(step.skipped for step in given.values())
    assert str(tmp_path) in given["benchmark-sando"].command
    assert "--data" not in given["benchmark-forest"].command
    assert "--service" in given["benchmark-sando-dynamic"].command
    assert "--service" not in given["benchmark-sando"].command


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--data", "/nowhere/at/all"], "/nowhere/at/all"),
        (["--jobs", "0"], "expected at least 1"),
        (["--only", "nominal", "nomimal"], "nomimal: expected some of adversary, nominal"),
    ],
)
def test_bad_arguments_are_refused(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err


# ------------------------------------------------------------------ what is judged


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([row(), row(number=1)], None),
        ([row(collisions=1)], "1 collisions in flights that promise none"),
        ([row(collisions=1, covered=False)], None),
        ([row(findings="clearance: negative")], "1 flights with findings"),
        ([row(least_margin_m=-0.01)], "1 flights with a negative margin"),
        ([row(least_margin_m=0.01)], None),
        ([row(), row(number=1, genes="x=1", collisions=1)], "1 collisions"),
        ([row(refused=True)], "no flight was flown"),
    ],
)
def test_a_campaign_is_good_without_collision_finding_and_negative_margin(
    tmp_path: Path, rows: list[FlightRow], problem: str | None
) -> None:
    write_table(rows, tmp_path / "flights.parquet")
    found = judge_campaign(tmp_path, "")
    if problem is None:
        assert found.problems == ()
    else:
        (told,) = found.problems
        assert problem in told


def test_a_campaign_is_stated_in_figures(tmp_path: Path) -> None:
    rows = [row(number=number, least_margin_m=0.1 + number) for number in range(3)]
    rows.append(row(number=0, genes="x=1", least_margin_m=0.05))
    write_table(rows, tmp_path / "flights.parquet")
    figures = judge_campaign(tmp_path, "").figures
    assert figures["flights"] == figures["covered by a promise"] == "3"
    assert figures["flights of the search"] == "1"
    assert figures["least margin"] == "0.0500 m"
    assert figures["95 % bound on collisions"] == "63.160%"


def test_an_ambush_without_a_contact_shows_nothing(tmp_path: Path) -> None:
    assert steps()["ambush"].judge is judge_ambush
    hit = row(number=1, covered=False, collisions=1, outcome="collided")
    for rows, problems in (([row()], 1), ([row(), hit], 0)):
        write_table(rows, tmp_path / "flights.parquet")
        found = judge_ambush(tmp_path, "")
        assert len(found.problems) == problems
        assert found.figures["with a contact in motion"] == str(len(rows) - 1)


def test_a_missed_limit_is_named(tmp_path: Path) -> None:
    good = {"value": 2.0, "unit": "ms", "limit": 3.0, "ratio_min": None, "passes": True}
    measured = {
        "fine": good,
        "late": good | {"value": 4.0, "passes": False},
        "slow": good | {"limit": None, "ratio_min": 15.0, "passes": False},
        "shown": good | {"limit": None, "passes": None},
    }
    (tmp_path / "bench.json").write_text(json.dumps(measured), encoding="utf-8")
    found = judge_bench(tmp_path, "")
    assert found.problems == ("late: 4 ms, limit 3", "slow: 2 ms, limit 15 times its peer")
    assert found.figures["limits kept"] == "1 of 3"
    assert steps(short=True)["bench"].judge(tmp_path, "").problems == ()
    assert steps()["bench"].judge(tmp_path, "").problems == found.problems


def test_an_empty_cell_is_named(tmp_path: Path) -> None:
    (tmp_path / "campaign_figures.csv").write_text("assumption\nwind\nwind\n", encoding="utf-8")
    rows = "| `wind` | a | b |\n| `flight_time` | a |  |\n"
    (tmp_path / "traceability.md").write_text(rows, encoding="utf-8")
    found = judge_traceability(tmp_path, "")
    assert found.problems == ("empty cell: flight_time",)
    assert found.figures == {
        "assumptions": "2",
        "with figures of campaigns": "1",
        "figures": "2",
    }


def test_the_score_is_the_last_one_printed() -> None:
    printed = "one: survived\nrun-on: 119 of 123 mutants noticed, 4 cannot be: 100.0 %\n"
    assert judge_mutants(Path(), printed).figures["score"].startswith("119 of 123")
    assert judge_mutants(Path(), "nothing").problems


# ------------------------------------------------------------------ running


class Runs:
    """Stands in for the commands: each leaves a table, and ends with a code."""

    def __init__(self, codes: Sequence[int] = (), rows: Sequence[FlightRow] = ()) -> None:
        self.codes, self.rows = list(codes), list(rows) or [row()]
        self.commands: list[str] = []

    def __call__(self, command: Sequence[str], log: Path) -> tuple[int, float]:
        self.commands.append(command[-1])
        if (log.parent / "flights.parquet").exists():
            self.commands.append("goes on")
        write_table(self.rows, log.parent / "flights.parquet")
        log.write_text("done\n", encoding="utf-8")
        return (self.codes.pop(0) if self.codes else 0), 61.0


SHOWS = [
    Step("first", ("clearway", "campaign", "one"), judge_campaign),
    Step("second", ("clearway", "campaign", "two"), judge_campaign),
    Step("third", ("clearway", "campaign", "three"), judge_campaign, "no data"),
]


def ran(folder: Path, runs: Runs, commit: str = COMMIT) -> dict[str, Record]:
    return run_steps(SHOWS, folder, commit, runs, lambda _: None)


def test_what_has_a_verdict_on_this_commit_is_not_run_again(tmp_path: Path) -> None:
    assert ran(tmp_path, runs := Runs()).keys() == {"first", "second", "third"}
    assert runs.commands == ["one", "two"]
    ran(tmp_path, again := Runs())
    assert again.commands == []
    # Another commit: everything is flown again, and nothing is left of the one before.
    ran(tmp_path, other := Runs(), "def5678")
    assert other.commands == ["one", "two"]


def test_an_interrupted_step_goes_on_with_what_it_has_left(tmp_path: Path) -> None:
    records = ran(tmp_path, Runs([0, 130]))
    assert "ended with exit code 130" in records["second"].problems[0]
    ran(tmp_path, again := Runs())
    assert again.commands == ["two", "goes on"]


@pytest.mark.parametrize(
    ("runs", "problem"),
    [
        (Runs([1]), "said no (exit code 1)"),
        (Runs([1], [row(collisions=1)]), "1 collisions in flights that promise none"),
        (Runs([2]), "ended with exit code 2"),
    ],
)
def test_a_step_that_says_no_is_a_problem(tmp_path: Path, runs: Runs, problem: str) -> None:
    assert problem in ran(tmp_path, runs)["first"].problems[0]


def test_what_leaves_nothing_is_not_good(tmp_path: Path) -> None:
    records = run_steps(SHOWS[:1], tmp_path, COMMIT, lambda *_: (0, 1.0), lambda _: None)
    assert "left nothing that can be judged" in records["first"].problems[0]


def test_the_summary_states_commit_commands_figures_and_durations(tmp_path: Path) -> None:
    text = summary(ran(tmp_path, Runs()), COMMIT, short=False)
    assert f"Commit {COMMIT}; full form. No problem." in text
    assert "| first | good | flights: 1; " in text
    assert "| 1 min 1 s |" in text
    assert "| third | skipped: no data |" in text
    assert "```sh\nclearway campaign one\nclearway campaign two\n```" in text
    bad = summary(ran(tmp_path / "bad", Runs([1])), COMMIT, short=True)
    assert "**1 of 3 steps found a problem.**" in bad
    assert "| first | **said no (exit code 1)" in bad
