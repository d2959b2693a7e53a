"""What the parameters of PX4 and ArduPilot mean for a flight."""

import math
from typing import Any

import pytest

from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import ParameterStore
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.modes import Mode
from sitl.autopilot.settings import FlightSettings, Reaction


def px4(**parameters: float) -> FlightSettings:
    flavour = Px4()
    return flavour.settings(ParameterStore(flavour.parameter_specs(1), parameters))


def copter(**parameters: float) -> FlightSettings:
    flavour = Copter()
    return flavour.settings(ParameterStore(flavour.parameter_specs(1), parameters))


@pytest.mark.parametrize(
    ("parameters", "name", "value"),
    [
        ({"MPC_TILTMAX_AIR": 30.0}, "tilt_max_rad", math.radians(30.0)),
        ({"MC_ROLLRATE_MAX": 200.0}, "body_rate_max_radps", math.radians(200.0)),
        ({"MC_PITCHRATE_MAX": 100.0}, "body_rate_max_radps", math.radians(100.0)),
        ({"MC_ROLL_P": 5.0}, "roll_gain_per_s", 5.0),
        ({"MC_PITCH_P": 4.0}, "pitch_gain_per_s", 4.0),
        ({"MPC_XY_P": 1.5}, "position_gain_per_s", 1.5),
        ({"MPC_XY_VEL_P_ACC": 2.5}, "velocity_gain_per_s", 2.5),
        ({"MPC_XY_VEL_MAX": 7.0}, "speed_max_mps", 7.0),
        ({"MPC_Z_V_AUTO_UP": 8.0, "MPC_Z_VEL_MAX_UP": 2.0}, "climb_speed_mps", 2.0),
        ({"MPC_Z_V_AUTO_DN": 0.8}, "sink_speed_mps", 0.8),
        ({"MPC_VEL_MANUAL": 15.0, "MPC_XY_VEL_MAX": 9.0}, "stick_speed_mps", 9.0),
        ({"MPC_ACC_UP_MAX": 10.0, "MPC_ACC_DOWN_MAX": 4.0}, "acceleration_vertical_mps2", 4.0),
        ({"COM_OF_LOSS_T": 2.0}, "setpoint_timeout_s", 2.0),
        ({"COM_RC_IN_MODE": 4.0}, "manual_allowed", False),
        ({"COM_RC_IN_MODE": 0.0}, "manual_allowed", False),
        ({"COM_RC_IN_MODE": 1.0}, "manual_allowed", True),
        ({"SYS_FAILURE_EN": 1.0}, "failure_injection", True),
        ({"COM_ARM_AUTH_REQ": 0.0}, "arm_authorizer", None),
        ({"COM_ARM_AUTH_REQ": 1.0, "COM_ARM_AUTH_ID": 77.0}, "arm_authorizer", 77),
        ({"COM_DISARM_LAND": -1.0}, "disarm_landed_s", -1.0),
    ],
)
def test_px4s_parameters_mean(parameters: dict[str, float], name: str, value: Any) -> None:
    found = getattr(px4(**parameters), name)
    assert found == (pytest.approx(value) if isinstance(value, float) else value)


@pytest.mark.parametrize(
    ("action", "critical", "emergency"),
    [
        (0, Reaction.NONE, Reaction.NONE),
        (1, Reaction.NONE, Reaction.NONE),
        (2, Reaction.LAND, Reaction.LAND),
        (3, Reaction.RETURN, Reaction.LAND),
    ],
)
def test_px4s_low_battery_action(action: int, critical: Reaction, emergency: Reaction) -> None:
    settings = px4(COM_LOW_BAT_ACT=action)
    assert settings.low_reaction is Reaction.NONE
    assert settings.critical_reaction is critical
    assert settings.emergency_reaction is emergency


@pytest.mark.parametrize(
    ("action", "reaction"),
    [(0, Reaction.MANUAL), (3, Reaction.RETURN), (4, Reaction.LAND), (5, Reaction.HOLD)],
)
def test_px4s_reaction_to_the_end_of_offboard(action: int, reaction: Reaction) -> None:
    assert px4(COM_OBL_RC_ACT=action).setpoint_loss is reaction


@pytest.mark.parametrize(
    ("action", "reaction"),
    [(1, Reaction.HOLD), (2, Reaction.RETURN), (3, Reaction.LAND), (6, Reaction.DISARM)],
)
def test_px4s_reactions_to_lost_links(action: int, reaction: Reaction) -> None:
    settings = px4(NAV_DLL_ACT=action, NAV_RCL_ACT=action)
    assert settings.ground_loss is reaction
    assert settings.manual_loss is reaction


@pytest.mark.parametrize(
    ("parameters", "name", "value"),
    [
        ({"ANGLE_MAX": 2000.0}, "tilt_max_rad", math.radians(20.0)),
        ({"PSC_ANGLE_MAX": 15.0}, "tilt_max_rad", math.radians(15.0)),
        ({"PSC_ANGLE_MAX": 45.0, "ANGLE_MAX": 3000.0}, "tilt_max_rad", math.radians(30.0)),
        ({}, "body_rate_max_radps", math.radians(400.0)),
        ({"ATC_RATE_R_MAX": 90.0}, "body_rate_max_radps", math.radians(90.0)),
        ({"ATC_RATE_P_MAX": 60.0}, "body_rate_max_radps", math.radians(60.0)),
        ({"ATC_RATE_P_MAX": 720.0}, "body_rate_max_radps", math.radians(400.0)),
        ({"ATC_ANG_RLL_P": 6.0}, "roll_gain_per_s", 6.0),
        ({"ATC_ANG_PIT_P": 7.0}, "pitch_gain_per_s", 7.0),
        ({"WPNAV_SPEED": 500.0}, "cruise_speed_mps", 5.0),
        ({"WPNAV_SPEED_UP": 300.0}, "climb_speed_mps", 3.0),
        ({"WPNAV_SPEED_DN": 100.0}, "sink_speed_mps", 1.0),
        ({"WPNAV_ACCEL": 400.0}, "acceleration_mps2", 4.0),
        ({"WPNAV_RADIUS": 300.0}, "acceptance_radius_m", 3.0),
        ({"LAND_SPEED": 70.0}, "landing_speed_mps", 0.7),
        ({"RTL_ALT": 2000.0}, "return_height_m", 20.0),
        ({"GUID_TIMEOUT": 1.0}, "setpoint_timeout_s", 1.0),
        ({"DISARM_DELAY": 0.0}, "disarm_grounded_s", -1.0),
        ({"DISARM_DELAY": 5.0}, "disarm_grounded_s", 5.0),
        ({"BATT_LOW_MAH": 1000.0}, "battery_low", 0.2),
        ({"BATT_LOW_MAH": 1.0, "BATT_CAPACITY": 0.0}, "battery_low", 1.0),
        ({"SIM_FAILURE_EN": 1.0}, "failure_injection", True),
        ({}, "arm_authorizer", None),
    ],
)
def test_ardupilots_parameters_mean(parameters: dict[str, float], name: str, value: Any) -> None:
    found = getattr(copter(**parameters), name)
    assert found == (pytest.approx(value) if isinstance(value, float) else value)


@pytest.mark.parametrize(
    ("parameter", "name", "reactions"),
    [
        (
            "FS_GCS_ENABLE",
            "ground_loss",
            {0: Reaction.NONE, 1: Reaction.RETURN, 2: Reaction.NONE, 5: Reaction.LAND},
        ),
        (
            "FS_THR_ENABLE",
            "manual_loss",
            {0: Reaction.NONE, 1: Reaction.RETURN, 3: Reaction.LAND},
        ),
        (
            "BATT_FS_LOW_ACT",
            "low_reaction",
            {0: Reaction.NONE, 1: Reaction.LAND, 2: Reaction.RETURN, 5: Reaction.DISARM},
        ),
        (
            "BATT_FS_CRT_ACT",
            "critical_reaction",
            {0: Reaction.NONE, 1: Reaction.LAND, 5: Reaction.DISARM},
        ),
    ],
)
def test_ardupilots_failsafe_actions(
    parameter: str, name: str, reactions: dict[int, Reaction]
) -> None:
    for action, reaction in reactions.items():
        assert getattr(copter(**{parameter: action}), name) is reaction


@pytest.mark.parametrize("flavour", [Px4(), Copter()])
def test_modes_survive_their_encoding(flavour: Flavour) -> None:
    for mode in flavour.modes:
        code = flavour.custom_mode(mode)
        assert flavour.mode_of_custom(code) is mode


@pytest.mark.parametrize("flavour", [Px4(), Copter()])
@pytest.mark.parametrize("number", [-1, 99, 2**31 - 1])
def test_unknown_mode_numbers_are_none(flavour: Flavour, number: int) -> None:
    assert flavour.mode_of_command(number, 0) is None
    assert flavour.mode_of_custom(number) is None


def test_px4s_sub_modes_matter_in_auto_only() -> None:
    flavour = Px4()
    assert flavour.mode_of_command(4, 6) is Mode.LAND
    assert flavour.mode_of_command(4, 0) is None
    assert flavour.mode_of_command(6, 3) is Mode.OFFBOARD


def test_ardupilots_take_off_is_part_of_guided() -> None:
    flavour = Copter()
    assert flavour.custom_mode(Mode.TAKEOFF) == flavour.custom_mode(Mode.OFFBOARD) == 4
