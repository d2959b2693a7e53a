"""Markers against bytes of another implementation, and their key and attachment."""

import math

from onboard.obstacle_outputs.markers import MARKERS_MAX, attachment, markers, markers_key
from onboard.perception.ros2.cdr import CdrReader
from onboard.perception.ros2.keys import decode_attachment
from onboard.recording.messages import KnownObstacle, Obstacles
from onboard.recording.mover_record import KnownMover, MoversRecord
from tests.onboard.perception.ros2.recorded import encoded

CORNERS = [(7.0, 2.5), (9.0, 2.5), (9.0, 3.5), (7.0, 3.5)]


def read_marker(reader: CdrReader) -> tuple[str, tuple[float, ...], str]:
    """Return namespace, size and text of the next marker."""
    reader.i32(), reader.u32(), reader.text()
    namespace = reader.text()
    reader.i32(), reader.i32(), reader.i32()
    numbers = [reader.f64() for _ in range(10)]
    for _ in range(4):
        reader.f32()
    reader.i32(), reader.u32(), reader.u8()
    reader.u32(), reader.u32(), reader.text()
    reader.i32(), reader.u32(), reader.text(), reader.text(), reader.u32()
    reader.u32()
    text = reader.text()
    reader.text(), reader.text(), reader.u32(), reader.u8()
    return namespace, tuple(numbers[7:]), text


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


def test_a_mover_is_drawn_where_it_may_be_by_now_and_with_its_reach() -> None:
    reach = [(2.0, -3.0), (14.0, -3.0), (14.0, 9.0), (2.0, 9.0)]
    walker = KnownMover(
        id="ring/1", kind="person", seen_s=1_790_000_000.0, speed_max_mps=2.0, box_ned_m=CORNERS,
        reach_ned_m=reach,
    )  # fmt: skip
    movers = MoversRecord(time_s=1_790_000_000.0, stamp_error_s=0.25, movers=[walker])
    reader = CdrReader(markers(known("tree"), "map", movers))
    assert reader.u32() == 4
    found = [read_marker(reader) for _ in range(4)]
    assert [each[0] for each in found] == [
        "clearway",
        "clearway/movers",
        "clearway/reach",
        "clearway",
    ]
    assert [each[2] for each in found] == ["", "ring/1 (person)", "ring/1 (person)", "tree"]
    # Half a second old at 2 m/s: a metre more on every side.
    assert found[1][1] == (4.0, 3.0, 4.0)
    assert found[2][1] == (12.0, 12.0, 4.0)


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
