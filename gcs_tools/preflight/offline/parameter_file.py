"""Checks an autopilot's parameters as a ground station has saved them, without the vehicle.

QGroundControl's ``.params`` have five fields a line (vehicle, component, name, value, type) and a
head that names firmware and version; Mission Planner's and MAVProxy's ``.param`` have name and
value, with a comma or spaces between them.  Comments begin with ``#``.  A file may lack parameters:
what it does not state is unknown.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final, NamedTuple

from gcs_tools.preflight.finding import VEHICLE_IDENTITY, Finding, Verdict
from gcs_tools.preflight.live.parameters import check_parameters
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import FileError, read_text
from onboard.mavlink.profiles.parameter_rules import ReportedParameters
from onboard.mavlink.profiles.registry import profile_named

_QGROUNDCONTROL_FIELDS: Final = 5
_NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,15}")
_STACK: Final = re.compile(r"#\s*Stack:\s*(PX4|ArduPilot)", re.IGNORECASE)
_VERSION: Final = re.compile(r"#\s*Version:\s*(\d+)\.(\d+)\.(\d+)")
# Beginnings of names that only one of them has.
_PREFIXES: Final = {"px4": "MPC_", "ardupilot": "ATC_"}


class ParameterFile(NamedTuple):
    """What a file of parameters states.

    Attributes:
        autopilot: ``px4`` or ``ardupilot``.
        version: of the firmware; None if the file does not say.
        values: by name.
    """

    autopilot: str
    version: tuple[int, int, int] | None
    values: dict[str, float]


def read_parameters(path: Path) -> ParameterFile:
    """Read a file of parameters.

    Raises:
        FileError: names the file, the line and the value.
    """
    text = read_text(path)
    values: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if words:
            name, value = _parameter(words, f"{path}: line {number}")
            values[name] = value
    stack, version = _STACK.search(text), _VERSION.search(text)
    found = [name for name, prefix in _PREFIXES.items() if _any_begins(values, prefix)]
    if stack is not None:
        found = [stack[1].lower()]
    if len(found) != 1:
        raise FileError(
            f"{path}: {len(values)} parameters of neither PX4 (MPC_...) nor ArduPilot Copter "
            "(ATC_...); save all parameters of the vehicle"
        )
    release = None if version is None else (int(version[1]), int(version[2]), int(version[3]))
    return ParameterFile(found[0], release, values)


def check_parameter_file(
    path: Path, assessment: Assessment, mission: Mission | None
) -> tuple[Finding, ...]:
    """Check a file of parameters against contract and mission, by the rules of its autopilot.

    Raises:
        FileError: the file cannot be used.
    """
    read = read_parameters(path)
    profile = profile_named(read.autopilot)
    version = "" if read.version is None else " " + ".".join(map(str, read.version))
    text = f"{profile.name}{version}, {len(read.values)} parameters of {path.name}"
    identity = Finding("vehicle", VEHICLE_IDENTITY, Verdict.HOLDS, text)
    if profile.parameters is None:
        unknown = Finding("vehicle", "parameters", Verdict.UNKNOWN, "no rules for this autopilot")
        return (identity, unknown)
    reported = ReportedParameters(read.values, read.version, complete=False)
    return (identity, *check_parameters(profile.parameters, reported, assessment, mission))


def _any_begins(values: dict[str, float], prefix: str) -> bool:
    return any(name.startswith(prefix) for name in values)


def _parameter(words: list[str], source: str) -> tuple[str, float]:
    fields = words[2:4] if len(words) == _QGROUNDCONTROL_FIELDS else words
    if len(fields) != 2:
        raise FileError(f"{source}: has {len(words)} fields, expected a name and a value, or five")
    name, text = fields
    if _NAME.fullmatch(name) is None:
        raise FileError(f"{source}: {name[:40]!r} is not the name of a parameter")
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileError(f"{source}: {name} = {text[:40]!r} is not a finite number")
    return name, value
