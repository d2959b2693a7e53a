"""Faults of the vehicle itself, applied to the simulated one as they come and go.

What an operator could do (parameters, failures that the autopilot injects) is sent as MAVLink; what
only physics can do (gusts, weak rotors) acts on the plant.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from sitl.plant.multirotor import INTACT, RotorSpeeds
from sitl.plant.wind import Gust
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.virtual.faults.schedule import FaultInjector, FaultKind

# Which parameters of which flavour a kind changes; copter's are in its own units.
_PARAMETERS: Final[dict[str, dict[FaultKind, dict[str, float]]]] = {
    "px4": {
        "parameter_changed": {"MPC_TILTMAX_AIR": 1.0},
        "attitude_slow": {"MC_ROLL_P": 1.0, "MC_PITCH_P": 1.0},
    },
    "ardupilot": {
        "parameter_changed": {"ANGLE_MAX": 100.0},
        "attitude_slow": {"ATC_ANG_RLL_P": 1.0, "ATC_ANG_PIT_P": 1.0},
    },
}
_GUST_S: Final = 3.0


class PlantFaults:
    """Breaks one vehicle, and mends it.

    Args:
        vehicle: what is broken.
        system_id, flavour: how it is spoken to.
        link: on which an operator speaks to it.
    """

    def __init__(self, vehicle: SimulatedVehicle, system_id: int, flavour: str, link: int) -> None:
        self._vehicle = vehicle
        self._system_id, self._link = system_id, link
        self._parameters = _PARAMETERS[flavour]
        self._before: dict[str, float] = {}
        self._upwards_m = 0.0
        self._broken: set[FaultKind] = set()
        self._mavlink = mavlink.MAVLink(None, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def apply(self, faults: FaultInjector, now_s: float) -> None:
        """Begin what is present now, and end what is not any more."""
        if not (faults.any_present or self._broken):
            return
        for kind in self._kinds:
            amount, broken = faults.amount(kind), kind in self._broken
            if (amount is None) is not broken:
                continue
            self._broken ^= {kind}
            if kind in self._parameters:
                self._change_parameters(kind, amount)
            elif kind == "gust":
                if amount is not None:
                    self._vehicle.add_gust(
                        Gust(start_s=now_s, duration_s=_GUST_S, peak_ned_mps=(0.0, amount, 0.0))
                    )
            else:
                self._fail(kind, amount, now_s)

    @property
    def _kinds(self) -> tuple[FaultKind, ...]:
        return (
            *self._parameters,
            "gust",
            "gps_lost",
            "height_reset",
            "mode_rejected",
            "thrust_lost",
            "motor_failed",
        )

    def _fail(self, kind: FaultKind, amount: float | None, now_s: float) -> None:
        failures = self._vehicle.autopilot.commander.failures
        present = amount is not None
        match kind:
            case "gps_lost":
                failure = mavlink.FAILURE_TYPE_OFF if present else mavlink.FAILURE_TYPE_OK
                failures.inject(mavlink.FAILURE_UNIT_SENSOR_GPS, failure, 0.0, now_s)
            case "height_reset":
                upwards_m = self._upwards_m if amount is None else amount
                self._upwards_m = upwards_m
                sign = 1.0 if present else -1.0
                self._vehicle.autopilot.estimator.jump(0.0, 0.0, -sign * upwards_m)
            case "motor_failed":
                failure = mavlink.FAILURE_TYPE_OFF if present else mavlink.FAILURE_TYPE_OK
                failures.inject(mavlink.FAILURE_UNIT_SYSTEM_MOTOR, failure, 1.0, now_s)
            case "mode_rejected":
                failures.modes_refused = present
            case _:
                failures.rotor_shares = INTACT if amount is None else RotorSpeeds(*(amount,) * 4)

    def _change_parameters(self, kind: FaultKind, amount: float | None) -> None:
        for name, factor in self._parameters[kind].items():
            self._before.setdefault(name, self._vehicle.autopilot.parameters[name])
            value = self._before[name] if amount is None else amount * factor
            message = self._mavlink.param_set_encode(
                self._system_id,
                mavlink.MAV_COMP_ID_AUTOPILOT1,
                name.encode(),
                value,
                mavlink.MAV_PARAM_TYPE_REAL32,
            )
            self._vehicle.receive(message.pack(self._mavlink), self._link)
