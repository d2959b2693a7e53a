"""Which scenes a benchmark finds, and which it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs_tools.benchmark.scenes import Selection
from gcs_tools.benchmark.suites import BENCHMARKS, benchmark_named
from gcs_tools.console.errors import CommandError
from tests.gcs_tools.benchmark.public_files import PILLARS, write_all


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_all(tmp_path_factory.mktemp("data"))


def selection(**changes: Any) -> Selection:
    return Selection(**{"scenes": (), "data": None, "legs": 1, "seed": 1, **changes})


def legs(name: str, **changes: Any) -> list[str]:
    scenes = benchmark_named(name).scenes(selection(**changes))
    return [f"{scene.field}: {scene.name}" for scene in scenes]


def test_every_benchmark_states_rule_origin_and_differences() -> None:
    for each in BENCHMARKS.values():
        assert each.rule.text
        assert each.origin
        assert each.differences
        assert each.peers or each.name == "walls"
    assert BENCHMARKS["competition"].rule.distance_min_m == 1.5


@pytest.mark.parametrize("place", ["", "benchmarks/sando", "benchmarks/sando/static_easy.csv"])
def test_data_is_a_folder_or_a_file(data: Path, place: str) -> None:
    assert legs("sando", data=data / place, legs=2) == [
        "static_easy: flight 0",
        "static_easy: flight 1",
    ]


def test_each_field_of_sando_that_there_is(tmp_path: Path) -> None:
    for name in ("easy", "hard"):
        (tmp_path / f"static_{name}.csv").write_text(PILLARS, encoding="utf-8")
    assert legs("sando", data=tmp_path) == ["static_easy: flight 0", "static_hard: flight 0"]
    assert legs("sando", data=tmp_path, scenes=("hard",)) == ["static_hard: flight 0"]


@pytest.mark.parametrize(
    ("place", "fields"),
    [("", ("easy", "medium")), ("benchmarks/sando/dynamic_medium.json", ("medium",))],
)
def test_moving_boxes_are_flown_seed_by_seed(
    data: Path, place: str, fields: tuple[str, ...]
) -> None:
    assert legs("sando-dynamic", data=data / place, legs=2) == [
        f"dynamic_{field}: seed {seed}" for field in fields for seed in (0, 1)
    ]


def test_the_competition_flies_the_legs_that_are_blocked(data: Path) -> None:
    assert legs("competition", data=data, legs=9) == ["two_box_scenes: scene 0 way 0"]


def test_forests_are_drawn(data: Path) -> None:
    assert legs("forest") == [f"{n} stems/ha: leg 0" for n in (500, 1000, 1500)]
    assert legs("forest", scenes=("250.5",), legs=2) == [
        "250.5 stems/ha: leg 0",
        "250.5 stems/ha: leg 1",
    ]
    assert legs("walls", scenes=("door:2", "trap")) == ["door:2: door:2", "trap: trap"]
    assert benchmark_named("longleaf").legs == 40
    del data


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("dodgedrone", {}, "needs --data PATH"),
        ("dodgedrone", {"data": Path()}, "expected files easy_0.csv"),
        ("sando", {"scenes": ("dynamic_easy",), "data": Path()}, "fly the benchmark sando-dynamic"),
        ("sando", {"data": Path("dynamic_easy.json")}, "fly the benchmark sando-dynamic"),
        ("sando-dynamic", {}, "needs --data PATH"),
        ("sando-dynamic", {"data": Path()}, "has no dynamic_easy.json"),
        ("sando-dynamic", {"scenes": ("hard",), "data": Path()}, "one of easy, medium"),
        ("bench", {}, "expected one of sando, sando-dynamic, dodgedrone"),
        ("sando", {}, "needs --data PATH"),
        ("longleaf", {}, "needs --data PATH"),
        ("competition", {}, "needs --data PATH"),
        ("sando", {"scenes": ("harder",), "data": Path()}, "expected one of easy, medium, hard"),
        ("sando", {"scenes": ("hard",), "data": Path()}, "has no static_hard.csv"),
        ("sando", {"data": Path()}, "has no static_easy.csv or"),
        ("longleaf", {"data": Path()}, "has no longleaf_pines.csv"),
        ("competition", {"data": Path()}, "has no two_box_scenes.csv"),
        ("competition", {"scenes": ("one",), "data": Path()}, "no scenes to name"),
        ("forest", {"data": Path()}, "no data files"),
        ("forest", {"scenes": ("dense",)}, "'dense' is not a density"),
        ("forest", {"scenes": ("nan",)}, "'nan' is not a density"),
        ("forest", {"scenes": ("1e9",)}, "up to 10000"),
        ("walls", {}, "name the scenes"),
    ],
)
def test_what_cannot_be_flown_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    changes: dict[str, Any],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CommandError) as refused:
        legs(name, **changes)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
