"""What telemetry reports, at one instant."""

from __future__ import annotations

from typing import NamedTuple

from sitl.autopilot.commander import Commander
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.realism import Realism
from sitl.config import HomeConfig
from sitl.plant.battery import BatteryReading
from sitl.plant.estimator import Estimator
from sitl.plant.truth import VehicleTruth


class Snapshot(NamedTuple):
    """Everything that telemetry reports, at one instant."""

    truth: VehicleTruth
    battery: BatteryReading
    commander: Commander
    home: HomeConfig
    flavour: Flavour
    start_unix_s: float
    realism: Realism
    estimator: Estimator

    @property
    def reports_position(self) -> bool:
        """Whether LOCAL_POSITION_NED is sent; real autopilots send it for some time without GPS."""
        if self.commander.estimator_ready:
            return True
        return 0.0 < self.estimator.lost_for_s < self.realism.reports_lost_position_s

    @property
    def boot_ms(self) -> int:
        """Time since start [ms]."""
        return round(self.truth.time_s * 1e3) & 0xFFFFFFFF

    @property
    def unix_us(self) -> int:
        """Time of day [us]."""
        return round((self.start_unix_s + self.truth.time_s) * 1e6)


def int16(value: float) -> int:
    """Return a value as a MAVLink int16 field has it: rounded, and saturated at both ends."""
    return min(max(round(value), -32767), 32767)
