"""Boxes of a layered graph do not overlap, and arrows pass beside them."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tools.layered_layout import place
from tests.tools.rooms_picture import without_implied

BOX_WIDTH, GAP = 100.0, 10.0


@st.composite
def layered_graphs(draw: st.DrawFn) -> tuple[list[list[str]], list[tuple[str, str]]]:
    sizes = draw(st.lists(st.integers(1, 4), min_size=2, max_size=5))
    rows = [[f"{row}.{index}" for index in range(size)] for row, size in enumerate(sizes)]
    pairs = [
        (start, end)
        for row, boxes in enumerate(rows)
        for start in boxes
        for lower in rows[row + 1 :]
        for end in lower
    ]
    return rows, draw(st.lists(st.sampled_from(pairs), unique=True, max_size=8))


@given(layered_graphs())
def test_boxes_of_a_row_keep_their_distance(
    graph: tuple[list[list[str]], list[tuple[str, str]]],
) -> None:
    rows, arrows = graph
    layout = place(rows, arrows, BOX_WIDTH, GAP)
    for row in rows:
        centres = sorted(layout.x[box] for box in row)
        for one, other in pairwise(centres):
            assert other - one >= BOX_WIDTH + GAP - 1e-6
        assert centres[0] >= BOX_WIDTH / 2 - 1e-6
        assert centres[-1] <= layout.width - BOX_WIDTH / 2 + 1e-6


@given(layered_graphs())
def test_arrows_pass_beside_the_boxes(
    graph: tuple[list[list[str]], list[tuple[str, str]]],
) -> None:
    rows, arrows = graph
    layout = place(rows, arrows, BOX_WIDTH, GAP)
    assert set(layout.arrows) == set(arrows)
    for (start, end), points in layout.arrows.items():
        assert points[0][0] == layout.x[start]
        assert points[-1][0] == layout.x[end]
        rows_passed = [row for _, row in points]
        assert rows_passed == list(range(rows_passed[0], rows_passed[-1] + 1))
        for x, row in points[1:-1]:
            assert all(abs(x - layout.x[box]) > BOX_WIDTH / 2 for box in rows[row])


def test_an_arrow_upwards_is_refused() -> None:
    with pytest.raises(ValueError, match="low -> high leads to no lower row"):
        place([["high"], ["low"]], [("low", "high")], BOX_WIDTH, GAP)


def test_the_same_graph_is_drawn_the_same() -> None:
    rows, arrows = [["a"], ["b", "c"], ["d"]], [("a", "b"), ("a", "c"), ("b", "d"), ("a", "d")]
    assert place(rows, arrows, BOX_WIDTH, GAP) == place(rows, arrows, BOX_WIDTH, GAP)


def test_an_arrow_that_others_imply_is_left_out() -> None:
    imports = {"a": {"b", "c"}, "b": {"c"}, "c": {"d"}, "d": set()}
    assert without_implied(imports) == {"a": {"b"}, "b": {"c"}, "c": {"d"}, "d": set()}
