"""The numeric keys of a contract file: units, admissible values, and how to change them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Any

from gcs_tools.console.errors import CommandError
from onboard.files.contract_file import Contract
from onboard.files.yaml_file import unit_of, validate

_SUGGESTIONS_MAX = 3
_ITEM_TERMS = {
    "velocity_error_mps.0": "velocity_error_x_mps",
    "velocity_error_mps.1": "velocity_error_y_mps",
    "vertical_field_of_view_deg.0": "view_up_rad",
    "vertical_field_of_view_deg.1": "view_down_rad",
}


@dataclass(frozen=True)
class ContractKey:
    """One number of a contract file.

    Attributes:
        path: dotted key, as for ``--set``; list items are numbered from 0.
        lower, upper: bounds of the admissible values; infinite without one.
        lower_admitted, upper_admitted: whether the bounds themselves are admissible.
    """

    path: str
    lower: float
    upper: float
    lower_admitted: bool
    upper_admitted: bool

    @property
    def unit(self) -> str:
        """Unit of the file, degrees included."""
        return unit_of(self.path.rstrip(".0123456789"))

    @property
    def term(self) -> str:
        """Name of the field of `onboard.contract.terms.Terms` that holds this number."""
        name = self.path.partition(".")[2]
        return _ITEM_TERMS.get(name, name).replace("_deg", "_rad")

    @property
    def term_per_unit(self) -> float:
        """Factor from the file's unit to that of `Terms`."""
        return math.radians(1.0) if self.unit == "°" else 1.0

    def value_in(self, contract: Contract) -> float | None:
        """Return the value that a contract states; None if it states none.

        Where a pair stands for the number, that is the distance that keeps to the pair in any
        direction.
        """
        value: Any = contract.model_dump()
        for part in self.path.split("."):
            if value is None:  # the pair that the number is one of
                return None
            value = value[int(part)] if part.isdecimal() else value[part]
        if isinstance(value, tuple):
            return math.hypot(*value)
        return None if value is None else float(value)

    def changed(self, contract: Contract, value: float) -> Contract:
        """Return a contract with another value for this key.

        Raises:
            FileError: the value, or the contract with it, is not admissible.
        """
        document = contract.model_dump()
        section_name, _, name = self.path.partition(".")
        section = document[section_name]
        name, is_item, index = name.partition(".")
        if is_item:
            items = list(section[name] or (value, value))
            items[int(index)] = value
            section[name] = tuple(items)
        else:
            section[name] = value
        return validate(document, Contract, source=f"{self.path} = {value:g}")


def contract_key(path: str) -> ContractKey:
    """Look up a dotted key.

    Raises:
        CommandError: the key is unknown or not numeric.
    """
    try:
        return numeric_keys()[path]
    except KeyError:
        raise CommandError(
            f"unknown numeric contract key {path!r}; {suggestion(path, numeric_keys())}"
        ) from None


def suggestion(unknown: str, known: Iterable[str]) -> str:
    """Return "did you mean …?" with the names most like an unknown one; without any, list all."""
    names = list(known)
    # Sections are left out: every key of a section is like every other one with a short name.
    short = {name.partition(".")[2] or name: name for name in names}
    wanted = unknown.partition(".")[2] or unknown.strip(".")
    close = [key for key in short if wanted in key] or get_close_matches(wanted, short)
    if wanted and close:
        return f"did you mean {' or '.join(short[key] for key in close[:_SUGGESTIONS_MAX])}?"
    return f"expected one of {', '.join(names)}"


@cache
def numeric_keys() -> dict[str, ContractKey]:
    """Return every numeric key of a contract file by its path, in the order of the file."""
    schema = Contract.model_json_schema()
    found: dict[str, ContractKey] = {}
    for section_name, section in schema["properties"].items():
        reference = section["$ref"].rpartition("/")[2]
        for name, described in schema["$defs"][reference]["properties"].items():
            for path, number in _numbers(f"{section_name}.{name}", described):
                found[path] = ContractKey(
                    path,
                    lower=number.get("minimum", number.get("exclusiveMinimum", -math.inf)),
                    upper=number.get("maximum", number.get("exclusiveMaximum", math.inf)),
                    lower_admitted="minimum" in number,
                    upper_admitted="maximum" in number,
                )
    return found


def _numbers(path: str, described: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the numbers of one property of a JSON Schema, with their dotted keys."""
    if described.get("type") == "number":
        yield path, described
    for index, item in enumerate(described.get("prefixItems", ())):
        yield from _numbers(f"{path}.{index}", item)
    alternatives = described.get("anyOf", ())
    numbers = [each for each in alternatives if each.get("type") == "number"]
    for alternative in numbers or alternatives:
        yield from _numbers(path, alternative)
