"""Counts, bounds and tables."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from gcs_tools.benchmark.legs import Manner
from gcs_tools.benchmark.suites import BENCHMARKS
from gcs_tools.benchmark.summary import Run, interval, peers_of, print_tables, summarize, waits
from tests.gcs_tools.benchmark.rows import row

DEFAULT = Manner("default")
HIT = {"arrived": False, "collisions": 1, "end": "collision", "speed_mps": None, "passed": False}


def test_one_field_is_its_own_sum() -> None:
    stuck = row(arrived=False, passed=False, passable=False, speed_mps=None, clearance_min_m=0.3)
    (summary,) = summarize([row(), row(duration_s=42.0, first_look_s=0.0), stuck])
    assert (summary.legs, summary.passable, summary.arrived, summary.passed) == (3, 2, 2, 2)
    assert summary.collided == 0
    assert summary.speed_mps == pytest.approx((105.0 / 50.0 + 105.0 / 42.0) / 2.0)
    assert summary.moving_mps == pytest.approx(105.0 / 42.0)
    assert (summary.clearance_min_m, summary.distance_min_m) == (0.3, 0.8)
    assert summary.collision_rate[0] == 0.0
    assert summary.collision_rate[1] == pytest.approx(1.0 - 0.05 ** (1 / 3))


def test_several_fields_have_a_sum_of_all() -> None:
    rows = [row(), row(field="static_medium", **HIT), row()]
    easy, medium, total = summarize(rows)
    assert (easy.field, easy.legs, medium.field, medium.legs) == (
        "static_easy", 2, "static_medium", 1,
    )  # fmt: skip
    assert (total.field, total.legs, total.collided, total.passed) == ("all", 3, 1, 2)
    assert medium.speed_mps is None
    assert 0.0 < total.pass_rate[0] < 2.0 / 3.0 < total.pass_rate[1] < 1.0


@pytest.mark.parametrize(
    ("bounds", "text"),
    [((0.0, 0.05), "≤ 5.0%"), ((0.9, 1.0), "≥ 90.0%"), ((0.25, 0.75), "25.0% to 75.0%")],
)
def test_bounds_in_words(bounds: tuple[float, float], text: str) -> None:
    assert interval(bounds) == text


def test_a_peers_own_distances_are_counted_once_a_scene() -> None:
    competition = BENCHMARKS["competition"]
    rows = [
        row(field="two", leg="scene 1 way 0", peer_distance_m=1.2),
        row(field="two", leg="scene 1 way 4", peer_distance_m=1.2),
        row(field="two", leg="scene 2 way 0", peer_distance_m=3.0),
    ]
    peer = peers_of(competition, rows)[-1]
    assert peer.reported == "less than 1.5 m in 1 of the 2 scenes flown here"
    assert peers_of(competition, [row()]) == competition.peers
    assert peers_of(BENCHMARKS["sando"], rows) == BENCHMARKS["sando"].peers


def test_the_tables_show_legs_bounds_and_peers() -> None:
    text = io.StringIO()
    hit = row(leg="flight 1", why_not="touched an obstacle", losses=9, losses_unsafe=2, **HIT)
    console = Console(file=text, width=200)
    print_tables(Run(BENCHMARKS["sando"], DEFAULT, "c", [row(), hit], 3), console)
    printed = text.getvalue()
    for words in (
        "flight 0",
        "2.10 m/s",
        "touched an obstacle",
        "MIGHTY",
        "100 %",
        "2 of 9",
        "after 2 of 3",
    ):
        assert words in printed
    print_tables(Run(BENCHMARKS["walls"], DEFAULT, "c", [row()], 1), console)
    assert "what peers report" not in text.getvalue().removeprefix(printed)


def test_waits_for_what_moves_are_summed_up_where_something_does() -> None:
    rows = [row(leg="seed 0"), row(leg="seed 1", waited_s=30.0, contacts_at_rest=2)]
    said = waits(BENCHMARKS["sando-dynamic"], rows)
    assert "15.0 s a leg, at most 30.0 s (static_easy, seed 1); touched at rest: 2 times" in said
    assert waits(BENCHMARKS["sando"], rows) == ""
