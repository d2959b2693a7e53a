"""Merges the obstacles of a field as the service does (`onboard.perception.obstacle_map`).

Obstacles whose regions of influence intersect become one, the box around both, if that is no larger
than the contract allows a single obstacle to be; this repeats until nothing merges.

The verdict does not depend on the order of discovery.  A region only grows with its box; so if no
two regions intersect in the end, none do after any other order, or for the obstacles seen so far.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from onboard.geometry.frames import FloatArray

# These pairs suffice to refuse a field; counting more would take too long.
PAIRS_MAX = 1_000_000
# So many boxes are compared each with each, on a companion without Shapely, too.
_COMPARED_MAX = 2000
# Boxes looked up in the index at a time; limits the memory for the results.
_QUERIES = 4096
# Boxes grow within a round, so few rounds suffice; conflicts that remain are refused.
_ROUNDS_MAX = 20
_ROUND_OFF = 1e-9

Regions = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Merged:
    """Obstacles after merging, as (N, 4) boxes: x from, x to, y from, y to.

    Attributes:
        members: for each, the indices of the obstacles in it.
        boxes_m: boxes around them.
        regions_m: their regions of influence.
    """

    members: tuple[tuple[int, ...], ...]
    boxes_m: FloatArray
    regions_m: FloatArray


def merge(boxes_m: FloatArray, regions_of: Regions, size_max_m: float) -> Merged:
    """Merge boxes in the leg frame, (N, 4).

    Args:
        boxes_m: the obstacles.
        regions_of: boxes to regions of influence, (N, 4) -> (N, 4).
        size_max_m: largest extent of a merged box.
    """
    merged = Merged(tuple((n,) for n in range(len(boxes_m))), boxes_m, regions_of(boxes_m))
    for _ in range(_ROUNDS_MAX):
        parents = _united(merged, size_max_m)
        if parents is None:
            break
        merged = _gathered(merged, parents, regions_of)
    return merged


def _united(merged: Merged, size_max_m: float) -> list[int] | None:
    """Return for each box the index of the box that it becomes part of; None if nothing merges."""
    parents = list(range(len(merged.members)))
    boxes: dict[int, tuple[float, ...]] = {}

    def root(index: int) -> int:
        while parents[index] != index:
            parents[index] = index = parents[parents[index]]
        return index

    limit_m = size_max_m * (1.0 + _ROUND_OFF)
    for pair in islice(intersecting_pairs(merged.regions_m), PAIRS_MAX):
        one, other = (root(index) for index in pair)
        if one == other:
            continue
        a, b = (boxes.get(each) or merged.boxes_m[each].tolist() for each in (one, other))
        both = (min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3]))
        if max(both[1] - both[0], both[3] - both[2]) <= limit_m:
            parents[max(one, other)] = min(one, other)
            boxes[min(one, other)] = both
    return [root(index) for index in range(len(parents))] if boxes else None


def _gathered(merged: Merged, parents: list[int], regions_of: Regions) -> Merged:
    roots, place = np.unique(parents, return_inverse=True)
    edges_m = merged.boxes_m * np.array([1.0, -1.0, 1.0, -1.0])
    outer_m = np.full((len(roots), 4), np.inf)
    np.minimum.at(outer_m, place, edges_m)
    boxes_m: FloatArray = outer_m * np.array([1.0, -1.0, 1.0, -1.0])
    members: list[list[int]] = [[] for _ in roots]
    for index, into in enumerate(place.tolist()):
        members[into] += merged.members[index]
    return Merged(tuple(tuple(sorted(each)) for each in members), boxes_m, regions_of(boxes_m))


def intersecting_pairs(boxes_m: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield the index pairs of boxes, (N, 4), that share a point."""
    x_min_m, x_max_m, y_min_m, y_max_m = boxes_m.T
    if len(boxes_m) <= _COMPARED_MAX:
        for one in range(len(boxes_m) - 1):
            later = slice(one + 1, None)
            along = (x_min_m[later] <= x_max_m[one]) & (x_max_m[later] >= x_min_m[one])
            across = (y_min_m[later] <= y_max_m[one]) & (y_max_m[later] >= y_min_m[one])
            yield from ((one, one + 1 + other) for other in np.flatnonzero(along & across).tolist())
        return
    from shapely import STRtree, box  # noqa: PLC0415  extra ``ground``, for large fields only

    rectangles = box(x_min_m, y_min_m, x_max_m, y_max_m)
    tree = STRtree(rectangles)
    for begin in range(0, len(boxes_m), _QUERIES):
        ones, others = tree.query(rectangles[begin : begin + _QUERIES])
        ones += begin
        later = others > ones
        ones, others = ones[later], others[later]
        order = np.lexsort((others, ones))
        yield from zip(ones[order].tolist(), others[order].tolist(), strict=True)
