"""Autopilot parameters under PX4's names, and the checks on setting them.

Defaults are PX4's, except where a comment says otherwise.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter; an ``int`` default makes it an integer on the wire."""

    name: str
    default: float
    minimum: float
    maximum: float
    meaning: str

    @property
    def is_integer(self) -> bool:
        """Whether the parameter travels as INT32 instead of REAL32."""
        return isinstance(self.default, int)


PX4_PARAMETERS = (
    ParameterSpec("BAT_CRIT_THR", 0.07, 0.0, 1.0, "remaining charge below which to land"),
    ParameterSpec("BAT_LOW_THR", 0.15, 0.0, 1.0, "remaining charge below which to warn"),
    ParameterSpec("COM_DISARM_LAND", 2.0, -1.0, 20.0, "landed to disarmed [s]; negative: never"),
    ParameterSpec("COM_DISARM_PRFLT", 10.0, -1.0, 120.0, "armed without take-off to disarmed [s]"),
    # PX4's own default, 0, descends where there is no remote control; 5 holds.
    ParameterSpec("COM_OBL_RC_ACT", 5, 0, 7, "after loss of offboard: 3 return, 4 land, 5 hold"),
    ParameterSpec("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "offboard setpoints missing to failsafe [s]"),
    ParameterSpec("MAV_SYS_ID", 1, 1, 250, "MAVLink system id, read-only here"),
    ParameterSpec("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "default take-off altitude [m]"),
    # The jerk limits are higher than PX4's 4 and 8 m/s^3 so that hold brakes like the plans do.
    ParameterSpec("MPC_ACC_DOWN_MAX", 3.0, 2.0, 15.0, "autonomous acceleration downwards [m/s^2]"),
    ParameterSpec("MPC_ACC_HOR", 5.0, 2.0, 15.0, "autonomous horizontal acceleration [m/s^2]"),
    ParameterSpec("MPC_ACC_UP_MAX", 4.0, 2.0, 15.0, "autonomous acceleration upwards [m/s^2]"),
    ParameterSpec("MPC_JERK_AUTO", 30.0, 1.0, 80.0, "autonomous jerk [m/s^3]"),
    ParameterSpec("MPC_LAND_SPEED", 0.7, 0.6, 5.0, "sink rate when landing [m/s]"),
    ParameterSpec("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "tilt limit in flight [deg]"),
    ParameterSpec("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "climb rate at take-off [m/s]"),
    ParameterSpec("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "autonomous speed [m/s]"),
    ParameterSpec("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "speed limit in every mode [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "sink rate limit in every mode [m/s]"),
    ParameterSpec("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "climb rate limit in every mode [m/s]"),
    ParameterSpec("RTL_RETURN_ALT", 60.0, 0.0, 150.0, "least altitude of the return [m]"),
)


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

    def __init__(self, system_id: int, overrides: Mapping[str, float]) -> None:
        """Apply ``overrides`` to the defaults.

        Raises:
            ParameterError: names the parameter, the value and the range.
        """
        self._specs = {spec.name: spec for spec in sorted(PX4_PARAMETERS, key=lambda s: s.name)}
        self._values = {name: spec.default for name, spec in self._specs.items()}
        self._values["MAV_SYS_ID"] = system_id
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
        if name == "MAV_SYS_ID":
            return SetResult.READ_ONLY
        whole = not spec.is_integer or float(value).is_integer()
        if not (spec.minimum <= value <= spec.maximum and whole):  # refuses nan as well
            return SetResult.OUT_OF_RANGE
        self._values[name] = int(value) if spec.is_integer else float(value)
        return SetResult.DONE
