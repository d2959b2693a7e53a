"""Fly an autopilot that Clearway does not know: describe it in a profile and register that.

A profile is data: modes, estimator, take-off, take-over, rules on parameters.  This one describes
an imaginary autopilot, shows what changes once it is registered, and starts the daemon with it::

    python examples/own_autopilot_profile.py                              # only shows
    python examples/own_autopilot_profile.py --config config/onboard.yaml # the daemon

`dataclasses.replace` makes a profile from a known one, such as a PX4 with modes of its own.
"""

from __future__ import annotations

import sys
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.__main__ import main as run_daemon
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.profiles.parameter_rules import (
    SETPOINT_LOSS,
    WITHIN_FENCE,
    ContractDemands,
    MissionDemands,
    ParameterRule,
    ReportedParameters,
    at_least,
    at_most,
)
from onboard.mavlink.profiles.profile import (
    CONSTANT_POSITION,
    ESTIMATOR_STATUS,
    AutopilotProfile,
    EstimatorFacts,
    Mode,
    Modes,
    ParameterFacts,
    TakeOff,
    TakeOver,
)
from onboard.mavlink.profiles.registry import profile_of, register

# HEARTBEAT.custom_mode of this autopilot.
MODES = {1: "MANUAL", 2: "HOVER", 3: "FOLLOW"}


def rules(demands: ContractDemands, _: ReportedParameters) -> list[ParameterRule]:
    """Return what a contract demands of the parameters; the pre-flight check evaluates it."""
    return [
        ParameterRule(demands.tilt_reason, (at_least("TILT_MAX", demands.tilt_deg, "deg"),)),
        ParameterRule(SETPOINT_LOSS, (at_most("FOLLOW_TIMEOUT", demands.setpoint_timeout_s, "s"),)),
    ]


def fence_rules(demands: MissionDemands, _: ReportedParameters) -> list[ParameterRule]:
    """Return what a mission demands of the geofence."""
    return [ParameterRule(WITHIN_FENCE, (at_least("FENCE_RADIUS", demands.radius_m, "m"),))]


PROFILE = AutopilotProfile(
    autopilot=mavlink.MAV_AUTOPILOT_SLUGS,  # the value that its heartbeat states
    key="example",
    name="Example autopilot",
    modes=Modes(
        lambda custom_mode: MODES.get(custom_mode, f"MODE {custom_mode}"),
        external_control=Mode("FOLLOW", 3),
        hold=Mode("HOVER", 2),
    ),
    estimator=EstimatorFacts(
        message=ESTIMATOR_STATUS,
        made_up_flags=CONSTANT_POSITION,
        doubt_flags=MappingProxyType({mavlink.ESTIMATOR_GPS_GLITCH: "GPS glitch"}),
        ratio_max=1.0,
        position_health=mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
        texts=("position lost",),  # STATUSTEXT in lower case
    ),
    take_off=TakeOff(height_parameter="TAKEOFF_HEIGHT"),
    take_over=TakeOver("its mode switch (MANUAL)", "take over from the ground station with HOVER"),
    target_gain_max_per_s=0.0,  # it reports our setpoints as they are
    parameters=ParameterFacts(
        setpoint_timeout="FOLLOW_TIMEOUT",
        no_radio=("RADIO", 0.0),
        fence_prefixes=("FENCE_",),
        rules=rules,
        fence_rules=fence_rules,
    ),
)


def heartbeat(custom_mode: int) -> bytes:
    """Return a heartbeat of the autopilot, armed, in one of its modes."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
    message = sender.heartbeat_encode(
        mavlink.MAV_TYPE_QUADROTOR,
        PROFILE.autopilot,
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        custom_mode,
        mavlink.MAV_STATE_ACTIVE,
    )
    return bytes(message.pack(sender))


def show() -> None:
    """Print what the service makes of the autopilot's modes."""
    endpoint = MavlinkEndpoint(system_id=1)
    for custom_mode in MODES:
        endpoint.receive(heartbeat(custom_mode), now_s=0.0)
        status = endpoint.status
        obeys = "may fly it" if status.external_control else "does not fly it"
        print(f"{endpoint.profile.name}: {status.mode}, the service {obeys}")


def main() -> int:
    """Show the effect of registering; with arguments, run the daemon with the profile."""
    if len(sys.argv) == 1:
        print(f"without it: {profile_of(PROFILE.autopilot).name}")
    register(PROFILE)
    if len(sys.argv) > 1:
        return run_daemon(sys.argv[1:])
    show()
    return 0


if __name__ == "__main__":
    sys.exit(main())
