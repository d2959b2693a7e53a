"""Which assumption a fault breaks for certain, and within what time the service must notice.

The bounds follow from the contract and from the rates of frames and telemetry; faults that do not
break an assumption for certain have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract
from onboard.monitoring.loop_overrun import TICK_OVERRUN_S
from onboard.vehicle_state import AUTOPILOT_SILENCE_S
from sitl.virtual.faults.schema import Fault

# Longest time between two frames of a campaign's sensor, latency included; two ticks to act on it.
_FRAME_S: Final = 0.1
_TICKS_S: Final = 2.0 * TICK_S
_TELEMETRY_AGE_MAX_S: Final = 0.5  # the service's own
_HEARTBEAT_S: Final = 1.2  # modes arrive once a second
_ASTRAY_S: Final = 5.0  # a vehicle that follows other setpoints is told from its target by then
_OPERATOR_S: Final = 0.2  # the scripted operator acts ten times a second


class DetectionBound(NamedTuple):
    """How the service reports a broken assumption.

    Attributes:
        assumptions: one must be reported, or be the name of an event; if there is none, the service
            must stop controlling the vehicle.
        within_s: after the fault begins.
    """

    assumptions: frozenset[str]
    within_s: float


class _BrokenAssumption(NamedTuple):
    """The assumptions that a kind of fault breaks, how soon, and for which amounts for certain."""

    assumptions: tuple[str, ...]
    within_s: Callable[[Fault, Contract], float]
    certain: Callable[[Fault, Contract], bool] = lambda _, __: True


def detection_bound(fault: Fault, contract: Contract) -> DetectionBound | None:
    """Return how soon the service must notice a fault; None if it breaks nothing for certain."""
    broken = _BROKEN_BY.get(fault.kind)
    if broken is None or not broken.certain(fault, contract):
        return None
    return DetectionBound(frozenset(broken.assumptions), broken.within_s(fault, contract))


def _silence_s(_: Fault, contract: Contract) -> float:
    return contract.sensor.frame_age_max_s + _TICKS_S


def _frame_s(_: Fault, __: Contract) -> float:
    return _FRAME_S + _TICKS_S


def _telemetry_s(_: Fault, __: Contract) -> float:
    return _TELEMETRY_AGE_MAX_S + _TICKS_S


def _setpoints_s(_: Fault, contract: Contract) -> float:
    """PX4 leaves its mode, as its next heartbeat tells; ArduPilot stays in it, and brakes."""
    loss = contract.vehicle.setpoint_loss
    leaves = loss is not None and loss.model == "frozen"
    return contract.vehicle.setpoint_loss_timeout_s + (_HEARTBEAT_S if leaves else _ASTRAY_S)


def _lasting_s(fault: Fault) -> float:
    return math.inf if fault.duration_s is None else fault.duration_s


_BROKEN_BY: Final[dict[str, _BrokenAssumption]] = {
    **dict.fromkeys(
        ("detections_off", "detections_stuck", "detections_garbage", "detections_nan"),
        _BrokenAssumption(("detection_age",), _silence_s),
    ),
    "detections_late": _BrokenAssumption(
        ("detection_age", "reaction_time"),
        lambda fault, contract: _silence_s(fault, contract) + fault.value,
        lambda fault, contract: fault.value > contract.vehicle.reaction_time_s + _FRAME_S,
    ),
    "detections_short_range": _BrokenAssumption(
        ("detection_range",),
        _frame_s,
        lambda fault, contract: fault.value < contract.sensor.detection_range_m,
    ),
    "detections_wrong_units": _BrokenAssumption(("detection_range",), _frame_s),
    "detections_narrow_view": _BrokenAssumption(
        ("field_of_view",),
        _frame_s,
        lambda fault, contract: fault.value < contract.sensor.field_of_view_deg,
    ),
    "sensor_clock_ahead": _BrokenAssumption(("sensor_clock",), _frame_s),
    "position_reset": _BrokenAssumption(("estimator_reset",), _frame_s),
    "telemetry_lost": _BrokenAssumption(("telemetry_age",), _telemetry_s),
    "link_partitioned": _BrokenAssumption(("telemetry_age",), _telemetry_s),
    # A stalled service notices only when it runs again.
    "tick_stall": _BrokenAssumption(
        ("tick_overrun",),
        lambda fault, _: _lasting_s(fault) + _TICKS_S,
        lambda fault, _: _lasting_s(fault) > TICK_OVERRUN_S + TICK_S,
    ),
    "disk_full": _BrokenAssumption(("log_ended",), lambda _, __: _TICKS_S),
    "mission_changed": _BrokenAssumption(("mission_changed",), lambda _, __: _TICKS_S),
    "setpoints_lost": _BrokenAssumption(("second_commander", "tracking_error"), _setpoints_s),
    "heartbeats_lost": _BrokenAssumption(
        ("telemetry_age",), lambda _, __: AUTOPILOT_SILENCE_S + _HEARTBEAT_S
    ),
    "operator_takes_over": _BrokenAssumption((), lambda _, __: _OPERATOR_S + _HEARTBEAT_S),
}
