import math

import numpy as np
import pytest

from onboard.geometry.box import Box
from onboard.motion.axis_profile import Profile, Segment
from onboard.motion.trajectory import Trajectory
from onboard.planning.proximity import least_room_m


def straight(y_m: float, length_m: float = 20.0) -> Trajectory:
    along = Profile(0.0, 2.0, (Segment(length_m / 2.0, 0.0),))
    return Trajectory.from_profiles(3.0, along, Profile(y_m, 0.0), Profile(0.0, 0.0))


@pytest.mark.parametrize(
    ("y_m", "boxes", "room_m"),
    [
        (0.0, [], math.inf),
        (3.0, [Box(8.0, 9.0, -1.0, 1.0)], 2.0),
        (-3.0, [Box(8.0, 9.0, -1.0, 1.0), Box(12.0, 13.0, -2.5, 0.0)], 0.5),
        (0.0, [Box(23.0, 24.0, -1.0, 1.0)], 3.0),
        (0.0, [Box(23.0, 24.0, 4.0, 5.0)], 5.0),
        (0.5, [Box(5.0, 15.0, -1.0, 1.0)], -0.5),
        (0.0, [Box(19.7, 30.0, -9.0, 9.0)], -0.3),
    ],
)
def test_room_is_the_distance_from_the_nearest_box(
    y_m: float, boxes: list[Box], room_m: float
) -> None:
    assert least_room_m(straight(y_m), boxes) == pytest.approx(room_m, abs=1e-9)


def test_room_of_a_long_trajectory_takes_few_samples() -> None:
    assert np.isfinite(least_room_m(straight(0.0, 1e7), [Box(0.0, 1.0, 5.0, 6.0)]))
