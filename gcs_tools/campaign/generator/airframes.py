"""Vehicles that campaigns fly: what each declares, and how the simulation flies it.

Most fly with the errors that were measured in the field (`docs/realism.md`), and their contracts
declare them as `config/px4_contract.yaml` and `config/ardupilot_contract.yaml` do.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from gcs_tools.campaign.generator.case import Extent
from gcs_tools.scenario import Plant
from onboard.files.contract_file import Contract

# Of the flights of an extent whose legs have room for the errors of the field.
_IDEAL_PERCENT: Final = 20
_PX4_PERCENT: Final = 40
# This share of ideal vehicles spends this share of its tracking error toward the nearest obstacle.
_PINNED_SHARE: Final = 0.2
_PINNED_ERROR_SHARE: Final = 0.8
# The service takes a pose for this much younger than it is (`sitl.virtual.simulation`): what it
# sees of a vehicle that is pinned behind its setpoint is as much of the way more, and that is a
# tracking error that the contract has to cover, too.
SEEN_LATE_S: Final = 0.01
# Contains the latency and confirmation time that the simulated sensor needs.
_REACTION_TIME_S: Final = (0.15, 0.25)


@dataclass(frozen=True)
class Airframe:
    """One kind of vehicle.

    Attributes:
        name: for messages.
        as_in_the_field: whether it has the errors that were measured in the field.  The daemon
            allows for an error of the heading in the body's frame only: its sensor reports there.
        speed_max_mps: fastest cruise at which its errors are known.
        wander_m: how far its estimate may be off on either axis.  Boxes are placed by the estimate,
            so that it is a part of the error of faces that the contract declares; the daemon counts
            that along both axes at once.
        position_error_m: least and largest error of its sensor besides.
        terms: draws its vehicle's terms, for a cruise speed.
        plant: draws how it is simulated, for its contract.
    """

    name: str
    as_in_the_field: bool
    speed_max_mps: float
    wander_m: float
    position_error_m: tuple[float, float]
    terms: Callable[[random.Random, float], dict[str, Any]]
    plant: Callable[[random.Random, Contract], dict[str, Any]]


def drawn_airframe(draw: random.Random, extent: Extent) -> Airframe:
    """Draw an airframe; an ideal one where the extent has no room for the errors of the field."""
    percent = draw.randrange(100)
    if extent.ideal or percent < _IDEAL_PERCENT:
        return IDEAL
    return PX4 if percent < _IDEAL_PERCENT + _PX4_PERCENT else ARDUPILOT


# ------------------------------------------------------------------ ideal


def _ideal_terms(draw: random.Random, _speed_mps: float) -> dict[str, Any]:
    return {
        "roll_max_deg": draw.uniform(8.0, 22.0),
        "pitch_max_deg": draw.uniform(8.0, 22.0),
        "tracking_error_m": draw.uniform(0.2, 0.35),
        "velocity_error_mps": [0.25, 0.15],
        "reaction_time_s": draw.uniform(*_REACTION_TIME_S),
        "attitude_lag_s": draw.uniform(0.15, 0.2),
        "setpoint_loss_timeout_s": 0.5,
        # `sitl.plant.controller.ControllerGains`
        "setpoint_loss": {"model": "frozen", "gain_per_s": 1.3, "velocity_gain_per_s": 4.5},
    }


def _ideal_plant(draw: random.Random, contract: Contract) -> dict[str, Any]:
    error_m = _PINNED_ERROR_SHARE * contract.vehicle.tracking_error_m
    pinned = draw.random() < _PINNED_SHARE
    tracking = {"toward_obstacle": pinned, "error_m": error_m, "seen_late_s": SEEN_LATE_S}
    return {"realism": "ideal", "tracking": tracking}


IDEAL: Final = Airframe("ideal", False, 99.0, 0.0, (0.02, 0.08), _ideal_terms, _ideal_plant)


# ------------------------------------------------------------------ PX4


# MPC_XY_P and MPC_XY_VEL_P_ACC of the tuned vehicle.
_PX4_TUNED: Final = {"MPC_XY_P": 1.5, "MPC_JERK_AUTO": 15.0, "MPC_ACC_HOR": 5.0}
_PX4_LOSS: Final = {"model": "frozen", "gain_per_s": 1.5, "velocity_gain_per_s": 1.8}
# Measured run after the stream ends, for each metre a second: 3.5 m at 2.8 m/s.
_PX4_RUN_ON_S: Final = 1.25


def _px4_terms(draw: random.Random, speed_mps: float) -> dict[str, Any]:
    return {
        "roll_max_deg": draw.uniform(10.0, 15.0),
        "pitch_max_deg": draw.uniform(10.0, 15.0),
        "tracking_error_m": draw.uniform(1.0, 1.1),
        "tracking_error_z_m": 1.5,
        "heading_error_deg": 4.0,
        "velocity_error_mps": [0.75, 1.0],
        "reaction_time_s": draw.uniform(0.35, 0.4),
        "attitude_lag_s": draw.uniform(0.27, 0.3),
        "drag_per_s": 0.25,
        "setpoint_loss_timeout_s": 0.3,
        "setpoint_loss": _PX4_LOSS,
        "setpoint_loss_run_on_m": _PX4_RUN_ON_S * speed_mps,
        "setpoint_loss_run_on_speed_mps": speed_mps,
    }


def _px4_plant(_draw: random.Random, _contract: Contract) -> dict[str, Any]:
    return {"realism": "field", "flavour": "px4", "parameters": _PX4_TUNED}


PX4: Final = Airframe("px4", True, 2.8, 0.45, (0.08, 0.12), _px4_terms, _px4_plant)


# ------------------------------------------------------------------ ArduPilot


_ARDUPILOT_TUNED: Final = {"PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0}
_ARDUPILOT_RUN_ON_S: Final = 1.215  # 3.4 m at 2.8 m/s


def _ardupilot_terms(draw: random.Random, speed_mps: float) -> dict[str, Any]:
    return {
        "roll_max_deg": draw.uniform(8.0, 15.0),
        "pitch_max_deg": draw.uniform(8.0, 15.0),
        "tracking_error_m": draw.uniform(0.35, 0.5),
        "tracking_error_z_m": 0.5,
        "heading_error_deg": 2.0,
        "velocity_error_mps": [0.55, 0.6],
        "reaction_time_s": draw.uniform(*_REACTION_TIME_S),
        "attitude_lag_s": draw.uniform(0.25, 0.3),
        "setpoint_loss_timeout_s": 0.5,
        "setpoint_loss_run_on_m": _ARDUPILOT_RUN_ON_S * speed_mps,
        "setpoint_loss_run_on_speed_mps": speed_mps,
    }


def _ardupilot_plant(_draw: random.Random, _contract: Contract) -> dict[str, Any]:
    return {"realism": "field", "flavour": "ardupilot", "parameters": _ARDUPILOT_TUNED}


ARDUPILOT: Final = Airframe(
    "ardupilot", True, 3.5, 0.06, (0.08, 0.12), _ardupilot_terms, _ardupilot_plant
)


def airframe_of(plant: Plant) -> Airframe:
    """Return the airframe that a plant was drawn for."""
    if plant.realism == "ideal":
        return IDEAL
    return {each.name: each for each in (PX4, ARDUPILOT)}[plant.flavour]
