"""Messages about modes, health, battery and mission, each built from a snapshot."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.flavours.standard_modes import AvailableModesMonitor, CurrentMode
from sitl.autopilot.modes import Mode
from sitl.autopilot.protocol.snapshot import Snapshot, int16

_ESTIMATOR_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
)


TEXT_LENGTH = 50


_POSITION_CONTROL = mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL


_OTHER_SENSORS = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY


def heartbeat(s: Snapshot) -> Any:
    """HEARTBEAT: type, mode, armed, system status."""
    commander = s.commander
    base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    base_mode |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    status = mavlink.MAV_STATE_STANDBY
    if commander.armed:
        base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = mavlink.MAV_STATE_CRITICAL if commander.failsafe else mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        s.flavour.autopilot,
        base_mode,
        s.flavour.custom_mode(commander.mode),
        status,
        3,
    )


def sys_status(s: Snapshot) -> Any:
    """SYS_STATUS: health, battery, and in the pre-arm bit whether arming would succeed."""
    present = _ESTIMATOR_SENSORS | _OTHER_SENSORS | _POSITION_CONTROL
    present |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
    health = _OTHER_SENSORS
    if not s.commander.fence.breached:  # MAVProxy announces a breach without this bit
        health |= mavlink.MAV_SYS_STATUS_GEOFENCE
    failed = s.commander.failures.failed_sensors
    if s.estimator.lost_for_s < s.realism.drops_gps_after_s:
        failed &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
    elif s.realism.drops_gps_after_s > 0.0:
        present &= ~(failed & mavlink.MAV_SYS_STATUS_SENSOR_GPS)
    if s.reports_position:
        health |= _ESTIMATOR_SENSORS & ~failed
    if s.commander.estimator_ready:
        health |= _POSITION_CONTROL
    if not s.commander.prearm_failures():
        health |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
    battery = s.battery
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        health,
        200,
        round(battery.voltage_v * 1e3),
        int16(battery.current_a * 100.0),
        round(battery.remaining * 100.0),
        *(0,) * 6,
    )


def battery_status(s: Snapshot) -> Any:
    """BATTERY_STATUS: one pack, its voltage reported as a whole."""
    battery = s.battery
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        2500,
        [round(battery.voltage_v * 1e3), *(0xFFFF,) * 9],
        int16(battery.current_a * 100.0),
        round(battery.consumed_ah * 1e3),
        -1,
        round(battery.remaining * 100.0),
    )


def extended_sys_state(s: Snapshot) -> Any:
    """EXTENDED_SYS_STATE: the landed state."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, s.commander.landed_state
    )


def system_time(s: Snapshot) -> Any:
    """SYSTEM_TIME."""
    return mavlink.MAVLink_system_time_message(s.unix_us, s.boot_ms)


def autopilot_version(s: Snapshot) -> Any:
    """AUTOPILOT_VERSION: what this autopilot can do."""
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        | s.flavour.capabilities
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )
    nothing = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, s.flavour.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
    )


def mission_current(s: Snapshot) -> Any:
    """MISSION_CURRENT: which item is flown, and how far the mission is."""
    mission = s.commander.mission
    if not mission.flyable:
        state = mavlink.MISSION_STATE_NO_MISSION
    elif mission.finished:
        state = mavlink.MISSION_STATE_COMPLETE
    elif s.commander.mode is Mode.MISSION:
        state = mavlink.MISSION_STATE_ACTIVE
    else:
        state = mavlink.MISSION_STATE_NOT_STARTED
    in_mission_mode = 1 if s.commander.mode is Mode.MISSION else 2
    return mavlink.MAVLink_mission_current_message(
        mission.current, len(mission.items), state, in_mission_mode
    )


def available_modes_monitor(_: Snapshot) -> Any:
    """AVAILABLE_MODES_MONITOR: the list of modes never changes."""
    return AvailableModesMonitor()


def current_mode(s: Snapshot) -> Any:
    """CURRENT_MODE: the mode flown, and the one wanted."""
    flavour, commander = s.flavour, s.commander
    mode, intended = commander.mode, commander.intention
    return CurrentMode(mode, flavour.custom_mode(mode), flavour.custom_mode(intended))


def status_texts(severity: int, text: str, number: int) -> list[Any]:
    """STATUSTEXT: one for a short text, else its chunks, which carry a common number.

    Args:
        severity: MAV_SEVERITY.
        text: any length.
        number: of a text with chunks; not 0.
    """
    data = text.encode()
    chunks = [data[at : at + TEXT_LENGTH] for at in range(0, len(data), TEXT_LENGTH)]
    if len(chunks) <= 1:
        return [mavlink.MAVLink_statustext_message(severity, data)]
    if len(chunks[-1]) == TEXT_LENGTH:
        chunks.append(b"")  # only a zero byte tells the receiver that the text ends here
    return [
        mavlink.MAVLink_statustext_message(severity, chunk, number, index)
        for index, chunk in enumerate(chunks)
    ]
