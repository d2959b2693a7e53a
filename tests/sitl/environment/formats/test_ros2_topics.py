"""Keys, attachments and tokens, as the daemon reads them."""

from typing import get_args

import pytest

from onboard.perception.ros2.keys import check_key, decode_attachment, key_expression
from sitl.environment.formats.ros2_topics import Ros2Kind, Ros2Publisher, Ros2Topic

NAMES = {
    "laserscan": "sensor_msgs/LaserScan",
    "pointcloud2": "sensor_msgs/PointCloud2",
    "range": "sensor_msgs/Range",
}


@pytest.mark.parametrize("kind", get_args(Ros2Kind))
def test_the_key_names_a_type_that_the_daemon_knows(kind: Ros2Kind) -> None:
    publisher = Ros2Publisher(Ros2Topic(topic="/front/scan", domain_id=7), kind, "lidar")
    check_key(publisher.key, NAMES[kind])
    wanted = key_expression("front/scan", NAMES[kind], bridged=False, domain=7)
    assert publisher.key.startswith(wanted.removesuffix("**"))


def test_a_bridge_names_the_topic_alone_and_attaches_nothing() -> None:
    config = Ros2Topic(topic="/front/scan", middleware="zenoh-bridge-ros2dds")
    publisher = Ros2Publisher(config, "laserscan", "lidar")
    wanted = key_expression("/front/scan", NAMES["laserscan"], bridged=True, domain=0)
    assert publisher.key == wanted
    assert publisher.attachment(5.0) == b""
    assert publisher.token("1a") is None


def test_topic_and_frame_are_named_after_the_sensor_by_default() -> None:
    publisher = Ros2Publisher(Ros2Topic(), "laserscan", "lidar")
    assert publisher.key.startswith("0/lidar/")
    assert publisher.frame_id == "lidar"
    assert Ros2Publisher(Ros2Topic(frame_id="laser"), "range", "lidar").frame_id == "laser"


def test_each_sample_has_the_next_number_and_the_publisher_stays_the_same() -> None:
    lidar = Ros2Publisher(Ros2Topic(), "laserscan", "lidar")
    first, second = (decode_attachment(lidar.attachment(sent_s)) for sent_s in (5.0, 5.05))
    assert len(lidar.attachment(6.0)) == 33
    assert (first.sequence, second.sequence) == (1, 2)
    assert second.sent_unix_s == pytest.approx(5.05)
    assert first.publisher == second.publisher
    other = Ros2Publisher(Ros2Topic(), "laserscan", "rear")
    assert decode_attachment(other.attachment(5.0)).publisher != first.publisher


def test_the_token_lists_the_topic() -> None:
    token = Ros2Publisher(Ros2Topic(topic="/front/scan"), "laserscan", "lidar").token("1a2b")
    assert token is not None
    parts = token.split("/")
    assert parts[:9] == ["@ros2_lv", "0", "1a2b", "0", "1", "MP", "%", "%", "lidar"]
    assert parts[9:11] == ["%front%scan", "sensor_msgs::msg::dds_::LaserScan_"]
    assert parts[11].startswith("RIHS01_")
    assert parts[12] == "::,1:,:,:,,"
