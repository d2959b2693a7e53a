"""Which firmware was measured, which is known by its parameters, and what those are called.

Names and units follow the parameter lists that the two projects publish for each release.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from gcs_tools.preflight.finding import Finding, Verdict

Version = tuple[int, int, int]


class Measured(NamedTuple):
    """Firmware that flew with this service.

    Attributes:
        release: major and minor number.
        stages: of development, as AUTOPILOT_VERSION states them.
        text: the same for people.
    """

    release: tuple[int, int]
    stages: tuple[str, ...]
    text: str


MEASURED: Final[Mapping[str, Measured]] = {
    "px4": Measured((1, 16), ("dev", "alpha"), "main of February 2025"),
    "ardupilot": Measured((4, 7), ("dev",), "4.7-dev of July 2025"),
}
# The oldest and the newest release whose parameter lists the rules were written from.
KNOWN: Final[Mapping[str, tuple[tuple[int, int], tuple[int, int]]]] = {
    "px4": ((1, 14), (1, 18)),
    "ardupilot": ((4, 5), (4, 7)),
}


class ParameterName(NamedTuple):
    """One name of a quantity.

    Attributes:
        name: as the vehicle reports it.
        unit: of its value.
        per_unit: its value for one SI unit (angles: one degree) of the quantity.
        first, last: releases that know this name.
    """

    name: str
    unit: str
    per_unit: float
    first: tuple[int, int]
    last: tuple[int, int]


# ArduPilot 4.7 renames; its development versions bear the old names until shortly before.
TILT_LIMIT: Final = (
    ParameterName("ANGLE_MAX", "cdeg", 100.0, (4, 5), (4, 7)),
    ParameterName("ATC_ANGLE_MAX", "deg", 1.0, (4, 7), (4, 7)),
)
GUIDED_ACCELERATION: Final = (
    ParameterName("WPNAV_ACCEL", "cm/s²", 100.0, (4, 5), (4, 7)),
    ParameterName("WP_ACC", "m/s²", 1.0, (4, 7), (4, 7)),
)
# Public sources contradict each other about the new name.
POSITION_JERK: Final = (
    ParameterName("PSC_JERK_XY", "m/s³", 1.0, (4, 5), (4, 7)),
    ParameterName("PSC_NE_JERK", "m/s³", 1.0, (4, 7), (4, 7)),
    ParameterName("PSC_JERK_NE", "m/s³", 1.0, (4, 7), (4, 7)),
)
CHECKS_RUN: Final = (ParameterName("ARMING_CHECK", "", 1.0, (4, 5), (4, 7)),)
CHECKS_SKIPPED: Final = (ParameterName("ARMING_SKIPCHK", "", 1.0, (4, 7), (4, 7)),)


def names_in(names: tuple[ParameterName, ...], version: Version | None) -> list[ParameterName]:
    """Return the names that a release knows; all of them where the release is not known.

    Releases beyond the known ones are judged by the nearest that is known.
    """
    if version is None:
        return list(names)
    oldest, newest = KNOWN["ardupilot"]
    release = min(max(version[:2], oldest), newest)
    return [each for each in names if each.first <= release <= each.last]


def firmware_finding(flavour: str | None, version: Version | None, stage: str) -> Finding:
    """Tell whether the firmware was measured, is known by its parameters only, or neither.

    Args:
        flavour: ``px4``, ``ardupilot``, or None for another autopilot.
        version: from AUTOPILOT_VERSION.
        stage: of development, from the same; empty if it states none.
    """
    if version is None or flavour is None:
        return Finding("vehicle", "firmware", Verdict.UNKNOWN, "no version reported")
    found = " ".join(filter(None, (flavour, ".".join(map(str, version)), stage)))
    oldest, newest = KNOWN[flavour]
    span = f"{oldest[0]}.{oldest[1]} to {newest[0]}.{newest[1]}"
    if version[:2] < oldest:
        text = f"{found}, needs {oldest[0]}.{oldest[1]} or later"
        return Finding("vehicle", "firmware", Verdict.BROKEN, text)
    if version[:2] > newest:
        text = f"{found}: untried, and newer than the parameters that are known ({span})"
        return Finding("vehicle", "firmware", Verdict.UNKNOWN, text)
    measured = MEASURED[flavour]
    if version[:2] == measured.release and stage in measured.stages:
        return Finding("vehicle", "firmware", Verdict.HOLDS, f"{found}, measured: {measured.text}")
    text = f"{found}: untried (measured: {measured.text}), judged by the parameters of {span}"
    return Finding("vehicle", "firmware", Verdict.HOLDS, text)
