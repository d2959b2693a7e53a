"""Builds the record of a tick from the service: the only reader of its internals for the log."""

from __future__ import annotations

import math
from typing import Any

from onboard.autonomy import Autonomy
from onboard.monitoring.energy import SILENCE_S
from onboard.recording.messages import DropCounters, SensorRecord, StateRecord
from onboard.vehicle_state import Pose, Setpoint


def state_of(autonomy: Autonomy, now_s: float) -> StateRecord:
    """Return the state of the service in the tick at ``now_s``."""
    pose, status, supervisor = autonomy.link.pose, autonomy.link.status, autonomy.supervisor
    navigator, tracking = autonomy.navigator, supervisor.response.tracking_monitor
    setpoint, doubt = navigator.setpoint(now_s), supervisor.position_sign
    return StateRecord(
        time_s=unix_time_s(autonomy, now_s),
        phase=navigator.phase.value,
        state=navigator.state.value,
        mode=status.mode,
        armed=status.armed,
        airborne=status.airborne,
        position_ned_m=None if pose is None else pose.position_ned_m,
        velocity_ned_mps=None if pose is None else pose.velocity_ned_mps,
        **_attitude(pose),
        **_reference(setpoint),
        tracking_error_m=tracking.position_error_m,
        tracking_error_z_m=tracking.vertical_error_m,
        velocity_error_mps=tracking.velocity_error_mps,
        cruising=navigator.cruising_freely,
        leg_heading_rad=navigator.leg.heading_rad,
        detection_age_s=finite(supervisor.detections.monitor.age_s(now_s)),
        telemetry_age_s=None if pose is None else now_s - pose.time_s,
        sensors=_sensors(autonomy, now_s),
        position_doubt=None if doubt is None else doubt.sentence,
        link_doubt=autonomy.link.security.doubt(now_s),
        mission="" if autonomy.vehicle_mission is None else autonomy.vehicle_mission.summary,
        mission_doubt=navigator.situation.mission_doubt,
        resumable=autonomy.progress.resumable,
        progress=autonomy.assessment.contract.requirements.progress,
        cleared=autonomy.flight_authorization.refusal(autonomy.epoch_unix_s + now_s) is None,
        log_ended=autonomy.log_ended,
        virtual_obstacles=autonomy.virtual_obstacles,
        obstacles_known=len(navigator.obstacles),
        free_cells=supervisor.seen.size,
        rest_certified=None if navigator.shield is None else navigator.shield.rest_certified,
        rest_margin_m=None if navigator.shield is None else navigator.shield.rest_margin_m,
        pauses=0 if navigator.thread is None else navigator.thread.pauses,
        goal_ned_m=navigator.situation.route.mission.legs[-1].end_ned_m,
        battery_charge=autonomy.link.battery.charge(now_s, SILENCE_S),
        dropped=_dropped(autonomy),
    )


def _attitude(pose: Pose | None) -> dict[str, Any]:
    names = ("roll_rad", "pitch_rad", "yaw_rad")
    return {name: None if pose is None else getattr(pose, name) for name in names}


def _reference(setpoint: Setpoint | None) -> dict[str, Any]:
    names = ("position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2")
    return {
        f"reference_{name}": None if setpoint is None else getattr(setpoint, name) for name in names
    }


def unix_time_s(autonomy: Autonomy, now_s: float) -> float:
    """Return the Unix time of a record, to the microsecond."""
    return round(autonomy.epoch_unix_s + now_s, 6)


def _sensors(autonomy: Autonomy, now_s: float) -> dict[str, SensorRecord]:
    """Return every sensor that was heard, and those of the daemon's file that were not."""
    declared = autonomy.sensors.sensors
    records = {
        name: SensorRecord(refused=dict(each.input.refused)) for name, each in declared.items()
    }
    for source, sensor in autonomy.supervisor.detections.monitor.sensors.items():
        records[source] = SensorRecord(
            age_s=finite(now_s - sensor.newest_stamp_s),
            heard_age_s=now_s - sensor.heard_s,
            stamp_ahead_s=sensor.ahead_s,
            refused=records[source].refused if source in records else {},
        )
    return records


def _dropped(autonomy: Autonomy) -> DropCounters:
    link, detections = autonomy.link.counters, autonomy.detections
    return DropCounters(
        mavlink_garbage_bytes=link.garbage_bytes,
        mavlink_malformed=link.malformed_messages,
        mavlink_foreign=link.foreign_messages,
        mavlink_refused=autonomy.link.security.refused.total(),
        frames_malformed=detections.malformed_frames,
        frames_unplaced=detections.unplaced_frames,
        frames_dropped=detections.dropped_frames,
        clearances_malformed=autonomy.flight_authorization.malformed,
        missions_malformed=autonomy.malformed_missions,
        commands_refused=autonomy.refused_commands,
    )


def finite(value: float) -> float | None:
    """Return a number that JSON can express, or None: the age of what was never heard."""
    return value if math.isfinite(value) else None
