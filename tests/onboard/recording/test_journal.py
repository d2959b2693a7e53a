"""What the journal says of a service that sees obstacles and has a plan."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.logs.flight_log import Log, log_of
from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.files.contract_file import Contract, load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.geometry.frames import LegFrame
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import Trajectory
from onboard.recording.journal import PATH_POINTS_MAX, PATH_STEP_S, SLOW_PERIOD_S, Journal, path_of
from onboard.vehicle_state import Pose

CONFIG = Path(__file__).parents[3] / "config"
EPOCH_S = 1_790_000_000.0


@pytest.fixture
def contract() -> Contract:
    return load_contract(CONFIG / "paper_contract.yaml")


@pytest.fixture
def autonomy(contract: Contract) -> Autonomy:
    mission = load_yaml(CONFIG / "paper_mission.yaml", Mission)
    return Autonomy(contract, mission, epoch_unix_s=EPOCH_S)


def see(autonomy: Autonomy, now_s: float, *centers_m: tuple[float, float]) -> None:
    obstacles = [
        {"id": str(i), "center_m": c, "size_m": [1.0, 1.2], "yaw_deg": 0.0, "uncertainty_m": 0.02}
        for i, c in enumerate(centers_m)
    ]
    frame = {
        "version": 1, "source": "front", "sequence": 1, "stamp_unix_s": EPOCH_S + now_s,
        "frame": "local_ned", "range_m": 12.0, "field_of_view_deg": 120.0, "obstacles": obstacles,
    }  # fmt: skip
    autonomy.receive_detection(json.dumps(frame).encode(), now_s)


def stand_at(autonomy: Autonomy, now_s: float, north_m: float, yaw_rad: float = 0.0) -> None:
    autonomy.link.pose = Pose(now_s, (north_m, 0.0, -4.0), (0.0, 0.0, 0.0), 0.0, 0.0, yaw_rad)


def ticked(journal: Journal, now_s: float) -> Log:
    journal.autonomy.tick(now_s)
    return log_of(journal.collect(now_s))


def test_every_tick_has_a_state_and_what_lasts_is_said_once(autonomy: Autonomy) -> None:
    journal = Journal(autonomy, timed=False)
    ticks = [ticked(journal, number * TICK_S) for number in range(1, 101)]
    assert all(len(tick.states) == 1 for tick in ticks)
    assert sum(len(tick.margins) for tick in ticks) == 1
    assert sum(len(tick.monitors) for tick in ticks) == round(2.0 / SLOW_PERIOD_S)


def test_margins_are_those_of_the_contract_as_flown(autonomy: Autonomy) -> None:
    (said,) = ticked(Journal(autonomy, timed=False), TICK_S).margins
    assert said.compliant is True
    for told, clause in zip(said.clauses, autonomy.assessment.clauses, strict=True):
        assert told.name == clause.name
        assert told.margin == pytest.approx(told.declared - told.required)
        assert told.holds == (told.margin > 0.0)


def test_monitors_state_what_is_measured_and_what_the_contract_allows(
    autonomy: Autonomy, contract: Contract
) -> None:
    see(autonomy, 0.0, (10.0, 3.0))
    stand_at(autonomy, 0.0, 0.0)
    (said,) = ticked(Journal(autonomy, timed=False), 0.1).monitors
    assert said.detection_age.measured == pytest.approx(0.1)
    assert said.detection_age.limit == contract.sensor.frame_age_max_s
    assert said.detection_age.unit == "s"
    assert said.telemetry_age.measured == pytest.approx(0.1)
    assert said.heartbeat_age.measured is None
    # From (0, 0) to the corner of the box around (10, 3), less the vehicle's own radius.
    expected_m = math.hypot(9.5, 2.4) - contract.vehicle.radius_m
    assert said.clearance.measured == pytest.approx(expected_m)


def test_obstacles_are_said_when_they_change_with_all_that_surrounds_them(
    autonomy: Autonomy,
) -> None:
    journal = Journal(autonomy, timed=False)
    see(autonomy, 0.0, (12.0, 0.5))
    (first,) = ticked(journal, 0.02).obstacles
    (obstacle,) = first.obstacles
    assert first.height_m == 4.0
    boundary_m = np.array(obstacle.boundary_ned_m)
    region_m, keep_out_m = np.array(obstacle.region_ned_m), np.array(obstacle.keep_out_ned_m)
    # Behind the boundary lies the obstacle, before it the way in which it can still be avoided.
    assert boundary_m[:, 0].min() >= region_m[:, 0].min()
    assert boundary_m[:, 0].max() <= keep_out_m[:, 0].min() + 1e-9
    assert boundary_m[:, 1].min() == pytest.approx(keep_out_m[:, 1].min())
    lane_m = np.array(obstacle.lane_ned_m)
    # A swerve may use more than the region that other obstacles have to keep out of.
    assert lane_m[:, 1].min() < region_m[:, 1].min() < keep_out_m[:, 1].min()
    assert not ticked(journal, 0.5).obstacles
    see(autonomy, 0.6, (12.0, 0.5), (24.0, -1.0))
    (second,) = ticked(journal, 0.8).obstacles
    assert [each.id for each in second.obstacles] == ["front/0", "front/1"]
    assert second.obstacles[0] == obstacle


@pytest.mark.parametrize("duration_s", [0.05, 0.1, 5.0, 5.03, 39.95, 60.0, 6383.0, 1e9])
def test_the_recorded_path_of_a_plan_is_bounded_and_keeps_its_ends(duration_s: float) -> None:
    still = Profile(0.0, 0.0)
    along = Profile(0.0, 2.0, (Segment(duration_s, 0.0),))
    trajectory = Trajectory.from_profiles(7.0, along, still, still)
    leg = LegFrame((0.0, 0.0, -4.0), math.pi / 2.0)
    path_ned_m = path_of(trajectory, leg)
    assert 2 <= len(path_ned_m) <= PATH_POINTS_MAX
    assert path_ned_m[0] == pytest.approx([0.0, 0.0, -4.0])
    assert path_ned_m[-1] == pytest.approx([0.0, 2.0 * duration_s, -4.0], rel=1e-9, abs=1e-6)
    steps_m = np.diff([east_m for _, east_m, _ in path_ned_m])
    assert (steps_m > -1e-9).all()
    fine_m = 2.0 * max(PATH_STEP_S, duration_s / (PATH_POINTS_MAX - 1))
    assert steps_m.max() <= fine_m * (1.0 + 1e-9)
