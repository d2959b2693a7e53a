"""Tokens of the ROS 2 graph, as rmw_zenoh writes them."""

import pytest

from onboard.perception.ros2.graph import (
    Publisher,
    node_token,
    parse_publisher,
    publisher_token,
)
from onboard.perception.ros2.keys import TYPE_HASHES

HASH = "RIHS01_" + TYPE_HASHES["sensor_msgs/LaserScan"][0]
# Of a talker in a namespace, with a profile of sensor data.
TOKEN = (
    "@ros2_lv/7/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MP/%/%drone/rplidar/%drone%scan/"
    f"sensor_msgs::msg::dds_::LaserScan_/{HASH}/2::,5:,:,:,,"
)


def test_a_publisher_is_read() -> None:
    expected = Publisher(7, "/drone/scan", "sensor_msgs/LaserScan", HASH, "/drone/rplidar")
    assert parse_publisher(TOKEN) == expected


@pytest.mark.parametrize(
    "token",
    [
        TOKEN.replace("/MP/", "/MS/"),  # a subscription
        TOKEN.replace("@ros2_lv", "@other"),
        TOKEN.replace("/7/", "/seven/", 1),
        TOKEN.rpartition("/")[0],
        TOKEN + "/more",
        "",
    ],
)
def test_anything_else_is_none(token: str) -> None:
    assert parse_publisher(token) is None


def test_our_own_publisher_is_read_as_one_of_ros() -> None:
    key = f"3/clearway/obstacles/sensor_msgs::msg::dds_::LaserScan_/{HASH}"
    token = publisher_token("ab12", "clearway", key)
    assert parse_publisher(token) == Publisher(
        3, "/clearway/obstacles", "sensor_msgs/LaserScan", HASH, "/clearway"
    )
    node = node_token("ab12", "clearway", 3)
    assert node == "@ros2_lv/3/ab12/0/0/NN/%/%/clearway"
    assert parse_publisher(node) is None
