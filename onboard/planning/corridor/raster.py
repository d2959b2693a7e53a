"""Shortest ways over a raster: what boxes block, what room costs, and the graph of its cells."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

if TYPE_CHECKING:
    from onboard.geometry.frames import FloatArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int_]

CELL_M: Final = 0.2
_STEPS: Final = ((1, 0), (0, 1), (1, 1), (1, -1))
_T = TypeVar("_T", bound=np.generic)


class Axes(NamedTuple):
    """Centres of the cells of a raster, leg frame."""

    x_m: FloatArray
    y_m: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along x and y."""
        return self.x_m.size, self.y_m.size

    def quartered(self) -> Axes:
        """Return the centres of the quarters of the cells."""
        quarter = np.array((-0.25, 0.25)) * CELL_M
        return Axes(*((axis[:, None] + quarter).ravel() for axis in self))


def covered(axes: Axes, faces_m: FloatArray) -> BoolArray:
    """Tell of each centre whether it lies inside one of some boxes (k, 4): x min, max, y min, max.

    By counting: every box adds one within its corners.
    """
    nx, ny = axes.shape
    change: NDArray[np.int32] = np.zeros((nx + 1, ny + 1), np.int32)
    i0, i1 = (np.searchsorted(axes.x_m, faces_m[:, k]) for k in (0, 1))
    j0, j1 = (np.searchsorted(axes.y_m, faces_m[:, k]) for k in (2, 3))
    for i, j, sign in ((i0, j0, 1), (i1, j0, -1), (i0, j1, -1), (i1, j1, 1)):
        np.add.at(change, (i, j), sign)
    counts = change.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    inside: BoolArray = counts[:nx, :ny] > 0
    return inside


class Room(NamedTuple):
    """Where one may go, and what it costs.

    Attributes:
        cost: (nx, ny), factor on the length of the way; infinite where a cell is blocked.
        passages: for each step to a neighbour, which of the cells that have one lead there.
    """

    cost: FloatArray
    passages: tuple[BoolArray, ...]

    @classmethod
    def of(cls, cost: FloatArray, open_quarters: BoolArray) -> Room:
        """Return the room that a raster twice as fine leaves: narrower gaps than a cell count.

        Args:
            cost: (nx, ny).
            open_quarters: (2 nx, 2 ny), which quarters of the cells are open.
        """
        q = open_quarters
        low, high = q[0::2, 0::2] | q[1::2, 1::2], q[0::2, 1::2] | q[1::2, 0::2]
        # Two quarters that touch at a corner only leave no way through.
        split = ~(low & high) & ((q[0::2, 0::2] & q[1::2, 1::2]) | (q[0::2, 1::2] & q[1::2, 0::2]))
        cost = np.where((low | high) & ~split, cost, math.inf)
        pairs_x, pairs_y = q[1:-1:2] & q[2::2], q[:, 1:-1:2] & q[:, 2::2]
        along_x, along_y = pairs_x[:, 0::2] | pairs_x[:, 1::2], pairs_y[0::2] | pairs_y[1::2]
        corner = pairs_x[:, 1:-1:2] & pairs_x[:, 2::2]
        return cls(cost, (along_x, along_y, corner, corner))


class Ways(NamedTuple):
    """The cheapest ways from all cells.

    Attributes:
        left_m: (nx, ny), what is left to the goal; infinite where no way leads there.
        leads_to: (nx, ny), flat index of the next cell; no cell's where the raster ends.
    """

    left_m: FloatArray
    leads_to: NDArray[np.int32]


class Raster:
    """Eight neighbours of each cell of a raster, and one source beside them."""

    def __init__(self, shape: tuple[int, int]) -> None:
        index = np.arange(shape[0] * shape[1]).reshape(shape)
        cells, source = index.ravel(), index.size
        froms, tos = [np.full(cells.size, source)], [cells]
        for step in _STEPS:
            one, other = _shifts(index, step)
            froms += [one.ravel(), other.ravel()]
            tos += [other.ravel(), one.ravel()]
        rows, columns = np.concatenate(froms), np.concatenate(tos)
        self._order = np.lexsort((columns, rows))
        self._columns = columns[self._order].astype(np.int32)
        self._starts = np.searchsorted(rows[self._order], np.arange(source + 2)).astype(np.int32)
        self._source, self._shape = source, shape

    def graph(self, room: Room, exits_m: FloatArray) -> sparse.csr_matrix:
        """Return the ways between neighbours, and from the source to the exits.

        Args:
            room: where one may go.
            exits_m: (nx, ny), what is left beyond each cell; infinite where it is not an exit.
        """
        # A weight of nothing would be no edge to SciPy.
        parts = [exits_m.ravel() + 1e-9]
        for step, passage in zip(_STEPS, room.passages, strict=True):
            one, other = _shifts(room.cost, step)
            costliest = np.where(passage, np.maximum(one, other), math.inf)
            weights = (costliest * (math.hypot(*step) * CELL_M)).ravel()
            parts += [weights, weights]
        return sparse.csr_matrix(
            (np.concatenate(parts)[self._order], self._columns, self._starts),
            shape=(self._source + 1, self._source + 1),
        )

    def ways(self, graph: sparse.csr_matrix) -> Ways:
        """Return the cheapest way from each cell to an exit, what is left beyond it included."""
        left_m, leads_to = dijkstra(graph, indices=self._source, return_predecessors=True)
        inner = slice(self._source)
        return Ways(left_m[inner].reshape(self._shape), leads_to[inner].reshape(self._shape))


def _shifts(cells: NDArray[_T], step: tuple[int, int]) -> tuple[NDArray[_T], NDArray[_T]]:
    """Return the cells that have a neighbour at a step, and these neighbours."""
    (rows, columns), (di, dj) = cells.shape, step
    return (
        cells[: rows - di, max(0, -dj) : columns - max(0, dj)],
        cells[di:, max(0, dj) : columns + min(0, dj)],
    )
