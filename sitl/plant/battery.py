"""Battery pack: state of charge, open-circuit voltage, internal resistance.

The open-circuit voltage of a lithium-polymer cell is interpolated over its state of charge; the
terminal voltage solves P = U I with U = U_oc - R I.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from onboard.files.yaml_file import FileModel
from sitl.plant.multirotor import MultirotorParameters, MultirotorState

# Typical rest voltage of one lithium-polymer cell.
_CHARGE = (0.0, 0.05, 0.10, 0.20, 0.40, 0.60, 0.80, 0.90, 1.0)
_CELL_V = (3.27, 3.61, 3.69, 3.73, 3.79, 3.87, 4.02, 4.11, 4.20)

_RADPS_PER_RPM = 2.0 * math.pi / 60.0


class BatteryConfig(FileModel):
    """The pack, and the consumers besides the rotors."""

    cells: Annotated[int, Field(ge=1, le=14)] = 4
    capacity_ah: Annotated[float, Field(gt=0.0)] = 5.0
    resistance_ohm: Annotated[float, Field(ge=0.0)] = 0.02
    avionics_w: Annotated[float, Field(ge=0.0)] = 12.0
    drive_efficiency: Annotated[float, Field(gt=0.0, le=1.0)] = 0.75
    initial_charge: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0


@dataclass(frozen=True)
class BatteryReading:
    """What a battery monitor reads: terminal voltage, current, remaining share, charge used."""

    voltage_v: float
    current_a: float
    remaining: float
    consumed_ah: float


class Battery:
    """Integrate the current drawn; the pack never recharges."""

    def __init__(self, config: BatteryConfig) -> None:
        self._config = config
        self._consumed_ah = (1.0 - config.initial_charge) * config.capacity_ah
        self.reading = self._read(config.avionics_w)

    def drain(self, power_w: float, time_s: float) -> None:
        """Deliver ``power_w`` on top of the avionics for ``time_s``."""
        self.reading = self._read(power_w + self._config.avionics_w)
        self._consumed_ah = min(
            self._consumed_ah + self.reading.current_a * time_s / 3600.0, self._config.capacity_ah
        )

    def drive_power_w(self, state: MultirotorState, parameters: MultirotorParameters) -> float:
        """Electrical power of the four rotors: drag torque times speed, over the efficiency."""
        cubes = (
            state.rotor1_rpm**3 + state.rotor2_rpm**3 + state.rotor3_rpm**3 + state.rotor4_rpm**3
        )
        shaft_w = parameters.torque_coefficient_nm_per_rpm2 * cubes * _RADPS_PER_RPM
        return shaft_w / self._config.drive_efficiency

    def _read(self, power_w: float) -> BatteryReading:
        config = self._config
        remaining = 1.0 - self._consumed_ah / config.capacity_ah
        open_v = config.cells * _cell_voltage_v(remaining)
        root = max(open_v**2 - 4.0 * config.resistance_ohm * power_w, 0.0)
        voltage_v = 0.5 * (open_v + math.sqrt(root))
        return BatteryReading(voltage_v, power_w / voltage_v, remaining, self._consumed_ah)


def _cell_voltage_v(charge: float) -> float:
    upper = min(max(bisect_right(_CHARGE, charge), 1), len(_CHARGE) - 1)
    share = (charge - _CHARGE[upper - 1]) / (_CHARGE[upper] - _CHARGE[upper - 1])
    return _CELL_V[upper - 1] + share * (_CELL_V[upper] - _CELL_V[upper - 1])
