"""Rules on an autopilot's parameters, as data: what a profile demands before a flight.

A rule names alternatives, for instance "the vehicle ignores its radio, or ignores the loss of the
radio, or answers that loss harmlessly": one of them must hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

Version = tuple[int, int, int]
Release = tuple[int, int]

# Parameters are 32-bit floats on the wire; this much of a difference is their round-off.
_ROUND_OFF: Final = 1e-6
_PER_UNIT_TYPED: Final = 1000.0


@dataclass(frozen=True)
class Condition:
    """What the value of one parameter has to be.

    Attributes:
        parameter: its name.
        holds: decides on its value.
        demand: the same in words.
        cured: returns a value for which it holds, given the value that the vehicle has.
        bounds: whether it bounds a quantity; others choose what the autopilot does.
    """

    parameter: str
    holds: Callable[[float], bool]
    demand: str
    cured: Callable[[float], float]
    bounds: bool = False

    def __str__(self) -> str:
        return f"{self.parameter} {self.demand}"


def at_least(parameter: str, limit: float, unit: str = "") -> Condition:
    """Demand a value of at least ``limit``."""
    return Condition(
        parameter,
        lambda value: value >= limit - _ROUND_OFF,
        f"≥ {limit:.4g} {unit}".strip(),
        lambda _: _rounded(limit, math.ceil),
        bounds=True,
    )


def at_most(parameter: str, limit: float, unit: str = "") -> Condition:
    """Demand a value of at most ``limit``."""
    return Condition(
        parameter,
        lambda value: value <= limit + _ROUND_OFF,
        f"≤ {limit:.4g} {unit}".strip(),
        lambda _: _rounded(limit, math.floor),
        bounds=True,
    )


def one_of(parameter: str, *values: int) -> Condition:
    """Demand one of these values; 0 switches off, so that it is the last that cures."""
    return Condition(
        parameter,
        lambda value: value in values,
        f"= {' or '.join(map(str, values))}",
        lambda _: next((value for value in values if value), 0),
    )


def bit_set(parameter: str, bit: int) -> Condition:
    """Demand that a bit is set; bits count from 0."""
    mask = 1 << bit
    return Condition(
        parameter,
        lambda value: _has_bits(value, mask),
        f"with bit {bit} (value {mask})",
        lambda value: _bits(value) | mask,
    )


def bit_clear(parameter: str, bit: int) -> Condition:
    """Demand that a bit is not set; bits count from 0."""
    mask = 1 << bit
    return Condition(
        parameter,
        lambda value: math.isfinite(value) and not _has_bits(value, mask),
        f"without bit {bit} (value {mask})",
        lambda value: _bits(value) & ~mask,
    )


def _rounded(limit: float, rounding: Callable[[float], int]) -> float:
    """Round a limit to its safe side, to as many digits as an operator types."""
    return rounding(limit * _PER_UNIT_TYPED) / _PER_UNIT_TYPED


def _bits(value: float) -> int:
    return int(value) if math.isfinite(value) else 0


def _has_bits(value: float, mask: int) -> bool:
    return math.isfinite(value) and bool(int(value) & mask)


@dataclass(frozen=True)
class ParameterRule:
    """One demand on the parameters.

    Attributes:
        reason: why, for the operator.
        alternatives: conditions of which one must hold.
    """

    reason: str
    alternatives: tuple[Condition, ...]


class ParameterName(NamedTuple):
    """One name of a quantity, where releases name it differently.

    Attributes:
        name: as the vehicle reports it.
        unit: of its value.
        per_unit: its value for one SI unit (angles: one degree) of the quantity.
        first, last: releases that know this name.
    """

    name: str
    unit: str
    per_unit: float
    first: Release
    last: Release


@dataclass(frozen=True)
class ReportedParameters:
    """The parameters of a vehicle as it reported them.

    Attributes:
        values: by name, in the autopilot's own units.
        version: of the firmware; None where it reported none.
        complete: whether ``values`` are all that the vehicle has.
    """

    values: Mapping[str, float]
    version: Version | None = None
    complete: bool = True


class Failsafe(NamedTuple):
    """What a failsafe of an autopilot does, by the value of a parameter.

    Attributes:
        cause: what it answers.
        parameter: whose value says how.
        reactions: in words, by value.
    """

    cause: str
    parameter: str
    reactions: Mapping[int, str]

    def in_words(self, values: Mapping[str, float]) -> str | None:
        """Say what it does; None where the vehicle does not report its parameter."""
        value = values.get(self.parameter)
        if value is None:
            return None
        known = self.reactions.get(int(value)) if math.isfinite(value) else None
        return f"{self.cause}: {known or 'not known'} ({self.parameter} = {value:g})"


@dataclass(frozen=True)
class ContractDemands:
    """What a contract demands of any autopilot.

    Attributes:
        tilt_deg: tilt that the autopilot must allow, with reserve for control and against wind.
        tilt_reason: why, for the operator.
        speed_mps: horizontal speed that it must allow.
        acceleration_mps2: horizontal acceleration that it must allow, with reserve for control.
        plan_jerk_mps3: greatest jerk of a plan.
        attitude_lag_s: time constant of the attitude that the contract declares.
        setpoint_timeout_s: time without setpoints after which the autopilot must act.
    """

    tilt_deg: float
    tilt_reason: str
    speed_mps: float
    acceleration_mps2: float
    plan_jerk_mps3: float
    attitude_lag_s: float
    setpoint_timeout_s: float


@dataclass(frozen=True)
class MissionDemands:
    """What a mission demands of the geofence that the autopilot's parameters describe.

    Attributes:
        radius_m: horizontal distance from the start that the mission may reach.
        height_m: height above the start that it may reach.
    """

    radius_m: float
    height_m: float


# The reason that every autopilot's rules give for its reaction to the loss of a link.
RADIO_LOSS: Final = "the loss of the radio must not fly the vehicle home through obstacles"
GROUND_STATION_LOSS: Final = (
    "the loss of the ground station must not fly the vehicle home through obstacles"
)
BATTERY_LOW: Final = "a low battery must not fly the vehicle home through obstacles"
BEFORE_FAILSAFE: Final = "the vehicle returns at energy.reserve_fraction before the autopilot acts"
FENCE_BREACHED: Final = "leaving the geofence must not fly the vehicle home through obstacles"
FLIGHT_TIME_OVER: Final = "the end of a flight time must not fly the vehicle home through obstacles"
WIND_TOO_STRONG: Final = "strong wind must not fly the vehicle home through obstacles"
POSITION_LOST: Final = (
    "the loss of the position must not fly the vehicle home by dead reckoning through obstacles"
)
SETPOINT_LOSS: Final = "the contract's setpoint_loss_timeout_s"
WITHIN_FENCE: Final = "the mission must lie within the geofence"


def names_in(
    names: tuple[ParameterName, ...], version: Version | None, known: tuple[Release, Release]
) -> list[ParameterName]:
    """Return the names that a release knows; all of them where the release is not known.

    Args:
        names: of one quantity.
        version: of the firmware.
        known: oldest and newest release that the names were written from; any other release is
            taken for the nearest of these.
    """
    if version is None:
        return list(names)
    oldest, newest = known
    release = min(max(version[:2], oldest), newest)
    return [each for each in names if each.first <= release <= each.last]


def rules_of_renamed(
    reason: str,
    names: list[ParameterName],
    reported: ReportedParameters,
    condition: Callable[[ParameterName], Condition],
) -> list[ParameterRule]:
    """Return one rule for each name that the vehicle reports; one of all names if it has none.

    Args:
        reason: of each rule.
        names: of one quantity, that the release may know.
        reported: what the vehicle has.
        condition: makes the condition on a name, in its unit.
    """
    present = [[each] for each in names if each.name in reported.values]
    return [ParameterRule(reason, tuple(map(condition, group))) for group in present or [names]]
