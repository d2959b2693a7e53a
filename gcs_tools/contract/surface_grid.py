"""Evaluates a requirement of a contract on a grid of any two of its keys.

Uses the formulas of the pre-flight check on arrays (`region.ARRAY`), in blocks that fit into the
processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_tools.console.errors import CommandError
from gcs_tools.console.progress import tracked
from gcs_tools.contract.keys import ContractKey, contract_key, suggestion
from onboard.contract.arithmetic import ARRAY
from onboard.contract.assessment import Clause, Derived, Terms, clauses, derive
from onboard.files.contract_file import Contract, InputSet
from onboard.geometry.frames import FloatArray

Reading = Literal["nominal", "inflated"]
BoolArray = NDArray[np.bool_]

MAX_POINTS = 25_000_000

# Points per block; about sixty arrays of this size are in use at a time.
_BLOCK_POINTS = 16_384


@dataclass(frozen=True)
class Axis:
    """Values of one key, or of several keys that change together.

    Attributes:
        keys: of the contract.
        values: in the keys' unit, ascending.
    """

    keys: tuple[ContractKey, ...]
    values: FloatArray

    @property
    def name(self) -> str:
        """As written on the command line."""
        return "+".join(key.path for key in self.keys)

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self.keys[0].unit

    @classmethod
    def parse(cls, text: str) -> Axis:
        """Read ``KEY=LO:HI:N``, or ``KEY+KEY=LO:HI:N``.

        Raises:
            CommandError: the text does not describe an axis, or names an unknown key.
        """
        names, _, span = text.partition("=")
        keys = tuple(contract_key(name) for name in names.split("+"))
        if len({key.unit for key in keys}) > 1:
            raise CommandError(f"{names}: keys of one axis must have the same unit")
        try:
            low, high, count = span.split(":")
            start, stop, number = float(low), float(high), int(count)
        except ValueError:
            raise CommandError(f"{text}: expected KEY=LO:HI:N") from None
        if not (math.isfinite(start) and math.isfinite(stop) and start < stop and number >= 2):
            raise CommandError(f"{text}: expected LO less than HI, and N at least 2")
        return cls(keys, np.linspace(start, stop, number))

    def value_in(self, contract: Contract) -> float | None:
        """Return the value that a contract states for all keys; None where they differ."""
        stated = {key.value_in(contract) for key in self.keys}
        return stated.pop() if len(stated) == 1 else None

    def spans(self, value: float) -> bool:
        """Return whether a value lies between the ends."""
        return bool(self.values[0] <= value <= self.values[-1])

    def up_to(self, high: float) -> Axis:
        """Return the axis with as many values, none above ``high`` if any is not."""
        low, end = float(self.values[0]), min(float(self.values[-1]), high)
        return self if low >= end else Axis(self.keys, np.linspace(low, end, len(self.values)))


@dataclass(frozen=True)
class Quantity:
    """A quantity that a surface shows.

    Attributes:
        name: on the command line.
        label: in tables and pictures.
        unit: of the values.
        clause: name of the clause whose requirement this is; '' for other quantities.
        of: computes the values.
    """

    name: str
    label: str
    unit: str
    clause: str
    of: Callable[[Derived[FloatArray], tuple[Clause[FloatArray], ...]], FloatArray]


def _length(name: str, label: str, of: Callable[[Derived[FloatArray]], FloatArray]) -> Quantity:
    return Quantity(name, label, "m", "", lambda derived, _: of(derived))


MARGIN = Quantity(
    "margin",
    "least margin of all clauses, as a part of what is declared",
    "",
    "",
    lambda _, found: 1.0 - _largest(clause.required / clause.declared for clause in found),
)
_LENGTHS = (
    _length(
        "collision_set_depth_m", "collision set depth", lambda d: d.region.collision_set_depth_m
    ),
    _length("pob_depth_m", "front face to post-obstacle border", lambda d: d.region.pob_depth_m),
    _length("roi_length_m", "region of influence, length", lambda d: d.roi_length_m),
    _length("roi_width_m", "region of influence, width", lambda d: d.roi_width_m),
    _length("stopping_distance_m", "stopping distance", lambda d: d.stopping_distance_m),
    _length(
        "required_detection_range_m",
        "detection range required",
        lambda d: d.required_detection_range_m,
    ),
    _length("required_separation_m", "separation required", lambda d: d.required_separation_m),
    _length(
        "required_separation_along_m",
        "separation required along the leg",
        lambda d: d.required_separation_box_m[0],
    ),
    _length(
        "required_separation_across_m",
        "separation required across the leg",
        lambda d: d.required_separation_box_m[1],
    ),
)


def quantity_called(name: str, units_of_clauses: dict[str, str]) -> Quantity:
    """Return a derived length, ``margin``, or what a clause requires in its unit.

    Raises:
        CommandError: the quantity is unknown.
    """
    known = {quantity.name: quantity for quantity in (MARGIN, *_LENGTHS)}
    if name in known:
        return known[name]
    if (unit := units_of_clauses.get(name)) is not None:
        label = f"{name.replace('_', ' ')} required"
        return Quantity(name, label, unit, name, lambda _, found: _clause_of(found, name).required)
    names = (*known, *units_of_clauses)
    raise CommandError(f"unknown quantity {name!r}; {suggestion(name, names)}")


@dataclass(frozen=True)
class Surface:
    """A quantity over two keys.

    Attributes:
        x, y: the axes.
        quantity: what was evaluated.
        reading: nominal or inflated.
        input_set: which box of accelerations.
        values: (len(y), len(x)).
        margin: declared less required, as a share of declared: of the quantity's clause, or the
            least of all clauses if it has none.
        declared: of the quantity's clause, if it is the same everywhere; else None.
        compliant: where every clause holds.
        own: the contract's own values of both axes; None where it states none, or several.
    """

    x: Axis
    y: Axis
    quantity: Quantity
    reading: Reading
    input_set: InputSet
    values: FloatArray
    margin: FloatArray
    declared: float | None
    compliant: BoolArray
    own: tuple[float, float] | None = None

    @property
    def own_safe(self) -> bool | None:
        """Whether the nearest point of the grid to the contract's own is safe.

        None where it has none within the axes.
        """
        if self.own is None or not (self.x.spans(self.own[0]) and self.y.spans(self.own[1])):
            return None
        column = np.abs(self.x.values - self.own[0]).argmin()
        row = np.abs(self.y.values - self.own[1]).argmin()
        return bool(self.safe[row, column])

    @property
    def safe(self) -> BoolArray:
        """Where the quantity's clause holds, or every clause if it has none."""
        return self.margin > 0.0


def evaluate(
    contract: Contract,
    x: Axis,
    y: Axis,
    quantity_name: str,
    *,
    reading: Reading = "inflated",
    input_set: InputSet = "inner",
) -> Surface:
    """Evaluate a quantity on the grid of two axes.

    Raises:
        FileError: an end of an axis is not admissible.
        CommandError: the grid is too large, the axes share a key, or the quantity is unknown.
    """
    _check(_read_as(contract, reading), x, y)
    terms = _as_arrays(Terms.of(contract, input_set))
    if reading == "nominal":
        terms = terms.idealised()
    units = {clause.name: clause.unit for clause in clauses(terms, derive(terms, ARRAY), ARRAY)}
    quantity = quantity_called(quantity_name, units)
    grid = _Grid.of_shape(len(y.values), len(x.values))
    steps = range(0, len(y.values), max(1, _BLOCK_POINTS // len(x.values)))
    for start in tracked(steps, len(steps), "evaluating the contract"):
        rows = slice(start, start + steps.step)
        block = _block(terms, x, y, rows)
        derived = derive(block, ARRAY)
        grid.fill(rows, quantity, derived, clauses(block, derived, ARRAY))
    return Surface(
        x=x,
        y=y,
        quantity=quantity,
        reading=reading,
        input_set=input_set,
        values=grid.values,
        margin=grid.margin,
        declared=grid.declared.pop() if len(grid.declared) == 1 else None,
        compliant=grid.compliant,
    )


@dataclass(frozen=True)
class _Grid:
    """The arrays of a `Surface` while they are filled, block by block of rows."""

    values: FloatArray
    margin: FloatArray
    compliant: BoolArray
    declared: set[float]

    @classmethod
    def of_shape(cls, rows: int, columns: int) -> _Grid:
        shape = rows, columns
        return cls(np.empty(shape), np.empty(shape), np.empty(shape, dtype=bool), set())

    def fill(
        self,
        rows: slice,
        quantity: Quantity,
        derived: Derived[FloatArray],
        found: tuple[Clause[FloatArray], ...],
    ) -> None:
        self.values[rows] = quantity.of(derived, found)
        self.compliant[rows] = np.logical_and.reduce(
            [np.broadcast_to(clause.holds, self.values[rows].shape) for clause in found]
        )
        if quantity.clause:
            own = _clause_of(found, quantity.clause)
            self.margin[rows] = own.margin / own.declared
            self.declared.update(np.unique(own.declared).tolist())
        else:
            self.margin[rows] = MARGIN.of(derived, found)


def _read_as(contract: Contract, reading: Reading) -> Contract:
    """Return the contract without the clause that the nominal reading does not have.

    The run-on, and with it the speed above which it is unknown, belongs to passive safety.
    """
    if reading == "inflated":
        return contract
    requirements = contract.requirements.model_copy(update={"passive_safety": False})
    return contract.model_copy(update={"requirements": requirements})


def _check(contract: Contract, x: Axis, y: Axis) -> None:
    if len(x.values) * len(y.values) > MAX_POINTS:
        raise CommandError(f"more than {MAX_POINTS:,} points: use a smaller N")
    if shared := {key.path for key in x.keys} & {key.path for key in y.keys}:
        raise CommandError(f"{', '.join(sorted(shared))} cannot be on both axes")
    for x_value in x.values[[0, -1]]:
        for y_value in y.values[[0, -1]]:
            corner = contract
            for axis, value in ((x, float(x_value)), (y, float(y_value))):
                for key in axis.keys:
                    corner = key.changed(corner, value)


def _as_arrays(terms: Terms[float]) -> Terms[FloatArray]:
    numbers: dict[str, Any] = {field.name: getattr(terms, field.name) for field in fields(terms)}
    for name, value in numbers.items():
        if isinstance(value, float):
            numbers[name] = np.asarray(value)
    return Terms(**numbers)


def _block(terms: Terms[FloatArray], x: Axis, y: Axis, rows: slice) -> Terms[FloatArray]:
    """Return the terms of some rows of the grid; terms that vary with x alone stay one row."""
    across = {key.term: x.values[np.newaxis, :] * key.term_per_unit for key in x.keys}
    down = {key.term: y.values[rows, np.newaxis] * key.term_per_unit for key in y.keys}
    changes: dict[str, Any] = across | down
    return replace(terms, **changes)


def _clause_of(found: tuple[Clause[FloatArray], ...], name: str) -> Clause[FloatArray]:
    return next(clause for clause in found if clause.name == name)


def _largest(values: Iterator[FloatArray]) -> FloatArray:
    largest = next(values)
    for value in values:
        largest = np.maximum(largest, value)
    return largest
