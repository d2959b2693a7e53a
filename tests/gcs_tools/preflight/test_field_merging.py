"""Obstacles of a known field merge as the service merges what it sees."""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gcs_tools.preflight import field_check, field_merging
from gcs_tools.preflight.command import check
from gcs_tools.preflight.field_check import check_field
from gcs_tools.preflight.field_merging import PAIRS_MAX, Merged, intersecting_pairs, merge
from gcs_tools.preflight.field_regions import region_boxes
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.frames import FloatArray, LegFrame
from onboard.monitoring.assumptions import measured_size_max
from onboard.perception.obstacle_map import ObstacleMap
from tests.gcs_tools.running import CONFIG, Clearway

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
PAPER = assess(CONTRACT)
SIZE_MAX_M = PAPER.terms.obstacle_size_max_m


def merged(boxes_m: FloatArray) -> Merged:
    return merge(boxes_m, lambda each_m: region_boxes(PAPER, each_m).apart_m, SIZE_MAX_M)


def discovered(boxes_m: FloatArray, order: list[int]) -> ObstacleMap:
    """What the service knows once it has seen these boxes, one after the other."""
    leg = LegFrame((0.0, 0.0, 0.0), 0.0)
    seen = ObstacleMap(leg, PAPER.region_around, measured_size_max(PAPER.terms))
    for n in order:
        x_min_m, x_max_m, y_min_m, y_max_m = boxes_m[n].tolist()
        corners_m = [(x_min_m, y_min_m), (x_max_m, y_max_m)]
        seen.add(str(n), corners_m, 0.0)
    return seen


@example([(0.0, 0.0, 0.5), (0.0, 1.0625, 0.15625)], Random(0))
@given(
    st.lists(
        st.tuples(st.floats(0.0, 60.0), st.floats(-20.0, 20.0), st.floats(0.05, 0.6)),
        min_size=1,
        max_size=8,
    ),
    st.randoms(use_true_random=False),
)
def test_what_is_clear_once_merged_is_clear_to_the_service_in_any_order(
    stems: list[tuple[float, float, float]], random: Any
) -> None:
    boxes_m = np.array([(x, x + side, y, y + side) for x, y, side in stems])
    found = merged(boxes_m)
    assert sorted(n for each in found.members for n in each) == list(range(len(stems)))
    order = list(range(len(stems)))
    random.shuffle(order)
    disjoint = check_field(PAPER, field_of(boxes_m), None)[3]
    assert disjoint.name == "roi_disjoint"
    for seen_so_far in range(1, len(order) + 1):
        seen = discovered(boxes_m, order[:seen_so_far])
        in_conflict = any(any(seen.conflicts(obstacle)) for obstacle in seen)
        assert not (disjoint.holds and in_conflict)
    if disjoint.holds:
        groups = {tuple(sorted(map(int, each.members))) for each in seen}
        assert groups == set(found.members)
    else:
        # What is seen may be off by the face error, so the service unites up to that much more.
        assert in_conflict or any(max(each.measured.size_m) > SIZE_MAX_M for each in seen)


def field_of(boxes_m: FloatArray) -> ObstacleField:
    return ObstacleField.of(
        [
            Obstacle(id=str(n), center_ned_m=((a + b) / 2, (c + d) / 2), size_m=(b - a, d - c))
            for n, (a, b, c, d) in enumerate(boxes_m.tolist())
        ]
    )


def stem(name: str, x_m: float, y_m: float, side_m: float = 0.3) -> Obstacle:
    return Obstacle(id=name, center_ned_m=(x_m, y_m), size_m=(side_m, side_m))


def twins(apart_m: float) -> ObstacleField:
    return ObstacleField.of([stem("a", 20.0, 0.0), stem("b", 20.0, apart_m)])


def test_two_stems_that_fit_into_one_obstacle_are_accepted_and_said_so() -> None:
    limit_m = SIZE_MAX_M - 0.3
    rules = {rule.name: rule for rule in check_field(PAPER, twins(limit_m), None)}
    assert rules["roi_disjoint"].holds
    assert rules["separation"].holds
    assert rules["roi_disjoint"].note == ("close obstacles are avoided as one: a+b (heading north)")
    rules = {rule.name: rule for rule in check_field(PAPER, twins(limit_m + 0.01), None)}
    assert not rules["roi_disjoint"].holds
    assert not rules["separation"].holds
    assert rules["roi_disjoint"].note == ""


def test_merging_is_shown_to_operator_and_machine(clearway: Clearway, tmp_path: Any) -> None:
    path = tmp_path / "stems.csv"
    path.write_text("x_m,y_m,dbh_cm\n20.0,0.0,30.0\n20.0,0.4,30.0\n", encoding="utf-8")
    arguments = ("preflight", "--contract", CONFIG / "paper_contract.yaml", "--field", path)
    # Thinner than the paper's contract assumes.
    ran = clearway(*arguments, "--set", "environment.obstacle_size_min_m=0.3")
    assert "avoided as one: 2+3 (heading north)" in ran.out
    document = check(CONTRACT, twins(0.5), None).document()
    assert [rule["note"] != "" for rule in document["field"]] == [False, False, False, True]


def test_a_thin_stem_is_not_hidden_by_what_it_merges_with() -> None:
    pair = ObstacleField.of([stem("pole", 20.0, 0.0, 0.1), stem("trunk", 20.2, 0.3, 0.6)])
    thin = {rule.name: rule for rule in check_field(PAPER, pair, None)}["obstacle_size_min"]
    assert thin.offenders[0] == "pole (heading north): 0.10 m"


def test_a_chain_grows_only_as_far_as_it_fits() -> None:
    boxes_m = np.array([(0.4 * n, 0.4 * n + 0.2, 0.0, 0.2) for n in range(12)])
    found = merged(boxes_m)
    sizes_m = found.boxes_m[:, 1] - found.boxes_m[:, 0]
    assert 1 < len(found.members) < 12
    assert sizes_m.max() <= SIZE_MAX_M
    assert not check_field(PAPER, field_of(boxes_m), None)[3].holds


def test_a_crowd_is_counted_only_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three thousand large boxes in one place have four and a half million pairs."""
    limit = 20_000
    assert limit < PAIRS_MAX
    monkeypatch.setattr(field_check, "PAIRS_MAX", limit)
    monkeypatch.setattr("gcs_tools.preflight.field_merging.PAIRS_MAX", limit)
    crowd = ObstacleField.of([stem(str(n), 20.0, 0.001 * n, SIZE_MAX_M) for n in range(3_000)])
    disjoint = check_field(PAPER, crowd, None)[3]
    assert (disjoint.holds, disjoint.required) == (False, limit)
    assert disjoint.note.endswith(f"counting stopped at {limit}")


def test_a_small_field_is_compared_as_the_index_of_a_large_one_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    draw = np.random.default_rng(3)
    corner_m = np.round(draw.uniform(-20.0, 20.0, (300, 2)))
    size_m = np.round(draw.uniform(0.0, 4.0, (300, 2)))
    far_m = corner_m + size_m  # whole numbers: many boxes only touch
    boxes_m = np.column_stack((corner_m[:, 0], far_m[:, 0], corner_m[:, 1], far_m[:, 1]))
    compared = list(intersecting_pairs(boxes_m))
    monkeypatch.setattr(field_merging, "_COMPARED_MAX", 0)
    assert compared == list(intersecting_pairs(boxes_m))
    assert len(compared) > 100
