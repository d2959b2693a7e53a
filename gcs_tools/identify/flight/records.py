"""What an identification flight writes into its log: the daemon's own records."""

from __future__ import annotations

import math

from gcs_tools.identify.flight.pilot import IN_PROGRAMME, IdentificationPilot, Notice, Stage
from gcs_tools.identify.stopping import IDENTIFYING
from onboard.events import EventName
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.recording.messages import EventRecord, StateRecord


def state_record(
    pilot: IdentificationPilot, link: MavlinkEndpoint, now_s: float, epoch_unix_s: float
) -> StateRecord:
    """Return the state of a tick.

    Args:
        pilot: after the tick.
        link: what the autopilot reports.
        now_s: of the tick.
        epoch_unix_s: Unix time at zero.
    """
    pose, status, setpoint = link.pose, link.status, pilot.setpoint(now_s)
    off_m = off_z_m = None
    if pose is not None and setpoint is not None:
        off_m = math.dist(pose.position_ned_m[:2], setpoint.position_ned_m[:2])
        off_z_m = abs(pose.position_ned_m[2] - setpoint.position_ned_m[2])
    return StateRecord(
        time_s=epoch_unix_s + now_s,
        phase=_phase(pilot.stage),
        state=pilot.stage.value,
        mode=status.mode,
        armed=status.armed,
        airborne=status.airborne,
        position_ned_m=None if pose is None else pose.position_ned_m,
        velocity_ned_mps=None if pose is None else pose.velocity_ned_mps,
        roll_rad=None if pose is None else pose.roll_rad,
        pitch_rad=None if pose is None else pose.pitch_rad,
        yaw_rad=None if pose is None else pose.yaw_rad,
        reference_position_ned_m=None if setpoint is None else setpoint.position_ned_m,
        reference_velocity_ned_mps=None if setpoint is None else setpoint.velocity_ned_mps,
        reference_acceleration_ned_mps2=None
        if setpoint is None
        else setpoint.acceleration_ned_mps2,
        tracking_error_m=off_m,
        tracking_error_z_m=off_z_m,
        leg_heading_rad=None if setpoint is None else setpoint.yaw_ned_rad,
        telemetry_age_s=None if pose is None else now_s - pose.time_s,
    )


def event_record(notice: Notice, epoch_unix_s: float) -> EventRecord:
    """Return a notice as an event of the log."""
    return EventRecord(
        time_s=epoch_unix_s + notice.time_s,
        name=EventName.PHASE,
        severity=notice.severity.name.lower(),
        text=notice.text,
    )


def _phase(stage: Stage) -> str:
    if stage in IN_PROGRAMME:
        return IDENTIFYING
    return (Phase.HOLD if stage in (Stage.BRAKING, Stage.HOLDING) else Phase.STANDBY).value
