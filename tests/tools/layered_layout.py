"""Place the boxes of a layered graph: rows are given, the order within each is found here.

An arrow across several rows gets a waypoint in each row between, so that it passes beside the boxes
instead of behind them (Sugiyama's method: order by the mean of the neighbours, then straighten).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

_SWEEPS: Final = 24
_WAYPOINT_WIDTH: Final = 16.0

# A box by its name; or the waypoint of an arrow in a row.
Node = str | tuple[str, str, int]


@dataclass(frozen=True)
class Layout:
    """Where everything stands, in pixels from the left edge.

    Attributes:
        x: of the centre of every box, by name.
        arrows: for each arrow the centres (x, row) from its start by its waypoints to its end.
        width: of all rows.
    """

    x: dict[str, float]
    arrows: dict[tuple[str, str], list[tuple[float, int]]]
    width: float


@dataclass
class _Graph:
    rows: list[list[Node]]
    chains: dict[tuple[str, str], list[Node]] = field(default_factory=dict)
    neighbours: dict[Node, list[Node]] = field(default_factory=lambda: defaultdict(list))


def place(
    rows: list[list[str]], arrows: list[tuple[str, str]], box_width: float, gap: float
) -> Layout:
    """Find places for boxes and arrows.

    Args:
        rows: the boxes of each row, the top row first.
        arrows: pairs of boxes, from a higher to a lower row.
        box_width: of every box.
        gap: the least space between neighbours in a row.

    Raises:
        ValueError: an arrow does not lead to a lower row.
    """
    graph = _with_waypoints(rows, arrows)
    x = _spread(graph, box_width, gap)
    for sweep in range(_SWEEPS):
        order = range(len(rows)) if sweep % 2 == 0 else range(len(rows) - 1, -1, -1)
        for row in order:
            wished = {node: _mean_x(node, graph, x) for node in graph.rows[row]}
            if sweep < _SWEEPS // 2:
                graph.rows[row].sort(key=lambda node: wished[node])
            _settle(graph.rows[row], wished, x, box_width, gap)
    left = min(x[box] for row in rows for box in row) - box_width / 2
    right = max(x[box] for row in rows for box in row) + box_width / 2
    row_of = {node: index for index, row in enumerate(graph.rows) for node in row}
    return Layout(
        {box: x[box] - left for row in rows for box in row},
        {
            arrow: [(x[node] - left, row_of[node]) for node in chain]
            for arrow, chain in graph.chains.items()
        },
        right - left,
    )


def _with_waypoints(rows: list[list[str]], arrows: list[tuple[str, str]]) -> _Graph:
    row_of = {box: index for index, row in enumerate(rows) for box in row}
    graph = _Graph([list(row) for row in rows])
    for start, end in arrows:
        if row_of[start] >= row_of[end]:
            raise ValueError(f"{start} -> {end} leads to no lower row")
        between: list[Node] = []
        for row in range(row_of[start] + 1, row_of[end]):
            waypoint = (start, end, row)
            graph.rows[row].append(waypoint)
            between.append(waypoint)
        chain: list[Node] = [start, *between, end]
        graph.chains[start, end] = chain
        for one, other in pairwise(chain):
            graph.neighbours[one].append(other)
            graph.neighbours[other].append(one)
    return graph


def _spread(graph: _Graph, box_width: float, gap: float) -> dict[Node, float]:
    """Place the nodes of every row beside one another, centred about zero."""
    x: dict[Node, float] = {}
    for row in graph.rows:
        _settle(row, dict.fromkeys(row, 0.0), x, box_width, gap)
    return x


def _mean_x(node: Node, graph: _Graph, x: dict[Node, float]) -> float:
    beside = graph.neighbours[node]
    return sum(x[each] for each in beside) / len(beside) if beside else x[node]


def _settle(
    row: list[Node], wished: dict[Node, float], x: dict[Node, float], box_width: float, gap: float
) -> None:
    """Place a row as near to the wishes as the least space allows, in its order."""
    widths = [box_width if isinstance(node, str) else _WAYPOINT_WIDTH for node in row]
    steps = [0.0] + [(one + other) / 2 + gap for one, other in pairwise(widths)]
    low: list[float] = []
    high: list[float] = []
    for index, node in enumerate(row):
        low.append(wished[node] if index == 0 else max(wished[node], low[-1] + steps[index]))
    for index in range(len(row) - 1, -1, -1):
        wish = wished[row[index]]
        high.append(wish if not high else min(wish, high[-1] - steps[index + 1]))
    high.reverse()
    for node, least, most in zip(row, low, high, strict=True):
        x[node] = (least + most) / 2
