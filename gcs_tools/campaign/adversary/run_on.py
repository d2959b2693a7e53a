"""The run after the setpoint stream ends, integrated from the model that a contract names.

It shares nothing with `onboard.contract.run_on` but the contract: there the run is enclosed in a
hull, here it is flown.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from onboard.contract.agility import GRAVITY_MPS2
from onboard.files.contract_file import FrozenSetpoint, VehicleTerms
from onboard.geometry.frames import FloatArray

_STEP_S: Final = 0.005
_STEPS_KEPT: Final = 10
# By then either model has come to rest.
_LONGEST_S: Final = 8.0


def runs_m(vehicle: VehicleTerms, states: FloatArray) -> FloatArray:
    """Return where the vehicle runs to when the stream ends with a setpoint.

    Args:
        vehicle: says what the autopilot does then.
        states: (n, 3, 2), position, velocity and acceleration of n setpoints, horizontal.

    Returns:
        (n, k, 2), positions at successive instants.
    """
    if isinstance(vehicle.setpoint_loss, FrozenSetpoint):
        return _frozen_m(vehicle.setpoint_loss, vehicle.attitude_lag_s, states)
    return _coasting_m(vehicle, states)


def _frozen_m(loss: FrozenSetpoint, lag_s: float, states: FloatArray) -> FloatArray:
    """Return the run of ``lag x'' = Kp (p - x) + v + a / Kv - x'``, from x = p and x' = v."""
    gains = np.array(_gains(loss.gain_per_s, loss.velocity_gain_per_s, lag_s))
    runs: FloatArray = states[:, None, 0] + np.einsum("kg,ngd->nkd", gains, states[:, 1:])
    return runs


def _gains(
    gain_per_s: float, velocity_gain_per_s: float, lag_s: float
) -> list[tuple[float, float]]:
    """Return how far the run is along v and a, at each kept instant: the loop is linear."""
    kept = []
    along_v = along_a = 0.0
    speed_v, speed_a = 1.0, 0.0
    for number in range(round(_LONGEST_S / _STEP_S)):
        if number % _STEPS_KEPT == 0:
            kept.append((along_v, along_a))
        pull_v = (1.0 - gain_per_s * along_v - speed_v) / lag_s
        pull_a = (1.0 / velocity_gain_per_s - gain_per_s * along_a - speed_a) / lag_s
        speed_v, speed_a = speed_v + _STEP_S * pull_v, speed_a + _STEP_S * pull_a
        along_v, along_a = along_v + _STEP_S * speed_v, along_a + _STEP_S * speed_a
    return kept


def _coasting_m(vehicle: VehicleTerms, states: FloatArray) -> FloatArray:
    """Return the run of an autopilot that integrates the setpoint, then brakes after its lag."""
    timeout_s, lag_s = vehicle.setpoint_loss_timeout_s, vehicle.attitude_lag_s
    tilt_rad = math.radians(min(vehicle.roll_max_deg, vehicle.pitch_max_deg))
    brake_mps2 = GRAVITY_MPS2 * math.tan(tilt_rad)
    p, v, a = (states[:, None, k] for k in range(3))
    times_s = np.linspace(0.0, timeout_s, 6)[:, None]
    coast = p + v * times_s + a * times_s**2 / 2.0
    fastest = v + a * timeout_s
    stopping_s = lag_s + np.linalg.norm(fastest, axis=-1, keepdims=True) / (2.0 * brake_mps2)
    shares = np.linspace(0.0, 1.0, 12)[:, None]
    runs: FloatArray = np.concatenate((coast, coast[:, -1:] + shares * fastest * stopping_s), 1)
    return runs
