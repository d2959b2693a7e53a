"""Autopilot parameters: what one is, and the checks on setting it.

Which parameters exist depends on the flavour: ``px4_parameters``, ``ardupilot_parameters``.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from sitl.plant.controller import ControllerGains


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter; an ``int`` default makes it an integer on the wire."""

    name: str
    default: float
    minimum: float
    maximum: float
    meaning: str
    read_only: bool = False

    @property
    def is_integer(self) -> bool:
        """Whether the parameter travels as INT32 instead of REAL32."""
        return isinstance(self.default, int)


class SetResult(enum.Enum):
    """Outcome of a PARAM_SET."""

    DONE = enum.auto()
    UNKNOWN = enum.auto()
    OUT_OF_RANGE = enum.auto()
    READ_ONLY = enum.auto()


class ParameterError(ValueError):
    """A configured parameter that does not exist or is out of range."""


class ParameterStore:
    """The values, in alphabetical order; index and order are what PARAM_VALUE reports."""

    def __init__(self, specs: Iterable[ParameterSpec], overrides: Mapping[str, float]) -> None:
        """Apply ``overrides`` to the defaults.

        Raises:
            ParameterError: names the parameter, the value and the range.
        """
        self._specs = {spec.name: spec for spec in sorted(specs, key=lambda s: s.name)}
        self._values = {name: spec.default for name, spec in self._specs.items()}
        for name, value in overrides.items():
            result = self.set(name, value)
            if result is SetResult.OUT_OF_RANGE:
                spec = self._specs[name]
                allowed = f"{spec.minimum:g} to {spec.maximum:g}"
                raise ParameterError(f"parameters.{name} = {value:g} is not within {allowed}")
            if result is not SetResult.DONE:
                problem = "does not exist" if result is SetResult.UNKNOWN else "is read-only"
                raise ParameterError(f"parameters.{name} = {value:g}: {name} {problem}")

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._values)

    def names(self) -> tuple[str, ...]:
        """All names, in the order of their indices."""
        return tuple(self._values)

    def spec(self, name: str) -> ParameterSpec:
        """Description of a known parameter."""
        return self._specs[name]

    def set(self, name: str, value: float) -> SetResult:
        """Set a parameter if it exists, may be written, and the value is in range."""
        spec = self._specs.get(name)
        if spec is None:
            return SetResult.UNKNOWN
        if spec.read_only:
            return SetResult.READ_ONLY
        whole = not spec.is_integer or float(value).is_integer()
        if not (spec.minimum <= value <= spec.maximum and whole):  # refuses nan as well
            return SetResult.OUT_OF_RANGE
        self._values[name] = int(value) if spec.is_integer else float(value)
        return SetResult.DONE


class GainNames(NamedTuple):
    """What a flavour calls the controller's feedback gains."""

    roll: str
    pitch: str
    position: str
    velocity: str


def ideal_gains(names: GainNames) -> Mapping[str, float]:
    """Return the gains of an ideal controller, by the flavour's parameter names."""
    ideal = ControllerGains()
    return MappingProxyType(
        {
            names.roll: ideal.roll_per_s,
            names.pitch: ideal.pitch_per_s,
            names.position: ideal.position_per_s,
            names.velocity: ideal.velocity_per_s,
        }
    )
