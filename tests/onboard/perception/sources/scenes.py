"""Scenes for ranging sensors: where the body is, what stands around it, what a lidar measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.files.sensor_sources import LaserScanSource, Mounting
from onboard.perception.detection import DetectionFrame
from onboard.perception.pose_history import PoseHistory
from onboard.perception.sources.sensor_input import PosesByStamp
from onboard.vehicle_state import Pose
from sitl.environment.lidar import ray_ranges_m

EPOCH_UNIX_S = 1_790_000_000.0
# Height, how far below the centre the sensor is, ground_margin_m: it looks at what is lower than
# the margin, near the ground.
LOW_SENSORS: Final = ((0.55, 0.15, 0.5), (0.8, 0.35, 0.5), (2.1, 0.15, 2.0))
# A box: centre north, east, extents, yaw.
Box = tuple[float, float, float, float, float]


def pose_at(
    time_s: float = 0.0,
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -4.0),
    velocity_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0),
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    yaw_deg: float = 0.0,
) -> Pose:
    angles_rad = map(math.radians, (roll_deg, pitch_deg, yaw_deg))
    return Pose(time_s, position_ned_m, velocity_ned_mps, *angles_rad)


def poses_of(*poses: Pose) -> PosesByStamp:
    """Return a history of some poses; a single one lasts for a second around time zero."""
    history = PoseHistory()
    if len(poses) == 1:
        poses = tuple(poses[0]._replace(time_s=0.05 * step - 0.5) for step in range(21))
    for pose in poses:
        history.add(pose)
    return PosesByStamp(history, lambda: EPOCH_UNIX_S)


def field_of(boxes: Sequence[Box]) -> ObstacleField:
    obstacles = [
        Obstacle(
            id=str(number),
            center_ned_m=(north, east),
            size_m=(length, width),
            yaw_deg=math.degrees(yaw),
        )
        for number, (north, east, length, width, yaw) in enumerate(boxes)
    ]
    return ObstacleField.of(obstacles)


def ranges_around(
    boxes: Sequence[Box],
    from_ned_m: tuple[float, float] = (0.0, 0.0),
    heading_rad: float = 0.0,
    beams: int = 720,
    range_max_m: float = 30.0,
) -> NDArray[np.float64]:
    """Return what `scan_all_round` carries: counter-clockwise, from behind; inf without a hit."""
    left_rad = -math.pi + (np.arange(beams) + 0.5) * 2.0 * math.pi / beams
    found = ray_ranges_m(from_ned_m, heading_rad - left_rad, field_of(boxes), np.arange(len(boxes)))
    return np.where(found < range_max_m, found, math.inf)


def lidar(**keys: Any) -> LaserScanSource:
    keys = {"kind": "laserscan", "name": "lidar", "topic": "/scan"} | keys
    return LaserScanSource.model_validate({"range_m": 12.0, "uncertainty_m": 0.05} | keys)


def free_at(frame: DetectionFrame, bearing_deg: float) -> float:
    """Return how far a frame says free at a bearing, clockwise from the nose; 0 out of view."""
    assert frame.free_range_m is not None
    half_deg = frame.field_of_view_deg / 2.0
    share = (bearing_deg + half_deg) / frame.field_of_view_deg
    index = math.floor(share * len(frame.free_range_m))
    if not 0 <= index < len(frame.free_range_m):
        return 0.0
    found_m = frame.free_range_m[index]
    assert found_m is not None
    return found_m


def rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> NDArray[np.float64]:
    """Return the rotation from the turned to the fixed frame: yaw, then pitch, then roll."""
    matrix: NDArray[np.float64] = Rotation.from_euler(
        "ZYX", (yaw_rad, pitch_rad, roll_rad)
    ).as_matrix()
    return matrix


def measured_ranges(
    boxes: Sequence[Box], poses: Sequence[Pose], mounting: Mounting, range_max_m: float = 30.0
) -> NDArray[np.float64]:
    """Return what a mounted lidar measures all round among pillars of any height.

    Args:
        boxes: the pillars.
        poses: of the body at each beam, counter-clockwise from behind.
        mounting: of the lidar.
        range_max_m: farther away nothing returns.
    """
    field, every = field_of(boxes), np.arange(len(boxes))
    angles_deg = (mounting.roll_deg, mounting.pitch_deg, mounting.yaw_deg)
    body_from_sensor = rotation(*np.radians(angles_deg))
    offset_m = np.array((mounting.x_m, mounting.y_m, mounting.z_m))
    left_rad = -math.pi + (np.arange(len(poses)) + 0.5) * 2.0 * math.pi / len(poses)
    ranges_m = np.full(len(poses), math.inf)
    for beam, pose in enumerate(poses):
        ned_from_body = rotation(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
        ray = np.array((math.cos(left_rad[beam]), -math.sin(left_rad[beam]), 0.0))
        ray = ned_from_body @ body_from_sensor @ ray
        origin_m = np.array(pose.position_ned_m) + ned_from_body @ offset_m
        bearing_rad = np.array([math.atan2(ray[1], ray[0])])
        (found_m,) = ray_ranges_m((origin_m[0], origin_m[1]), bearing_rad, field, every)
        ranges_m[beam] = found_m / math.hypot(ray[0], ray[1])
    return np.where(ranges_m < range_max_m, ranges_m, math.inf)


def tilted_ranges(
    boxes: Sequence[Box], pose: Pose, beams: int = 720, range_max_m: float = 30.0
) -> NDArray[np.float64]:
    """Return what a lidar in the middle of a tilted body measures among pillars, all at once."""
    left_rad = -math.pi + (np.arange(beams) + 0.5) * 2.0 * math.pi / beams
    plane = np.stack((np.cos(left_rad), -np.sin(left_rad), np.zeros(beams)))
    rays = rotation(pose.roll_rad, pose.pitch_rad, pose.yaw_rad) @ plane
    bearings_rad = np.arctan2(rays[1], rays[0])
    every = np.arange(len(boxes))
    found_m = ray_ranges_m(pose.position_ned_m[:2], bearings_rad, field_of(boxes), every)
    found_m /= np.hypot(rays[0], rays[1])
    return np.where(found_m < range_max_m, found_m, math.inf)


def overclaim_m(
    frame: DetectionFrame, boxes: Sequence[Box], pose: Pose, spacing_deg: float
) -> float:
    """Return by how much a frame says free what is not, at most, along 2,880 bearings.

    An edge between two beams reaches up to half of their distance nearer than either hit; that is
    part of how far faces may be off.
    """
    assert frame.free_range_m is not None
    bearings_rad = (np.arange(2880) + 0.5) * 2.0 * math.pi / 2880 - math.pi
    true_m = ray_ranges_m(
        pose.position_ned_m[:2], pose.yaw_rad + bearings_rad, field_of(boxes), np.arange(len(boxes))
    )
    said_m = [free_at(frame, bearing_deg) for bearing_deg in np.degrees(bearings_rad)]
    between_m = np.radians(spacing_deg) / 2.0 * np.where(np.isfinite(true_m), true_m, 0.0)
    return float((np.array(said_m) - true_m - between_m).max())
