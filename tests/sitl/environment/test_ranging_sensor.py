"""Sensors that publish ranges: what they send, read by the daemon, is where it is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.obstacle_field import ObstacleField
from onboard.files.sensor_sources import (
    DistanceSensorSource,
    LaserScanSource,
    Mounting,
    ObstacleDistanceSource,
    PointCloudSource,
    RangeSource,
    SensorPose,
)
from onboard.perception.detection import DetectionFrame, corners_ned
from onboard.perception.ros2.messages import decode_laser_scan
from onboard.perception.ros2.point_cloud import decode_point_cloud
from onboard.perception.sources.registry import sensor
from onboard.vehicle_state import Pose
from sitl.environment.lidar import ScannerConfig, ray_ranges_m
from sitl.environment.mounted_beams import MountedBeams, PastTruths
from sitl.environment.ranging_sensor import RangingSensor
from sitl.environment.sensor import SensorConfig
from sitl.environment.sensor_message import LinkMessage
from sitl.plant.truth import VehicleTruth
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    field_of,
    measured_ranges,
    pose_at,
    poses_of,
)

MOUNTED = {"x_m": 0.3, "y_m": 0.1, "z_m": -0.2, "yaw_deg": 30.0, "pitch_deg": 3.0, "roll_deg": -4.0}
PILLAR = field_of([(8.0, 1.0, 1.0, 1.0, 0.3)])
SCAN_S = 0.1


def truth_of(pose: Pose) -> VehicleTruth:
    half = np.array((pose.roll_rad, pose.pitch_rad, pose.yaw_rad)) / 2.0
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    attitude = (
        float(cr * cp * cy + sr * sp * sy),
        float(sr * cp * cy - cr * sp * sy),
        float(cr * sp * cy + sr * cp * sy),
        float(cr * cp * sy - sr * sp * cy),
    )
    at_rest = (0.0, 0.0, 0.0)
    return VehicleTruth(
        pose.time_s,
        pose.position_ned_m,
        pose.velocity_ned_mps,
        at_rest,
        attitude,
        at_rest,
        (0,) * 4,
    )


def moving(time_s: float) -> Pose:
    """Return a pose of a vehicle that flies, tilts and turns."""
    return pose_at(
        time_s,
        (3.0 * time_s, -1.0 * time_s, -4.0),
        (3.0, -1.0, 0.0),
        roll_deg=20.0 * time_s,
        pitch_deg=-8.0 + 10.0 * time_s,
        yaw_deg=15.0 * time_s,
    )


def sent(config: SensorConfig, field: ObstacleField = PILLAR, seed: int = 1) -> list[Any]:
    """Return what a sensor sends in 0.3 s of a flight."""
    ranging = RangingSensor(config, field, seed, EPOCH_UNIX_S)
    messages: list[Any] = []
    for step in range(31):
        messages += ranging.sense(step * 0.01, truth_of(moving(step * 0.01)))
    return messages


def config_of(publishes: Any, *, view_deg: float = 360.0, **scanner: Any) -> SensorConfig:
    return SensorConfig(
        source="lidar",
        publishes=publishes,
        range_m=20.0,
        field_of_view_deg=view_deg,
        rate_hz=10.0,
        latency_s=0.0,
        scanner=ScannerConfig(**scanner),
    )


def test_rays_of_a_mounted_sensor_meet_what_an_independent_model_says() -> None:
    beams = 180
    left_rad = -math.pi + (np.arange(beams) + 0.5) * 2.0 * math.pi / beams
    directions = np.stack((np.cos(left_rad), -np.sin(left_rad), np.zeros(beams)))
    boxes = [(8.0, 1.0, 1.0, 1.0, 0.3), (-3.0, 6.0, 2.0, 0.5, 1.0), (2.0, -4.0, 0.4, 0.4, 0.0)]
    truths = PastTruths(SCAN_S)
    for step in range(-20, 11):
        truths.add(truth_of(moving(step * 0.01)))
    times_s = SCAN_S * np.arange(beams) / beams
    found_m = MountedBeams(directions, SensorPose(**MOUNTED), field_of(boxes)).ranges_m(
        truths, times_s, 30.0
    )
    poses = [moving(time_s) for time_s in times_s.tolist()]
    expected_m = measured_ranges(boxes, poses, Mounting.model_validate(MOUNTED))
    # The independent model has no ground: it is met where nothing else is.
    of_pillars = np.isfinite(expected_m)
    assert of_pillars.sum() > 5
    assert found_m[of_pillars] == pytest.approx(expected_m[of_pillars], abs=2e-3)


def test_a_beam_that_points_down_meets_the_ground() -> None:
    truths = PastTruths(0.0)
    truths.add(truth_of(pose_at(0.0, (0.0, 0.0, -4.0), pitch_deg=-30.0)))
    ahead, behind = np.array([[1.0, -1.0], [0.0, 0.0], [0.0, 0.0]]).T
    beams = MountedBeams(np.stack((ahead, behind), 1), SensorPose(), ObstacleField.of([]))
    ranges_m = beams.ranges_m(truths, np.zeros(2), 30.0)
    assert ranges_m[0] == pytest.approx((4.0 + 0.15) / math.sin(math.radians(30.0)))
    assert math.isinf(ranges_m[1])


def test_rays_may_start_in_different_places() -> None:
    starts_m = np.array([[0.0, 0.0], [2.0, 1.0], [8.0, 1.0]])
    bearings_rad = np.array([0.0, 0.0, 1.0])
    together = ray_ranges_m(starts_m, bearings_rad, PILLAR, np.arange(1))
    for index, (north_m, east_m) in enumerate(starts_m.tolist()):
        (alone,) = ray_ranges_m(
            (north_m, east_m), bearings_rad[index : index + 1], PILLAR, np.arange(1)
        )
        assert together[index] == alone
    assert together[2] == 0.0  # from inside


# ---------------------------------------------------------------------- read by the daemon

LINK = mavlink.MAVLink(None, 1, 1)
READERS: dict[str, Any] = {
    "laserscan": LaserScanSource(
        kind="laserscan", name="lidar", topic="/lidar", range_m=12.0, uncertainty_m=0.05
    ),
    "pointcloud2": PointCloudSource(
        kind="pointcloud2",
        name="lidar",
        topic="/lidar",
        range_m=12.0,
        uncertainty_m=0.05,
        view_deg=(360.0, 40.0),
    ),
    "obstacle_distance": ObstacleDistanceSource(
        kind="obstacle_distance", name="lidar", range_m=12.0, uncertainty_m=0.05, latency_s=0.0
    ),
    "range": RangeSource(
        kind="range", name="lidar", topic="/lidar", range_m=12.0, uncertainty_m=0.05
    ),
    "distance_sensor": DistanceSensorSource(
        kind="distance_sensor", name="lidar", range_m=12.0, uncertainty_m=0.05, latency_s=0.0
    ),
}


def frame_of(publishes: str, *, view_deg: float = 360.0, **scanner: Any) -> DetectionFrame:
    """Return the daemon's frame of the last message of a flight."""
    config = config_of(publishes, view_deg=view_deg, resolution_deg=0.4, **scanner)
    message = sent(config)[-1]
    source = READERS[publishes].model_copy(
        update={"height_band_m": (3.5, 3.5), "no_return_is_free_to_m": 12.0}
    )
    reader = sensor(source, poses_of(*(moving(0.02 * step) for step in range(-2, 20))))
    if isinstance(message, LinkMessage):
        # It is stamped by the time since the start, and arrives at once.
        fields = message.message.to_dict()
        begin_s = fields.get("time_usec", 0) / 1e6 or fields["time_boot_ms"] / 1e3
        payload, now_unix_s = bytes(message.message.pack(LINK)), EPOCH_UNIX_S + begin_s
    else:
        payload, now_unix_s = message.payload, 0.0
        reader.check_sample(message.key or "", message.attachment, 0.0)
    (frame,) = reader.input.read(payload, now_unix_s)
    return frame


def nearest_m(frame: DetectionFrame) -> float:
    """Return how near the nearest box of a frame is to the vehicle's centre."""
    away_m = []
    for seen in frame.obstacles:
        box = field_of([(*seen.center_m, *seen.size_m, math.radians(seen.yaw_deg))])
        bearings_rad = np.linspace(-math.pi, math.pi, 3601)
        away_m.append(ray_ranges_m((0.0, 0.0), bearings_rad, box, np.arange(1)).min())
    return float(min(away_m))


@pytest.mark.parametrize("publishes", READERS)
def test_the_daemon_sees_the_pillar_where_it_is(publishes: str) -> None:
    view_deg = 40.0 if publishes in ("range", "distance_sensor") else 360.0
    scan_time_s = SCAN_S if publishes == "laserscan" else 0.0
    frame = frame_of(
        publishes, view_deg=view_deg, scan_time_s=scan_time_s, range_noise_m=0.002, lines=8
    )
    pose = moving(frame.stamp_unix_s - EPOCH_UNIX_S)
    bearings_rad = np.linspace(-math.pi, math.pi, 3601)
    place_m = pose.position_ned_m[:2]
    true_m = float(ray_ranges_m(place_m, bearings_rad, PILLAR, np.arange(1)).min())
    # A box encloses what was seen of two faces, or a sector, which is of the tilted body.
    assert -0.25 < nearest_m(frame) - true_m < 0.06


def test_the_daemon_undoes_the_smear_of_a_scan() -> None:
    middles_m = []
    for scan_time_s in (0.0, SCAN_S):
        frame = frame_of("laserscan", scan_time_s=scan_time_s)
        (seen,) = frame.obstacles
        pose = moving(frame.stamp_unix_s - EPOCH_UNIX_S)
        middles_m.append(np.mean(corners_ned(seen, pose), axis=0))
    assert middles_m[1] == pytest.approx(middles_m[0], abs=0.06)
    assert middles_m[0] == pytest.approx(PILLAR.center_ned_m[0], abs=0.6)


def test_a_scan_that_takes_time_is_smeared() -> None:
    config = config_of("laserscan", scan_time_s=SCAN_S)
    at_once = config_of("laserscan")
    smeared, sharp = (decode_laser_scan(sent(each)[-1].payload) for each in (config, at_once))
    assert smeared.time_increment_s == pytest.approx(SCAN_S / len(smeared.ranges_m))
    assert smeared.header.stamp_unix_s == pytest.approx(sharp.header.stamp_unix_s - SCAN_S)
    nearest = [float(np.nanmin(each.ranges_m)) for each in (smeared, sharp)]
    assert nearest[0] - nearest[1] > 0.1


def test_noise_dropouts_and_own_parts() -> None:
    config = config_of(
        "laserscan",
        resolution_deg=0.5,
        range_noise_m=0.02,
        dropout=0.3,
        blind_sectors_deg=((150.0, -170.0),),
    )
    hedge = field_of([(0.0, 5.0, 100.0, 1.0, 0.0), (0.0, -5.0, 100.0, 1.0, 0.0)])
    scans = [decode_laser_scan(one.payload).ranges_m for one in sent(config, hedge)]
    ranges_m = np.array(scans)
    angles_deg = np.degrees(-math.pi + (np.arange(720) + 0.5) * 2.0 * math.pi / 720)
    own = (-angles_deg - 150.0) % 360.0 <= 40.0
    assert ranges_m[:, own] == pytest.approx(0.15)
    aside = (np.abs(np.abs(angles_deg) - 90.0) < 40.0) & ~own
    assert np.isinf(ranges_m[:, aside]).mean() == pytest.approx(0.3, abs=0.05)
    still = RangingSensor(config, hedge, 1, EPOCH_UNIX_S)
    truth = truth_of(pose_at())
    heard: list[Any] = [
        still.sense(0.1 * step, truth._replace(time_s=0.1 * step)) for step in range(40)
    ]
    seen_m = np.array([decode_laser_scan(one.payload).ranges_m[180] for (one,) in heard])
    assert np.std(seen_m[np.isfinite(seen_m)]) == pytest.approx(0.02, rel=0.4)


def test_the_same_seed_sends_the_same_and_another_one_does_not() -> None:
    config = config_of("laserscan", range_noise_m=0.02)
    first, again, other = (sent(config, seed=seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_a_cloud_holds_points_of_several_heights_and_nothing_that_did_not_return() -> None:
    config = config_of("pointcloud2", view_deg=120.0, lines=5, lines_view_deg=20.0)
    (first, *_) = sent(config)
    points_m = decode_point_cloud(first.payload).points_m
    assert np.isfinite(points_m).all()
    of_pillar = points_m[:, np.abs(points_m[2]) < 2.0]
    assert len(np.unique(np.round(of_pillar[2], 1))) > 3


def test_sectors_that_are_hidden_are_unknown_and_not_free() -> None:
    config = config_of("obstacle_distance", blind_sectors_deg=((170.0, -170.0),))
    (first, *_) = sent(config, ObstacleField.of([]))
    assert first.message.distances[36] == 65535
    assert first.message.distances[18] == 2001


def test_faults_of_a_sensor() -> None:
    faults = (
        {"kind": "silent", "start_s": 0.1, "end_s": 0.15},
        {"kind": "range", "start_s": 0.15, "end_s": 0.25, "range_m": 3.0},
        {"kind": "stuck", "start_s": 0.25},
    )
    config = SensorConfig.model_validate(config_of("laserscan").model_dump() | {"faults": faults})
    first, short, stuck = sent(config)
    assert np.isfinite(decode_laser_scan(first.payload).ranges_m).any()
    assert not np.isfinite(decode_laser_scan(short.payload).ranges_m).any()
    assert stuck is short


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"mounting": {"x_m": 1.0}}, "mounting is for other formats"),
        ({"publishes": "laserscan", "yaw_deg": 90.0}, "turned by mounting.yaw_deg"),
        ({"publishes": "range", "field_of_view_deg": 200.0}, "must be less than 180"),
        ({"publishes": "laser_scan"}, "laserscan"),
    ],
)
def test_keys_that_do_not_fit_are_refused(keys: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        SensorConfig.model_validate(keys)
