"""Distances as MAVLink has them: centimetres, sectors around the nose, nothing, unknown."""

import math

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from sitl.environment.formats.mavlink_ranges import distance_sensor, obstacle_distance


def test_each_sector_has_its_nearest_return() -> None:
    sectors = np.array([0, 0, 71, 18, 19])
    ranges_m = np.array([4.0, 3.459, math.inf, math.nan, 99.0])
    message = obstacle_distance(2.5, sectors, ranges_m, (0.2, 12.0))
    assert message.distances[0] == 345  # no farther than measured
    assert message.distances[71] == 1201  # nothing there
    assert message.distances[19] == 1201  # beyond what it measures
    assert message.distances[18] == message.distances[40] == 65535  # unknown, not looked at
    assert (message.min_distance, message.max_distance) == (20, 1200)
    assert (message.increment_f, message.angle_offset) == (5.0, 0.0)
    assert message.frame == mavlink.MAV_FRAME_BODY_FRD
    assert message.time_usec == 2_500_000
    assert len(message.pack(mavlink.MAVLink(None, 1, 1))) > 100


def test_a_cone_has_one_distance() -> None:
    message = distance_sensor(2.5, 3.459, 0.4, (0.2, 12.0))
    assert message.current_distance == 345
    assert message.orientation == mavlink.MAV_SENSOR_ROTATION_NONE
    assert message.horizontal_fov == 0.4
    assert distance_sensor(2.5, math.inf, 0.4, (0.2, 12.0)).current_distance == 1201
