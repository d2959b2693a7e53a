"""Boxes of scans: bounded, without false gaps, with names that stay, and never contradicting."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest

from onboard.monitoring.detection_consistency import DetectionConsistencyMonitor, Sighting
from onboard.perception.detection import DetectionFrame, corners_ned
from onboard.perception.full_view import in_full_view
from onboard.perception.pose_history import PoseHistory
from onboard.perception.sources.laser_scan import LaserScanInput
from onboard.perception.sources.sensor_input import PosesByStamp
from onboard.vehicle_state import Pose
from tests.onboard.perception.ros2.encoding import scan_all_round
from tests.onboard.perception.sources.scenes import (
    EPOCH_UNIX_S,
    Box,
    lidar,
    pose_at,
    ranges_around,
)

HEDGE: Box = (20.0, 4.0, 50.0, 0.6, 0.0)
STEP_S = 0.05


class Flight:
    """A vehicle with a lidar that moves from scan to scan."""

    def __init__(self, boxes: list[Box], **keys: object) -> None:
        self._boxes, self._history = boxes, PoseHistory()
        poses = PosesByStamp(self._history, lambda: EPOCH_UNIX_S)
        self.source = LaserScanInput(lidar(**keys), poses)
        self._steps = 0

    def scan(self, pose: Pose, noise_m: float = 0.0, seed: int = 0) -> DetectionFrame:
        time_s = self._steps * STEP_S
        self._steps += 1
        self._history.add(pose._replace(time_s=time_s))
        ranges_m = ranges_around(self._boxes, pose.position_ned_m[:2], pose.yaw_rad)
        ranges_m += np.random.default_rng(seed + self._steps).uniform(-noise_m, noise_m, 720)
        payload = scan_all_round(ranges_m, stamp_unix_s=EPOCH_UNIX_S + time_s)
        (frame,) = self.source.read(payload, 0.0)
        return frame


def along(metres: float, yaw_deg: float = 0.0) -> Pose:
    return pose_at(position_ned_m=(metres, 0.0, -4.0), yaw_deg=yaw_deg)


def bounds(frame: DetectionFrame, pose: Pose) -> dict[str, tuple[float, float, float, float]]:
    """North and east bounds of each box."""
    found = {}
    for box in frame.obstacles:
        corners = np.array(corners_ned(box, pose))
        (north, east), (north_end, east_end) = corners.min(axis=0), corners.max(axis=0)
        found[box.id] = (float(north), float(north_end), float(east), float(east_end))
    return found


def test_a_hedge_becomes_boxes_side_by_side_that_leave_no_gap() -> None:
    flight, pose = Flight([HEDGE], box_max_m=2.0), along(8.0)
    frame = flight.scan(pose)
    assert len(frame.obstacles) > 10
    assert all(max(box.size_m) <= 2.3 for box in frame.obstacles)
    assert all(box.partial for box in frame.obstacles)
    spans = sorted(bounds(frame, pose).values())
    covered_to_m = spans[0][1]
    for begin_m, end_m, *_ in spans[1:]:
        assert begin_m <= covered_to_m + 1e-6
        covered_to_m = max(covered_to_m, end_m)
    assert (spans[0][0], covered_to_m) == pytest.approx((-3.4, 19.4), abs=0.6)


def test_boxes_of_a_hedge_do_not_wander_along_it() -> None:
    """The union of all that ever came under one name stays as small as a box."""
    flight = Flight([HEDGE], box_max_m=2.0)
    unions: dict[str, tuple[float, float]] = {}
    for step in range(60):
        pose = along(0.25 * step, yaw_deg=math.sin(step / 5.0) * 20.0)
        for name, (begin_m, end_m, _, _) in bounds(flight.scan(pose, 0.02), pose).items():
            low_m, high_m = unions.get(name, (begin_m, end_m))
            unions[name] = (min(low_m, begin_m), max(high_m, end_m))
    assert max(high_m - low_m for low_m, high_m in unions.values()) <= 2.3
    assert len(unions) < 50  # 27 m of hedge came into range


def test_an_obstacle_keeps_its_name_while_the_vehicle_flies_past_and_turns() -> None:
    flight, names = Flight([(8.0, 3.0, 0.8, 0.8, 0.4), (9.0, -3.0, 0.5, 0.5, 0.0)]), set()
    for step in range(80):
        pose = along(0.2 * step, yaw_deg=2.0 * step)
        seen = {box.id for box in flight.scan(pose, 0.02).obstacles}
        assert len(seen) <= 2
        names |= seen
    assert len(names) == 2


def test_two_posts_are_two_boxes_and_a_gap_in_between_stays() -> None:
    flight, pose = Flight([(6.0, -0.8, 0.3, 0.3, 0.0), (6.0, 0.8, 0.3, 0.3, 0.0)]), along(0.0)
    (_, _, _, left_end_m), (_, _, right_begin_m, _) = sorted(
        bounds(flight.scan(pose), pose).values(), key=lambda box: box[2]
    )
    assert right_begin_m - left_end_m > 1.1


def test_an_obstacle_astride_the_begin_of_a_scan_is_one_box() -> None:
    frame = Flight([(-5.0, 0.0, 1.0, 1.0, 0.0)]).scan(along(0.0))
    assert len(frame.obstacles) == 1


def test_a_room_all_round_has_boxes_all_round() -> None:
    walls = [(5.0, 0.0, 0.2, 10.0, 0.0), (-5.0, 0.0, 0.2, 10.0, 0.0)]
    walls += [(0.0, 5.0, 10.0, 0.2, 0.0), (0.0, -5.0, 10.0, 0.2, 0.0)]
    frame = Flight(walls).scan(along(0.0))
    bearings_deg = sorted(
        math.degrees(math.atan2(y, x)) for x, y in (b.center_m for b in frame.obstacles)
    )
    assert len(bearings_deg) >= 20
    assert max(b - a for a, b in pairwise(bearings_deg)) < 30.0


def test_what_hides_another_makes_it_partial() -> None:
    near, behind = (4.0, 0.0, 0.5, 0.5, 0.0), (8.0, 0.6, 0.5, 1.5, 0.0)
    frame = Flight([near, behind]).scan(along(0.0))
    hidden = {box.center_m[0] > 6.0: box.partial for box in frame.obstacles}
    assert hidden == {False: False, True: True}


def test_after_a_jump_of_the_estimate_names_begin_anew() -> None:
    flight = Flight([(6.0, 0.0, 0.8, 0.8, 0.0)])
    before = {box.id for box in flight.scan(along(0.0)).obstacles}
    flight._history.shift((3.0, 0.0, 0.0))
    after = {box.id for box in flight.scan(along(0.0)).obstacles}
    assert len(before) == len(after) == 1
    assert not before & after


@pytest.mark.parametrize("seed", range(6))
def test_successive_scans_contradict_nothing(seed: int) -> None:
    """Round and square obstacles, seen from all sides, with noise within what is stated."""
    draw = random.Random(seed)
    boxes = [
        (draw.uniform(2.0, 18.0), side * draw.uniform(2.0, 5.0), *(draw.uniform(0.2, 1.4),) * 2,
         draw.uniform(0.0, 1.5))
        for side in (-1, 1, -1, 1, -1)
    ]  # fmt: skip
    flight, monitor, compared = Flight(boxes), DetectionConsistencyMonitor(), 0
    for step in range(100):
        pose = along(0.2 * step, yaw_deg=30.0 * math.sin(step / 10.0))
        frame = flight.scan(pose, noise_m=0.03, seed=1000 * seed)
        corners = [corners_ned(box, pose) for box in frame.obstacles]
        full = in_full_view(corners, pose, math.radians(frame.field_of_view_deg), frame.range_m)
        for box, corners_m, whole in zip(frame.obstacles, corners, full, strict=True):
            if whole and not box.partial:
                compared += 1
                sighting = Sighting.of(corners_m, box.uncertainty_m, 0.0)
                placed = monitor.take(box.id, sighting, step * STEP_S)
                assert placed.violation is None, (box, placed.violation)
    assert compared > 20


def test_an_obstacle_that_moves_is_found_out() -> None:
    flight, monitor, found = Flight([(6.0, 0.0, 0.5, 0.5, 0.0)]), DetectionConsistencyMonitor(), []
    pose = along(0.0)
    for step in range(20):
        flight._boxes = [(6.0, 0.03 * step, 0.5, 0.5, 0.0)]
        (box,) = flight.scan(pose).obstacles
        sighting = Sighting.of(corners_ned(box, pose), box.uncertainty_m, 0.0)
        found.append(monitor.take(box.id, sighting, step * STEP_S).violation)
    assert any(found)
