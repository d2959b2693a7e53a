"""Markers against bytes of another implementation, and their key and attachment."""

import math

from onboard.obstacle_outputs.markers import MARKERS_MAX, attachment, markers, markers_key
from onboard.perception.ros2.cdr import CdrReader
from onboard.perception.ros2.keys import decode_attachment
from onboard.recording.messages import KnownObstacle, Obstacles
from tests.onboard.perception.ros2.recorded import encoded

CORNERS = [(7.0, 2.5), (9.0, 2.5), (9.0, 3.5), (7.0, 3.5)]


def known(*names: str) -> Obstacles:
    boxes = [KnownObstacle(id=name, measured_ned_m=CORNERS) for name in names]
    return Obstacles(time_s=1_790_000_000.25, height_m=4.0, obstacles=boxes)


def test_the_message_is_what_ros_would_send() -> None:
    """One that removes all, and a box 2 m north by 1 m east, around 8 m north, 3 m east."""
    assert [markers(known("lidar/1"), "map")] == encoded("visualization_msgs/MarkerArray", "le")


def test_an_empty_map_removes_what_was_shown() -> None:
    assert CdrReader(markers(known(), "map")).u32() == 1
    nowhere = Obstacles(time_s=1.0, obstacles=[KnownObstacle(id="a")])
    assert CdrReader(markers(nowhere, "map")).u32() == 1


def test_the_number_is_bounded() -> None:
    data = markers(known(*map(str, range(MARKERS_MAX + 5))), "map")
    assert CdrReader(data).u32() == MARKERS_MAX + 1


def test_key_and_attachment_are_those_of_the_middleware() -> None:
    key = markers_key("/a/b", bridged=False, domain=3)
    assert key.startswith("3/a/b/visualization_msgs::msg::dds_::MarkerArray_/RIHS01_86cb")
    assert markers_key("/a/b", bridged=True, domain=3) == "a/b"
    data = attachment(5, 1_790_000_000.25, b"p" * 16)
    assert len(data) == 33
    found = decode_attachment(data)
    assert (found.sequence, found.publisher) == (5, b"p" * 16)
    assert math.isclose(found.sent_unix_s, 1_790_000_000.25)
