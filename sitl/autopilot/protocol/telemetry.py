"""Telemetry: which function builds which message from a snapshot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.standard_modes import AVAILABLE_MODES_MONITOR_ID, CURRENT_MODE_ID
from sitl.autopilot.protocol import estimator_messages as estimator
from sitl.autopilot.protocol import position_messages as position
from sitl.autopilot.protocol import status_messages as status
from sitl.autopilot.protocol.snapshot import Snapshot

# A builder returns None while its message has nothing to report.
BUILDERS: Final[dict[int, Callable[[Snapshot], Any]]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: status.heartbeat,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: position.attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: position.attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: position.local_position_ned,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position.position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: position.global_position_int,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: position.gps_raw_int,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: position.vfr_hud,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: position.altitude,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: status.sys_status,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: status.battery_status,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: status.extended_sys_state,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: position.home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: position.gps_global_origin,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: status.system_time,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: position.odometry,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: status.autopilot_version,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: status.mission_current,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: estimator.ekf_status_report,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator.estimator_status,
    CURRENT_MODE_ID: status.current_mode,
    AVAILABLE_MODES_MONITOR_ID: status.available_modes_monitor,
}
