"""Which assumption a fault breaks for certain, and within which time the service has to notice.

The bounds are made of what the contract states and of the rates at which the service hears; a fault
that breaks nothing for certain has none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from onboard.contract.assessment import TICK_S
from onboard.files.models import Contract
from onboard.guidance.authority import AUTOPILOT_SILENCE_S
from onboard.monitoring.loop_overrun import TICK_OVERRUN_S
from sitl.virtual.faults.schema import Fault

# Between two frames of any sensor in a campaign, latency included; and two ticks to act on it.
_FRAME_S: Final = 0.1
_TICKS_S: Final = 2.0 * TICK_S
_TELEMETRY_AGE_MAX_S: Final = 0.5  # the service's own
_HEARTBEAT_S: Final = 1.2  # modes are heard once a second
_OPERATOR_S: Final = 0.2  # the scripted operator acts ten times a second


class DetectionBound(NamedTuple):
    """How a broken assumption shows.

    Attributes:
        assumptions: one of which has to be reported, or the event of that name; with none, it shows
            as the end of control.
        within_s: of the fault's beginning.
    """

    assumptions: frozenset[str]
    within_s: float


class _Break(NamedTuple):
    """What a kind of fault breaks, how soon that shows, and for which amounts it does at all."""

    assumptions: tuple[str, ...]
    within_s: Callable[[Fault, Contract], float]
    certain: Callable[[Fault, Contract], bool] = lambda _, __: True


def detection_bound(fault: Fault, contract: Contract) -> DetectionBound | None:
    """Return how soon a fault has to be noticed; None where it breaks nothing for certain."""
    broken = _BREAKS.get(fault.kind)
    if broken is None or not broken.certain(fault, contract):
        return None
    return DetectionBound(frozenset(broken.assumptions), broken.within_s(fault, contract))


def _silence_s(_: Fault, contract: Contract) -> float:
    return contract.sensor.frame_age_max_s + _TICKS_S


def _look_s(_: Fault, __: Contract) -> float:
    return _FRAME_S + _TICKS_S


def _telemetry_s(_: Fault, __: Contract) -> float:
    return _TELEMETRY_AGE_MAX_S + _TICKS_S


def _lasting_s(fault: Fault) -> float:
    return math.inf if fault.duration_s is None else fault.duration_s


_BREAKS: Final[dict[str, _Break]] = {
    **dict.fromkeys(
        ("detections_off", "detections_stuck", "detections_garbage", "detections_nan"),
        _Break(("detection_age",), _silence_s),
    ),
    "detections_late": _Break(
        ("detection_age", "reaction_time"),
        lambda fault, contract: _silence_s(fault, contract) + fault.value,
        lambda fault, contract: fault.value > contract.vehicle.reaction_time_s + _FRAME_S,
    ),
    "detections_short_range": _Break(
        ("detection_range",),
        _look_s,
        lambda fault, contract: fault.value < contract.sensor.detection_range_m,
    ),
    "detections_wrong_units": _Break(("detection_range",), _look_s),
    "detections_narrow_view": _Break(
        ("field_of_view",),
        _look_s,
        lambda fault, contract: fault.value < contract.sensor.field_of_view_deg,
    ),
    "sensor_clock_ahead": _Break(("sensor_clock",), _look_s),
    "position_reset": _Break(("estimator_reset",), _look_s),
    "telemetry_lost": _Break(("telemetry_age",), _telemetry_s),
    "link_partitioned": _Break(("telemetry_age",), _telemetry_s),
    # A stalled service notices when it wakes.
    "tick_stall": _Break(
        ("tick_overrun",),
        lambda fault, _: _lasting_s(fault) + _TICKS_S,
        lambda fault, _: _lasting_s(fault) > TICK_OVERRUN_S + TICK_S,
    ),
    "disk_full": _Break(("log_ended",), lambda _, __: _TICKS_S),
    "mission_changed": _Break(("mission_changed",), lambda _, __: _TICKS_S),
    "setpoints_lost": _Break(
        (), lambda _, contract: contract.vehicle.setpoint_loss_timeout_s + _HEARTBEAT_S
    ),
    "heartbeats_lost": _Break((), lambda _, __: AUTOPILOT_SILENCE_S + _HEARTBEAT_S),
    "operator_takes_over": _Break((), lambda _, __: _OPERATOR_S + _HEARTBEAT_S),
}
