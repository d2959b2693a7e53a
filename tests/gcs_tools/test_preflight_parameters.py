"""Parameters of both autopilots against the contract: fine, wrong, and missing."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.live_check_parameters import check_parameters, tilt_required_deg
from gcs_tools.preflight_finding import Verdict
from onboard.config import Mission, load_contract
from onboard.contract import assess
from tests.gcs_tools.running import CONFIG

# The measured tuning: attitude lag 0.3 s, so that a plan's jerk is about 10 m/s³.
CONTRACT = load_contract(
    CONFIG / "default_contract.yaml",
    ("vehicle.attitude_lag_s=0.3", "vehicle.setpoint_loss_timeout_s=0.5"),
)
ASSESSMENT = assess(CONTRACT)
MISSION = Mission.model_validate({"altitude_m": 4.0, "legs": [{"end_ned_m": (40.0, 0.0)}]})

PX4 = {
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_XY_VEL_MAX": 12.0,
    "MC_ROLL_P": 6.5,
    "MC_PITCH_P": 6.5,
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 5.0,
    "COM_RC_IN_MODE": 0.0,
    "COM_RCL_EXCEPT": 4.0,
    "NAV_RCL_ACT": 2.0,
    "NAV_DLL_ACT": 0.0,
    "GF_ACTION": 1.0,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
}
ARDUPILOT = {
    "ANGLE_MAX": 3000.0,
    "PSC_ANGLE_MAX": 0.0,
    "PSC_JERK_XY": 20.0,
    "WPNAV_ACCEL": 600.0,
    "GUID_TIMEOUT": 0.5,
    "FS_THR_ENABLE": 1.0,
    "FS_OPTIONS": 4.0,
    "FS_GCS_ENABLE": 0.0,
    "ARMING_CHECK": 1.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_TYPE": 3.0,
    "FENCE_ALT_MAX": 50.0,
    "FENCE_RADIUS": 150.0,
    "FENCE_TOTAL": 0.0,
}
SETS = {"px4": PX4, "ardupilot": ARDUPILOT}


def verdicts(flavour: str, parameters: dict[str, float], **changes: Any) -> dict[str, Verdict]:
    settings: dict[str, Any] = {"mission": MISSION, "complete": True} | changes
    found = check_parameters(
        flavour, parameters, ASSESSMENT, settings["mission"], complete=settings["complete"]
    )
    return {each.name: each.verdict for each in found}


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_a_vehicle_set_up_for_its_contract_is_fine(flavour: str) -> None:
    assert set(verdicts(flavour, SETS[flavour]).values()) == {Verdict.HOLDS}


@pytest.mark.parametrize(
    ("flavour", "change"),
    [
        ("px4", {"MPC_TILTMAX_AIR": 20.0}),
        ("px4", {"MPC_XY_VEL_MAX": 2.9}),
        ("px4", {"MC_ROLL_P": 3.0}),
        ("px4", {"MC_PITCH_P": 3.0}),
        ("px4", {"COM_OF_LOSS_T": 1.0}),
        ("px4", {"COM_OBL_RC_ACT": 0.0}),
        ("px4", {"COM_OBL_RC_ACT": 3.0}),
        ("px4", {"COM_RCL_EXCEPT": 3.0}),
        ("px4", {"NAV_DLL_ACT": 2.0}),
        ("px4", {"GF_MAX_HOR_DIST": 30.0}),
        ("px4", {"GF_MAX_VER_DIST": 3.0}),
        ("ardupilot", {"ANGLE_MAX": 2000.0}),
        ("ardupilot", {"PSC_ANGLE_MAX": 15.0}),
        ("ardupilot", {"PSC_JERK_XY": 5.0}),
        ("ardupilot", {"WPNAV_ACCEL": 250.0}),
        ("ardupilot", {"GUID_TIMEOUT": 3.0}),
        ("ardupilot", {"FS_OPTIONS": 0.0}),
        ("ardupilot", {"FS_GCS_ENABLE": 1.0}),
        ("ardupilot", {"ARMING_CHECK": 0.0}),
        ("ardupilot", {"FENCE_RADIUS": 30.0}),
        ("ardupilot", {"FENCE_ALT_MAX": 3.0}),
        ("ardupilot", {"FENCE_TYPE": 7.0, "FENCE_TOTAL": 5.0}),
    ],
)
def test_one_wrong_parameter_turns_the_verdict(flavour: str, change: dict[str, float]) -> None:
    assert Verdict.worst(verdicts(flavour, SETS[flavour] | change).values()) is Verdict.BROKEN


@pytest.mark.parametrize(
    ("flavour", "name"),
    [
        *(("px4", name) for name in PX4 if name not in {"COM_RC_IN_MODE", "NAV_RCL_ACT"}),
        *(("ardupilot", name) for name in ARDUPILOT if name != "FS_THR_ENABLE"),
    ],
)
def test_a_missing_parameter_is_never_fine(flavour: str, name: str) -> None:
    """Unless another parameter says that it does not matter."""
    rest = {key: value for key, value in SETS[flavour].items() if key != name}
    spared = {"GF_ACTION", "FENCE_ENABLE", "FENCE_TYPE", "FENCE_TOTAL"}
    worst = Verdict.worst(verdicts(flavour, rest).values())
    assert worst is (Verdict.HOLDS if name in spared else Verdict.UNKNOWN)


def test_half_of_the_parameters_cannot_prove_that_there_is_no_geofence() -> None:
    rest = {name: value for name, value in PX4.items() if not name.startswith("GF_")}
    assert verdicts("px4", rest)["geofence"] is Verdict.HOLDS
    assert verdicts("px4", rest, complete=False)["GF_ACTION"] is Verdict.UNKNOWN
    assert set(verdicts("px4", {}, complete=False).values()) == {Verdict.UNKNOWN}


def test_without_a_mission_the_geofence_is_not_asked_for() -> None:
    assert "GF_ACTION" not in verdicts("px4", PX4 | {"GF_MAX_HOR_DIST": 1.0}, mission=None)


def test_the_tilt_has_a_reserve_and_covers_both_limits_together() -> None:
    assert tilt_required_deg(ASSESSMENT) == pytest.approx(21.0)
    lopsided = load_contract(
        CONFIG / "default_contract.yaml", ("vehicle.roll_max_deg=60", "vehicle.pitch_max_deg=60")
    )
    assert tilt_required_deg(assess(lopsided)) == pytest.approx(84.0)
