"""Conditions on single parameters of an autopilot, and rules made of alternatives.

A rule names alternatives, for instance "no radio is listened to, or its loss is ignored, or the
answer to its loss is harmless": it holds if any of them does, is broken if none does, and cannot be
checked if one that might is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from gcs_tools.preflight.finding import Finding, Verdict


@dataclass(frozen=True)
class Condition:
    """What one parameter has to be.

    Attributes:
        parameter: its name.
        holds: decides on its value.
        demand: the same in words.
    """

    parameter: str
    holds: Callable[[float], bool]
    demand: str

    def __str__(self) -> str:
        return f"{self.parameter} {self.demand}"


def at_least(parameter: str, limit: float, unit: str = "") -> Condition:
    """Return the condition that a parameter is no lower."""
    return Condition(
        parameter, lambda value: value >= limit - 1e-6, f"≥ {limit:.4g} {unit}".strip()
    )


def at_most(parameter: str, limit: float, unit: str = "") -> Condition:
    """Return the condition that a parameter is no higher."""
    return Condition(
        parameter, lambda value: value <= limit + 1e-6, f"≤ {limit:.4g} {unit}".strip()
    )


def one_of(parameter: str, *values: int) -> Condition:
    """Return the condition that a parameter has one of these values."""
    return Condition(parameter, lambda value: value in values, f"= {' or '.join(map(str, values))}")


def bit_set(parameter: str, bit: int) -> Condition:
    """Return the condition that a bit of a parameter is set; bits count from 0."""
    mask = 1 << bit
    return Condition(
        parameter, lambda value: bool(int(value) & mask), f"with bit {bit} (value {mask})"
    )


def bit_clear(parameter: str, bit: int) -> Condition:
    """Return the condition that a bit of a parameter is not set; bits count from 0."""
    mask = 1 << bit
    return Condition(
        parameter, lambda value: not int(value) & mask, f"without bit {bit} (value {mask})"
    )


@dataclass(frozen=True)
class ParameterRule:
    """One demand on the parameters.

    Attributes:
        reason: why.
        alternatives: any of them will do.
    """

    reason: str
    alternatives: tuple[Condition, ...]

    def finding(self, parameters: Mapping[str, float]) -> Finding:
        """Check the rule against what was read from the vehicle."""
        known = [each for each in self.alternatives if each.parameter in parameters]
        missing = _unique(each.parameter for each in self.alternatives if each not in known)
        holding = next((each for each in known if each.holds(parameters[each.parameter])), None)
        shown = [holding.parameter] if holding else _unique(each.parameter for each in known)
        values = ", ".join(f"{each} = {parameters[each]:g}" for each in shown)
        if holding is not None:
            verdict, text = Verdict.HOLDS, f"{values} ({holding.demand})"
        else:
            needed = " or ".join(map(str, self.alternatives))
            verdict = Verdict.UNKNOWN if missing else Verdict.BROKEN
            absent = f"{', '.join(missing)} not reported" if missing else ""
            found = "; ".join(filter(None, (values, absent)))
            text = f"{found}; needs {needed}: {self.reason}"
        return Finding("vehicle", (holding or self.alternatives[0]).parameter, verdict, text)


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))
