"""How an autopilot differs from an ideal one: ``realism: field`` as measured, or ``ideal``.

`docs/realism.md` says where each value was measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.plant.controller import ControllerGains
from sitl.plant.estimator import IDEAL as EXACT
from sitl.plant.estimator import EstimatorProfile

_IDEAL_GAINS = ControllerGains()


@dataclass(frozen=True)
class Realism:
    """Differences from an ideal autopilot; the defaults are the ideal.

    Attributes:
        estimator: errors of its estimate.
        jerk_share: share of the wanted jerk that becomes body rates; the rest is attitude lag.
        drag_share: share of the drag that the controller compensates.
        trim_time_s: how long it takes to trim a disturbance out.
        rate_per_s: feedback of the body rates.
        parameters: defaults in place of the autopilot's own.
        rates_hz: streams in place of the flavour's.
        echoes_controller: POSITION_TARGET_LOCAL_NED is the position controller's output.
        rest_is_constant_position: ESTIMATOR_CONST_POS_MODE is set while the vehicle rests.
        timesync_misaddressed: answers to TIMESYNC go to a system that did not ask.
        legacy_requests: MAV_CMD_GET_HOME_POSITION and MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES are
            accepted; PX4 1.18 no longer supports them.
        reports_lost_position_s: how long LOCAL_POSITION_NED goes on without GPS, valid or not.
        levels_when_lost: without a position, the controller keeps the thrust axis upright and does
            not brake.
        fix_when_lost: GPS_RAW_INT.fix_type without GPS.
        drops_gps_after_s: without GPS it vanishes from SYS_STATUS after this, not at once.
    """

    estimator: EstimatorProfile = EXACT
    jerk_share: float = _IDEAL_GAINS.jerk_share
    drag_share: float = _IDEAL_GAINS.drag_share
    trim_time_s: float = _IDEAL_GAINS.trim_time_s
    rate_per_s: float = _IDEAL_GAINS.rate_per_s
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    rates_hz: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    echoes_controller: bool = False
    rest_is_constant_position: bool = False
    timesync_misaddressed: bool = False
    legacy_requests: bool = True
    reports_lost_position_s: float = 0.0
    levels_when_lost: bool = False
    fix_when_lost: int = mavlink.GPS_FIX_TYPE_NO_FIX
    drops_gps_after_s: float = 0.0
