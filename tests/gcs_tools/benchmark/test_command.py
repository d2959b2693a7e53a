"""`clearway benchmark`: small scenes of each format, flown and reported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from gcs_tools.benchmark import command, suites
from gcs_tools.benchmark.command import BenchmarkRequest, command_line
from gcs_tools.benchmark.legs import LegRow
from tests.gcs_tools.benchmark.public_files import write_all
from tests.gcs_tools.benchmark.rows import row
from tests.gcs_tools.running import Clearway


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the data, and make legs of fixed length short."""
    for name in ("_SANDO_LEG_M", "_LONGLEAF_LEG_M", "_FOREST_LEG_M"):
        monkeypatch.setattr(suites, name, 22.0)
    return write_all(tmp_path)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Fly nothing; return what would have been flown."""
    calls: list[tuple[Any, ...]] = []

    def record(*arguments: Any) -> LegRow:
        calls.append(arguments)
        return row(number=arguments[3])

    monkeypatch.setattr(command, "fly_leg", record)
    return calls


@pytest.mark.parametrize("name", ["sando", "competition", "longleaf", "forest"])
def test_a_small_scene_of_each_format_is_flown(
    clearway: Clearway, data: Path, tmp_path: Path, name: str
) -> None:
    table, page = tmp_path / "legs.parquet", tmp_path / "page.md"
    where = ("--data", data) if name != "forest" else ("300",)
    ran = clearway(
        "benchmark", name, *where, "--legs", "1", "--jobs", "1", "-o", table, "--page", page
    )  # fmt: skip
    assert (ran.code, ran.err) == (0, "")
    (leg,) = parquet.read_table(table).to_pylist()
    assert leg["benchmark"] == name
    assert leg["passed"] is True
    assert leg["speed_mps"] > 0.8
    assert leg["false_cells"] == 0
    assert leg["clearance_min_m"] > (1.2 if name == "competition" else 0.0)
    assert leg["peer_distance_m"] == (1.2 if name == "competition" else None)
    assert f"{leg['duration_s']:.1f} s" in ran.out
    assert f"{leg['speed_mps']:.2f} m/s" in page.read_text(encoding="utf-8")


@pytest.mark.usefixtures("data")
def test_a_touched_obstacle_is_the_exit_code(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch
) -> None:
    hit = row(collisions=1, arrived=False, passed=False, speed_mps=None, why_not="touched")
    monkeypatch.setattr(command, "fly_leg", lambda *_: hit)
    line = ("benchmark", "forest", "500", "--legs", "1", "--jobs", "1")
    assert clearway(*line).code == 1
    assert clearway(*line, "--ablation", "unseen-is-free").code == 0


def test_every_nth_leg_is_flown_in_the_manner_that_was_asked_for(
    clearway: Clearway, data: Path, asked: list[tuple[Any, ...]]
) -> None:
    ran = clearway(
        "benchmark", "sando", "easy", "--data", data, "--legs", "7", "--every", "3", "--jobs", "1",
        "--seed", "5", "--vehicle", "px4", "--clearance-wish", "0.5", "--first-look",
    )  # fmt: skip
    assert (ran.code, ran.err) == (0, "")
    assert [number for *_, number, _ in asked] == [0, 3, 6]
    (manner,) = {arguments[4] for arguments in asked}
    assert (manner.vehicle, manner.seed, manner.wish_m) == ("px4", 5, 0.5)
    assert (manner.first_look, manner.service, manner.unseen_is_free) == (True, False, False)


def test_the_competition_prefers_its_own_distance(
    clearway: Clearway, data: Path, asked: list[tuple[Any, ...]]
) -> None:
    clearway("benchmark", "competition", "--data", data, "--jobs", "1")
    ((_, rule, _, _, manner),) = asked
    assert (rule.distance_min_m, manner.wish_m) == (1.5, 1.5)


def test_an_interrupted_benchmark_leaves_what_was_flown(
    clearway: Clearway, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: Any) -> LegRow:
        if arguments[3] == 2:
            raise KeyboardInterrupt
        return row(number=arguments[3])

    monkeypatch.setattr(command, "fly_leg", interrupted)
    table, page = tmp_path / "legs.parquet", tmp_path / "page.md"
    ran = clearway(
        "benchmark", "sando", "--data", data, "--jobs", "1", "-o", table, "--page", page
    )  # fmt: skip
    assert (ran.code, ran.err) == (130, "clearway: error: interrupted\n")
    assert "Interrupted after 2 of 10 legs." in ran.out
    assert parquet.read_table(table)["number"].to_pylist() == [0, 1]
    assert "Interrupted after 2 of 10 legs." in page.read_text(encoding="utf-8")


@pytest.mark.usefixtures("data")
def test_the_service_flies_an_ardupilot_unless_told_otherwise(
    clearway: Clearway, asked: list[tuple[Any, ...]]
) -> None:
    line = ("benchmark", "forest", "500", "--legs", "1", "--jobs", "1", "--service")
    clearway(*line)
    clearway(*line, "--vehicle", "px4")
    assert [(each[4].service, each[4].vehicle) for each in asked] == [
        (True, "ardupilot"),
        (True, "px4"),
    ]


@pytest.mark.usefixtures("data")
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("forest -o legs.csv", "ends in .parquet"),
        ("forest --page page.html", "ends in .md"),
        ("forest -o missing/legs.parquet", "no folder"),
        ("forest --service --vehicle default", "ardupilot or px4 with --service"),
        ("forest --service --ablation unseen-is-free", "of the planner alone"),
        ("forest --service --first-look", "of the planner alone"),
        ("forest --service --tracking-error 0.5", "of the planner alone"),
        ("sando-dynamic --data .", "add --service"),
        ("sando --data missing.csv", "missing.csv: cannot be read"),
        ("forest --legs 0", "--legs"),
        ("forest --vehicle vtol", "'vtol'"),
    ],
)
def test_mistakes_are_one_line(clearway: Clearway, line: str, words: str) -> None:
    ran = clearway("benchmark", *line.split())
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("clearway: error: ")
    assert ran.err.count("\n") == 1
    assert words in ran.err


def test_data_without_a_blocked_leg_is_refused(clearway: Clearway, data: Path) -> None:
    scenes = data / "benchmarks" / "uav_testing_competition" / "two_box_scenes.csv"
    header, _, beside = scenes.read_text(encoding="utf-8").splitlines()
    scenes.write_text(f"{header}\n{beside}\n", encoding="utf-8")
    ran = clearway("benchmark", "competition", "--data", data)
    assert (ran.code, ran.err) == (
        2, "clearway: error: competition: the data have no leg to fly\n",
    )  # fmt: skip


def test_the_command_line_of_the_page_flies_the_same() -> None:
    assert command_line(BenchmarkRequest("forest")) == "clearway benchmark forest"
    request = BenchmarkRequest(
        "sando", ("easy",), Path("/somewhere"), legs=2, every=3, seed=4, vehicle="px4",
        wish_m=0.5, tracking_error_m=0.4, first_look=True, unseen_is_free=True,
    )  # fmt: skip
    assert command_line(request) == (
        "clearway benchmark sando easy --data DATA --legs 2 --every 3 --seed 4 --vehicle px4 "
        "--clearance-wish 0.5 --tracking-error 0.4 --first-look --ablation unseen-is-free"
    )
    served = BenchmarkRequest("walls", ("s:2.4",), service=True)
    assert command_line(served) == "clearway benchmark walls s:2.4 --service"
