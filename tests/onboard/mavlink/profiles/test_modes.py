"""Modes, take-off and requests of the two profiles, against the definitions of the dialect."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.profiles import ardupilot, px4
from onboard.mavlink.profiles.ardupilot import ARDUPILOT
from onboard.mavlink.profiles.profile import AutopilotProfile, Mode
from onboard.mavlink.profiles.px4 import PX4
from sitl.autopilot.flavours.ardupilot import Copter
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.px4 import Px4
from sitl.autopilot.modes import Mode as SimulatedMode


def px4_mode(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (px4_mode(1), "MANUAL"),
        (px4_mode(2), "ALTCTL"),
        (px4_mode(3), "POSCTL"),
        (px4_mode(4, 1), "READY"),
        (px4_mode(4, 2), "TAKEOFF"),
        (px4_mode(4, 3), "LOITER"),
        (px4_mode(4, 4), "MISSION"),
        (px4_mode(4, 5), "RTL"),
        (px4_mode(4, 6), "LAND"),
        (px4_mode(4, 9), "AUTO 9"),
        (px4_mode(5), "ACRO"),
        (px4_mode(6), "OFFBOARD"),
        (px4_mode(6, 3), "OFFBOARD"),
        (px4_mode(7), "STABILIZED"),
        (px4_mode(11), "PX4 11"),
        (0, "PX4 0"),
    ],
)
def test_px4_names_main_and_sub_modes(custom_mode: int, name: str) -> None:
    assert px4.mode_name(custom_mode) == name
    assert PX4.modes.is_external_control(custom_mode) is (name == "OFFBOARD")


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (0, "STABILIZE"),
        (4, "GUIDED"),
        (5, "LOITER"),
        (8, "COPTER 8"),
        (9, "LAND"),
        (17, "BRAKE"),
        (999, "COPTER 999"),
    ],
)
def test_copter_names_its_modes(custom_mode: int, name: str) -> None:
    assert ardupilot.mode_name(custom_mode) == name
    assert ARDUPILOT.modes.is_external_control(custom_mode) is (custom_mode == 4)


@given(st.integers(0, 2**32 - 1))
def test_every_number_has_a_name_and_only_one_mode_obeys_setpoints(custom_mode: int) -> None:
    assert px4.mode_name(custom_mode)
    assert ardupilot.mode_name(custom_mode)
    assert PX4.modes.is_external_control(custom_mode) is (custom_mode >> 16 & 0xFF == 6)
    assert ARDUPILOT.modes.is_external_control(custom_mode) is (custom_mode == 4)


@pytest.mark.parametrize(
    ("profile", "flavour"), [(PX4, Px4()), (ARDUPILOT, Copter())], ids=["px4", "ardupilot"]
)
def test_the_simulated_autopilot_takes_the_modes_that_the_profile_commands(
    profile: AutopilotProfile, flavour: Flavour
) -> None:
    """The simulation has its own tables, written from the autopilots' documentation."""
    assert flavour.autopilot == profile.autopilot
    wanted = {
        SimulatedMode.OFFBOARD: profile.modes.external_control,
        SimulatedMode.HOLD: profile.modes.hold,
    }
    for simulated, mode in wanted.items():
        assert isinstance(mode, Mode)
        assert flavour.mode_of_command(int(mode.main), int(mode.sub)) is simulated
        assert profile.modes.name_of(flavour.custom_mode(simulated)) == mode.name
    for simulated in flavour.modes:
        external_control = profile.modes.is_external_control(flavour.custom_mode(simulated))
        assert external_control is (simulated is SimulatedMode.OFFBOARD)


@pytest.mark.parametrize(
    ("profile", "flavour"), [(PX4, Px4()), (ARDUPILOT, Copter())], ids=["px4", "ardupilot"]
)
def test_the_simulated_autopilot_has_the_parameters_that_the_profile_names(
    profile: AutopilotProfile, flavour: Flavour
) -> None:
    names = {spec.name for spec in flavour.parameter_specs(1)}
    assert profile.parameters is not None
    assert profile.parameters.setpoint_timeout in names
    assert profile.parameters.no_radio[0] in names
    assert profile.take_off.height_parameter in {*names, None}
    for prefix in profile.parameters.fence_prefixes:
        assert any(name.startswith(prefix) for name in names)


def test_only_copter_takes_off_in_the_mode_of_setpoints() -> None:
    assert ARDUPILOT.take_off.in_external_control
    assert ARDUPILOT.take_off.height_parameter is None
    assert not PX4.take_off.in_external_control
    assert PX4.take_off.height_parameter == "MIS_TAKEOFF_ALT"


def test_each_autopilot_is_asked_for_the_estimator_message_that_it_has() -> None:
    assert (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, 5.0) in PX4.requested_hz
    assert (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 5.0) in ARDUPILOT.requested_hz
    assert PX4.requested_hz[:-1] == ARDUPILOT.requested_hz[:-1]


def test_only_px4_adds_its_controllers_gain_to_the_echo() -> None:
    assert (PX4.target_gain_max_per_s, ARDUPILOT.target_gain_max_per_s) == (2.0, 0.0)


def test_only_px4_assumes_a_constant_position_at_rest() -> None:
    assert PX4.estimator.constant_at_rest
    assert not ARDUPILOT.estimator.constant_at_rest
    assert ARDUPILOT.needs_health_request
    assert not PX4.needs_health_request
