"""Finds the smallest change of one key of the contract that satisfies a broken clause.

Tries each key in growing steps from the declared value outwards until the clause holds, then
bisects the limit, with the function that the pre-flight check uses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from gcs_tools.contract.keys import ContractKey, contract_key
from onboard.contract.assessment import Assessment, assess
from onboard.files.contract_file import Contract, InputSet
from onboard.files.yaml_file import FileError

# Keys that an operator can influence, and the words for each.
_ADVICE = {
    "vehicle.cruise_speed_mps": "cruise at",
    "sensor.detection_range_m": "see",
    "sensor.field_of_view_deg": "see a field of",
    "sensor.frame_age_max_s": "look every",
    "sensor.position_error_m": "measure faces to",
    "environment.obstacle_size_max_m": "meet obstacles of",
    "environment.obstacle_separation_min_m": "keep to obstacles apart by",
    "vehicle.roll_max_deg": "roll",
    "vehicle.pitch_max_deg": "pitch",
    "vehicle.thrust_to_weight": "lift",
    "vehicle.tracking_error_m": "track to",
    "vehicle.velocity_error_mps.0": "hold the speed to",
    "vehicle.velocity_error_mps.1": "drift sideways at",
    "vehicle.reaction_time_s": "react in",
    "vehicle.attitude_lag_s": "tilt in",
    "vehicle.setpoint_loss_timeout_s": "notice a lost stream in",
    "vehicle.setpoint_loss_run_on_m": "run on by",
    "vehicle.tracking_error_z_m": "hold the height to",
    "vehicle.radius_z_m": "be as high as",
    "vehicle.height_drift_m": "know the height to",
    "vehicle.height_drift_flight_m": "know the height over a whole flight to",
    "sensor.position_error_z_m": "measure tops to",
    "environment.terrain_error_m": "know the ground to",
    "vehicle.heading_error_deg": "know the heading to",
    "vehicle.drag_per_s": "meet a drag of",
    "environment.wind_max_mps": "fly in wind of",
}

_FIRST_STEP = 1e-3
_STEP_GROWTH = 1.3
# Changes beyond this factor are not suggested.
_LARGEST_FACTOR = 30.0
_BISECTIONS = 30
_DIGITS = (3, 4, 6, 9)


@dataclass(frozen=True)
class Remedy:
    """One change of one key that satisfies a broken clause.

    Attributes:
        clause: that it satisfies.
        key: dotted key, as for ``--set``.
        declared, value: before and after, in ``unit``; rounded to the complying side.
        unit: of both.
        settles_all: every other clause holds then, too.
    """

    clause: str
    key: str
    declared: float
    value: float
    unit: str
    settles_all: bool

    @property
    def change(self) -> float:
        """Size of the change as a share of declared."""
        return abs(self.value - self.declared) / abs(self.declared)

    def __str__(self) -> str:
        sign = "≥" if self.value > self.declared else "≤"
        also = "" if self.settles_all else " (not enough alone)"
        return f"{_ADVICE[self.key]} {sign} {self.value:.9g} {self.unit}{also}"


def remedies(assessment: Assessment) -> tuple[Remedy, ...]:
    """Return the changes that satisfy each broken clause, clause by clause, smallest first.

    Clauses that no single key can satisfy have none.
    """
    found: list[Remedy] = []
    for clause in assessment.clauses:
        if not clause.holds:
            satisfying = (_remedy(assessment, clause.name, contract_key(path)) for path in _ADVICE)
            found += sorted(filter(None, satisfying), key=lambda remedy: remedy.change)
    return tuple(found)


def _remedy(assessment: Assessment, clause: str, key: ContractKey) -> Remedy | None:
    contract, input_set = assessment.contract, assessment.terms.input_set
    altitude_m = assessment.terms.mission_altitude_m
    declared = key.value_in(contract)
    if not declared:  # None or 0, which cannot be scaled
        return None

    def satisfies(value: float) -> bool:
        changed = _assessed(contract, key, value, input_set, altitude_m)
        return changed is not None and all(c.holds for c in changed.clauses if c.name == clause)

    values = filter(None, (_nearest(declared, growing, satisfies) for growing in (True, False)))
    nearest = min(values, key=lambda value: abs(value - declared), default=None)
    if nearest is None:
        return None
    changed = _assessed(contract, key, nearest, input_set, altitude_m)
    settled = changed is not None and changed.compliant
    return Remedy(clause, key.path, declared, nearest, key.unit, settled)


def _nearest(declared: float, growing: bool, satisfies: Callable[[float], bool]) -> float | None:
    """Return the value nearest to ``declared`` that satisfies, on one side of it."""
    outside = declared
    for inside in _steps(declared, growing):
        if satisfies(inside):
            return _rounded(*_bisected(inside, outside, satisfies), satisfies)
        outside = inside
    return None


def _steps(declared: float, growing: bool) -> Iterator[float]:
    step = _FIRST_STEP
    while (factor := 1.0 + step) < _LARGEST_FACTOR:
        yield declared * factor if growing else declared / factor
        step *= _STEP_GROWTH


def _bisected(
    inside: float, outside: float, satisfies: Callable[[float], bool]
) -> tuple[float, float]:
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2.0
        inside, outside = (middle, outside) if satisfies(middle) else (inside, middle)
    return inside, outside


def _rounded(inside: float, outside: float, satisfies: Callable[[float], bool]) -> float:
    """Round to few digits, towards the side that satisfies."""
    towards = math.ceil if inside > outside else math.floor
    for digits in _DIGITS:
        unit = 10.0 ** (math.floor(math.log10(inside)) + 1 - digits)
        value = round(towards(inside / unit) * unit, 12)
        if satisfies(value):
            return value
    return inside


def _assessed(
    contract: Contract,
    key: ContractKey,
    value: float,
    input_set: InputSet,
    mission_altitude_m: float | None,
) -> Assessment | None:
    """Assess a changed contract; None if the value is not admissible."""
    try:
        return assess(
            key.changed(contract, value), input_set, mission_altitude_m=mission_altitude_m
        )
    except FileError:
        return None
