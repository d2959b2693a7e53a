"""Failures injected with MAV_CMD_INJECT_FAILURE: motors, GPS, sensors, battery, radio control.

Simulation shortcuts: a wrong GPS shifts the estimate at once, which counts as a reset of the
estimator (`sitl.plant.estimator` says what a lost one does).  Losing magnetometer or barometer
shows in SYS_STATUS and keeps the vehicle from arming; losing gyroscopes or accelerometers in flight
ends it.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.plant.multirotor import INTACT, RotorSpeeds

_OK, _OFF, _STUCK, _WRONG = (
    mavlink.FAILURE_TYPE_OK,
    mavlink.FAILURE_TYPE_OFF,
    mavlink.FAILURE_TYPE_STUCK,
    mavlink.FAILURE_TYPE_WRONG,
)
_GPS, _MOTOR = mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_UNIT_SYSTEM_MOTOR
_BATTERY = mavlink.FAILURE_UNIT_SYSTEM_BATTERY
_STICKS = mavlink.FAILURE_UNIT_SYSTEM_RC_SIGNAL
_INERTIAL = {
    mavlink.FAILURE_UNIT_SENSOR_GYRO: mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    mavlink.FAILURE_UNIT_SENSOR_ACCEL: mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
}
_SENSOR_BITS = {
    **_INERTIAL,
    mavlink.FAILURE_UNIT_SENSOR_MAG: mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
    mavlink.FAILURE_UNIT_SENSOR_BARO: mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    _GPS: mavlink.MAV_SYS_STATUS_SENSOR_GPS,
}
_TYPES = {
    **dict.fromkeys(_SENSOR_BITS, (_OK, _OFF, _STUCK)),
    _GPS: (_OK, _OFF, _STUCK, _WRONG),
    _MOTOR: (_OK, _OFF),
    _BATTERY: (_OK, _OFF),
    _STICKS: (_OK, _OFF),
}
_ROTORS = 4
_WRONG_BY_M = 5.0


class Failures:
    """Keep which failures are present, and state their effects.

    Attributes:
        rotor_shares: share of its commanded speed that each rotor reaches: 1 or 0.
        modes_refused: whether the autopilot refuses every requested change of mode.
    """

    def __init__(self) -> None:
        self.rotor_shares = INTACT
        self.modes_refused = False
        self._types: dict[int, int] = {}
        self._gps_lost_s = math.inf

    def inject(self, unit: float, kind: float, instance: float, now_s: float) -> bool:
        """Begin or end a failure; False if it is not simulated.

        Args:
            unit: FAILURE_UNIT.
            kind: FAILURE_TYPE.
            instance: number of the unit from 1 on; 0 for all.  Only motors have several.
            now_s: time.
        """
        if kind not in _TYPES.get(int(unit) if math.isfinite(unit) else -1, ()):
            return False
        if unit == _MOTOR:
            return self._stop_rotors(instance, off=kind == _OFF)
        if not 0.0 <= instance <= 1.0:
            return False
        if unit == _GPS:
            self._gps_lost_s = min(self._gps_lost_s, now_s) if kind in {_OFF, _STUCK} else math.inf
        self._types[int(unit)] = int(kind)
        return True

    def _stop_rotors(self, instance: float, *, off: bool) -> bool:
        if not (math.isfinite(instance) and instance.is_integer() and 0.0 <= instance <= _ROTORS):
            return False
        self.rotor_shares = RotorSpeeds(
            *(
                float(not off) if instance in {0.0, rotor} else share
                for rotor, share in enumerate(self.rotor_shares, 1)
            )
        )
        return True

    @property
    def failed_sensors(self) -> int:
        """MAV_SYS_STATUS_SENSOR bits of the sensors that have failed."""
        return sum(bit for unit, bit in _SENSOR_BITS.items() if self._failed(unit))

    @property
    def attitude_lost(self) -> bool:
        """Whether gyroscopes or accelerometers have failed."""
        return bool(self._types) and any(map(self._failed, _INERTIAL))

    @property
    def battery_failed(self) -> bool:
        """Whether the battery monitor reads an empty pack."""
        return self._failed(_BATTERY)

    @property
    def sticks_cut(self) -> bool:
        """Whether manual control is lost."""
        return self._failed(_STICKS)

    @property
    def gps_has_fix(self) -> bool:
        """Whether the receiver reports a fix."""
        return bool(self._types.get(_GPS, _OK) != _OFF)

    def gps_lost_for_s(self, now_s: float) -> float:
        """For how long GPS has been missing; 0 while it is present."""
        return max(now_s - self._gps_lost_s, 0.0)

    @property
    def gps_wrong_m(self) -> float:
        """By how much GPS places the vehicle too far north."""
        return _WRONG_BY_M if self._types.get(_GPS, _OK) == _WRONG else 0.0

    def _failed(self, unit: int) -> bool:
        return bool(self._types.get(unit, _OK) != _OK)
