import math

import pytest

from onboard.perception.detection import Corners
from onboard.perception.full_view import BOXES_MAX, in_full_view
from onboard.vehicle_state import Pose

VIEW_RAD, RANGE_M = math.radians(120.0), 12.0


def body(yaw_deg: float = 0.0) -> Pose:
    still = (0.0, 0.0, 0.0)
    return Pose(0.0, (3.0, -2.0, -4.0), still, 0.0, 0.0, math.radians(yaw_deg))


def ahead(bearing_deg: float, distance_m: float, *, size_m: float = 1.0) -> Corners:
    """Corners of a box seen at a bearing from north."""
    north_m = 3.0 + distance_m * math.cos(math.radians(bearing_deg))
    east_m = -2.0 + distance_m * math.sin(math.radians(bearing_deg))
    half_m = size_m / 2.0
    return [
        (north_m - half_m, east_m - half_m),
        (north_m + half_m, east_m - half_m),
        (north_m + half_m, east_m + half_m),
        (north_m - half_m, east_m + half_m),
    ]


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 179.0, -150.0])
@pytest.mark.parametrize(
    ("what", "boxes", "expected"),
    [
        ("ahead", [(0.0, 8.0)], [True]),
        ("wholly within the view", [(45.0, 8.0), (-45.0, 8.0)], [True, True]),
        ("across the edge of the view", [(58.0, 8.0), (-58.0, 8.0)], [False, False]),
        ("outside", [(90.0, 8.0), (180.0, 8.0)], [False, False]),
        ("across the end of the range", [(0.0, 11.9)], [False]),
        ("one hides the other", [(0.0, 5.0), (1.0, 9.0)], [True, False]),
        ("one hides an edge of the other", [(0.0, 5.0), (9.0, 9.0)], [True, False]),
        ("side by side", [(-15.0, 6.0), (15.0, 9.0)], [True, True]),
        ("around the sensor", [(0.0, 0.1)], [False]),
    ],
)
def test_only_what_is_seen_whole_counts(
    what: str, boxes: list[tuple[float, float]], expected: list[bool], yaw_deg: float
) -> None:
    seen = [ahead(bearing_deg + yaw_deg, distance_m) for bearing_deg, distance_m in boxes]
    assert in_full_view(seen, body(yaw_deg), VIEW_RAD, RANGE_M) == expected, what


@pytest.mark.parametrize("bearing_deg", [0.0, 100.0, 179.0, 180.0, -90.0])
def test_a_sensor_that_sees_all_round_has_no_edge(bearing_deg: float) -> None:
    assert in_full_view([ahead(bearing_deg, 8.0)], body(), 2.0 * math.pi, RANGE_M) == [True]


@pytest.mark.parametrize("count", [0, BOXES_MAX + 1])
def test_frames_without_boxes_or_with_too_many_are_not_looked_through(count: int) -> None:
    assert in_full_view([ahead(0.0, 8.0)] * count, body(), VIEW_RAD, RANGE_M) == [False] * count
