"""Runs of the two kinds of autopilot, by the formulas of the theory and without a contract."""

from __future__ import annotations

from onboard.contract.run_on import RunOn


def frozen_run_on(kappa_s: float, *, gain_per_s: float, velocity_gain_per_s: float) -> RunOn:
    """Return the run of an autopilot that keeps flying to the last setpoint (PX4).

    The commanded velocity is ``v + Kp (p_setpoint - p)``, so it stops at ``p + v / Kp``, and the
    acceleration acts as a bias of ``a / Kv``: the run stays in the triangle of p, p + kappa v and
    p + kappa v + a / (Kp Kv).

    Args:
        kappa_s: overshoot over Kp, or what a measured run gives if that is longer.
        gain_per_s: Kp, of the position controller.
        velocity_gain_per_s: Kv, of the velocity controller.
    """
    return RunOn(((kappa_s, 0.0), (kappa_s, 1.0 / (gain_per_s * velocity_gain_per_s))))


def coasting_run_on(
    timeout_s: float,
    *,
    lag_s: float,
    brake_mps2: float,
    speed_max_mps: float,
    acceleration_max_mps2: float,
) -> RunOn:
    """Return the run of an autopilot that integrates the setpoint, then brakes (ArduPilot).

    The coast ``p + v t + a t²/2`` is a quadratic Bézier curve in the hull of p, p + v t_l and
    p + v t_l + a t_l²/2; the braking way is part of the segment from there to p + kappa v + c a
    (correction of C3).

    Args:
        timeout_s: t_l, until the autopilot stops by itself.
        lag_s: from a command until the acceleration acts.
        brake_mps2: with which it stops.
        speed_max_mps: greatest Euclidean speed of a setpoint.
        acceleration_max_mps2: greatest Euclidean acceleration of a setpoint.
    """
    fastest_mps = speed_max_mps + acceleration_max_mps2 * timeout_s
    stopping_s = lag_s + fastest_mps / (2.0 * brake_mps2)
    last = timeout_s + stopping_s, timeout_s**2 / 2.0 + timeout_s * stopping_s
    return RunOn(((timeout_s, 0.0), (timeout_s, timeout_s**2 / 2.0), last))
