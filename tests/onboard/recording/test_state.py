"""The record of a tick: taken from the service, complete, and JSON from the first tick on."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.autonomy import Autonomy
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.recording.messages import StateRecord, as_json, schema_of
from onboard.recording.state import finite, state_of, unix_time_s
from onboard.vehicle_state import Pose
from tests.onboard.recording.json_schema import complaints

CONFIG = Path(__file__).parents[3] / "config"
EPOCH_S = 1_790_000_000.0


@pytest.fixture
def autonomy() -> Autonomy:
    contract = load_contract(CONFIG / "paper_contract.yaml")
    mission = load_yaml(CONFIG / "paper_mission.yaml", Mission)
    return Autonomy(contract, mission, epoch_unix_s=EPOCH_S)


def test_before_anything_is_heard_what_is_unknown_is_null(autonomy: Autonomy) -> None:
    autonomy.tick(0.0)
    state = state_of(autonomy, 0.0)
    said = json.loads(as_json(state))
    assert said.keys() == {each.name for each in fields(StateRecord)}
    unknown = {
        "position_ned_m",
        "battery_charge",
        "roll_rad",
        "detection_age_s",
        "telemetry_age_s",
        "position_doubt",
    }
    assert all(said[name] is None for name in unknown)
    assert (said["phase"], said["sensors"], said["log_ended"]) == ("standby", {}, False)
    assert set(said["dropped"].values()) == {0}
    assert complaints(said, schema_of(StateRecord)) == []


def test_pose_and_age_are_those_of_the_newest_telemetry(autonomy: Autonomy) -> None:
    autonomy.link.pose = Pose(1.0, (1.0, 2.0, -4.0), (0.5, 0.0, 0.0), 0.1, 0.2, 0.3)
    state = state_of(autonomy, 1.25)
    assert state.position_ned_m == (1.0, 2.0, -4.0)
    assert state.velocity_ned_mps == (0.5, 0.0, 0.0)
    assert (state.roll_rad, state.pitch_rad, state.yaw_rad) == (0.1, 0.2, 0.3)
    assert state.telemetry_age_s == pytest.approx(0.25)
    assert state.time_s == EPOCH_S + 1.25


def test_goal_and_charge_are_those_of_mission_and_battery(autonomy: Autonomy) -> None:
    report = mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [], 0, -1, -1, 83)
    autonomy.link.battery.hear_battery(report, 1.0)
    state = state_of(autonomy, 1.5)
    assert state.goal_ned_m == autonomy.navigator.situation.route.mission.legs[-1].end_ned_m
    assert state.battery_charge == pytest.approx(0.83)
    assert state_of(autonomy, 1000.0).battery_charge is None  # silent for too long


def test_what_is_dropped_is_counted_by_reason(autonomy: Autonomy) -> None:
    autonomy.receive_mavlink(b"garbage", 0.0)
    autonomy.receive_detection(b"{", 0.0)
    autonomy.receive_flight_authorization(b"{", 0.0)
    autonomy.receive_mission(b"{", 0.0)
    autonomy.tick(0.0)
    dropped = state_of(autonomy, 0.0).dropped
    assert dropped.mavlink_garbage_bytes > 0
    assert (dropped.frames_malformed, dropped.clearances_malformed) == (1, 1)
    assert dropped.missions_malformed == 1


def test_the_end_of_the_log_is_part_of_the_state(autonomy: Autonomy) -> None:
    autonomy.report_log_end("disk full", 0.0)
    assert state_of(autonomy, 0.0).log_ended is True


def test_times_are_given_to_the_microsecond(autonomy: Autonomy) -> None:
    assert unix_time_s(autonomy, 0.123_456_789) == EPOCH_S + 0.123457


@pytest.mark.parametrize(
    ("value", "shown"),
    [(1.5, 1.5), (float("inf"), None), (float("-inf"), None), (float("nan"), None)],
)
def test_a_number_that_json_lacks_is_none(value: float, shown: float | None) -> None:
    assert finite(value) == shown
