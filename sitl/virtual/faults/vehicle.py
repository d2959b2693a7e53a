"""Faults of the vehicle: applied to the simulated one as they begin and end.

What an operator could change (parameters) is sent as MAVLink; what only physics can do (gusts, weak
rotors) acts on the plant; the rest are failures that the autopilot injects.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Final

from pymavlink.dialects.v20 import common as mavlink

from sitl.plant.multirotor import INTACT, RotorSpeeds
from sitl.plant.wind import Gust
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import FaultKind

# Which parameters of which flavour a kind sets to its amount, times the factor of their unit.
_PARAMETERS: Final[dict[FaultKind, dict[str, dict[str, float]]]] = {
    "parameter_changed": {
        "px4": {"MPC_TILTMAX_AIR": 1.0},
        "ardupilot": {"ANGLE_MAX": 100.0},
    },
    "attitude_slow": {
        "px4": {"MC_ROLL_P": 1.0, "MC_PITCH_P": 1.0},
        "ardupilot": {"ATC_ANG_RLL_P": 1.0, "ATC_ANG_PIT_P": 1.0},
    },
}
_GUST_S: Final = 3.0
_FAILED_MOTOR: Final = 1.0


class VehicleFaults:
    """Apply the faults of one vehicle.

    Args:
        schedule: what is present.
        vehicle: the vehicle to change.
        system_id: its MAVLink id.
        flavour: whose parameters it has.
        link: on which an operator sends to it.
    """

    def __init__(
        self,
        schedule: FaultSchedule,
        vehicle: SimulatedVehicle,
        system_id: int,
        flavour: str,
        link: int,
    ) -> None:
        self._schedule = schedule
        self._vehicle = vehicle
        self._system_id, self._flavour, self._link = system_id, flavour, link
        self._parameters_before: dict[str, float] = {}
        self._upwards_m = 0.0
        self._applied: set[FaultKind] = set()
        self._mavlink = mavlink.MAVLink(None, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def apply(self) -> None:
        """Begin the faults that are present now, and end those that no longer are."""
        if not (self._schedule.any_present or self._applied):
            return
        for kind, begin_or_end in self.APPLIERS.items():
            amount, applied = self._schedule.amount(kind), kind in self._applied
            if (amount is not None) is not applied:
                self._applied ^= {kind}
                begin_or_end(self, amount)

    # Each begins a fault with its amount, or ends it: None.

    def _change_tilt_limit(self, amount: float | None) -> None:
        self._change_parameters("parameter_changed", amount)

    def _change_attitude_gains(self, amount: float | None) -> None:
        self._change_parameters("attitude_slow", amount)

    def _blow(self, amount: float | None) -> None:
        if amount is not None:
            peak_ned_mps = (0.0, amount, 0.0)
            self._vehicle.add_gust(
                Gust(start_s=self._schedule.now_s, duration_s=_GUST_S, peak_ned_mps=peak_ned_mps)
            )

    def _lose_gps(self, amount: float | None) -> None:
        self._inject(mavlink.FAILURE_UNIT_SENSOR_GPS, 0.0, present=amount is not None)

    def _fail_motor(self, amount: float | None) -> None:
        self._inject(mavlink.FAILURE_UNIT_SYSTEM_MOTOR, _FAILED_MOTOR, present=amount is not None)

    def _jump_up(self, amount: float | None) -> None:
        change_m = -self._upwards_m if amount is None else amount
        self._upwards_m += change_m
        self._vehicle.autopilot.estimator.jump(0.0, 0.0, -change_m)

    def _refuse_modes(self, amount: float | None) -> None:
        self._vehicle.autopilot.commander.failures.modes_refused = amount is not None

    def _weaken_rotors(self, amount: float | None) -> None:
        shares = INTACT if amount is None else RotorSpeeds(amount, amount, amount, amount)
        self._vehicle.autopilot.commander.failures.rotor_shares = shares

    def _inject(self, unit: int, instance: float, *, present: bool) -> None:
        failure = mavlink.FAILURE_TYPE_OFF if present else mavlink.FAILURE_TYPE_OK
        failures = self._vehicle.autopilot.commander.failures
        failures.inject(unit, failure, instance, self._schedule.now_s)

    def _change_parameters(self, kind: FaultKind, amount: float | None) -> None:
        for name, factor in _PARAMETERS[kind][self._flavour].items():
            self._parameters_before.setdefault(name, self._vehicle.autopilot.parameters[name])
            value = self._parameters_before[name] if amount is None else amount * factor
            message = self._mavlink.param_set_encode(
                self._system_id,
                mavlink.MAV_COMP_ID_AUTOPILOT1,
                name.encode(),
                value,
                mavlink.MAV_PARAM_TYPE_REAL32,
            )
            self._vehicle.receive(message.pack(self._mavlink), self._link)

    APPLIERS: ClassVar[dict[FaultKind, Callable[[VehicleFaults, float | None], None]]] = {
        "parameter_changed": _change_tilt_limit,
        "attitude_slow": _change_attitude_gains,
        "gust": _blow,
        "gps_lost": _lose_gps,
        "height_reset": _jump_up,
        "mode_rejected": _refuse_modes,
        "thrust_lost": _weaken_rotors,
        "motor_failed": _fail_motor,
    }


KINDS: Final[frozenset[FaultKind]] = frozenset(VehicleFaults.APPLIERS)
