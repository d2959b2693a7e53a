"""Keys and attachments of rmw_zenoh and of the DDS bridge."""

import struct

import pytest
import zenoh

from onboard.perception.ros2.cdr import DecodeError
from onboard.perception.ros2.keys import (
    REPLACED_AFTER_S,
    TYPE_HASHES,
    OnePublisher,
    check_key,
    decode_attachment,
    key_expression,
)
from tests.onboard.perception.ros2.encoding import attachment

SCAN = "sensor_msgs/LaserScan"
PUBLISHED = "0/robot/scan/sensor_msgs::msg::dds_::LaserScan_/"
A, B = b"a" * 16, b"b" * 16


def test_the_key_expression_meets_what_rmw_zenoh_publishes() -> None:
    key = zenoh.KeyExpr(key_expression("/robot/scan", SCAN, bridged=False, domain=0))
    for hash_name in ("TypeHashNotSupported", f"RIHS01_{TYPE_HASHES[SCAN][0]}"):
        assert key.intersects(zenoh.KeyExpr(PUBLISHED + hash_name))
    assert not key.intersects(zenoh.KeyExpr("1" + PUBLISHED[1:] + "TypeHashNotSupported"))
    assert not key.intersects(zenoh.KeyExpr(PUBLISHED.replace("scan", "other") + "x"))


def test_the_bridge_publishes_under_the_topic() -> None:
    assert key_expression("/robot/scan", SCAN, bridged=True, domain=7) == "robot/scan"


@pytest.mark.parametrize("type_name", TYPE_HASHES)
def test_known_hashes_pass(type_name: str) -> None:
    package, name = type_name.split("/")
    for each in TYPE_HASHES[type_name]:
        assert len(bytes.fromhex(each)) == 32
        check_key(f"0/topic/{package}::msg::dds_::{name}_/RIHS01_{each}", type_name)


@pytest.mark.parametrize(
    ("key", "reason"),
    [
        (PUBLISHED + "RIHS01_" + "0" * 64, "unknown hash"),
        (PUBLISHED + "RIHS02_" + TYPE_HASHES[SCAN][0], "unknown hash"),
        ("0/scan/sensor_msgs::msg::dds_::Range_/TypeHashNotSupported", "another type"),
        ("scan", "another type"),
        ("", "another type"),
    ],
)
def test_another_type_or_definition_is_refused(key: str, reason: str) -> None:
    check_key(PUBLISHED + "TypeHashNotSupported", SCAN)
    with pytest.raises(DecodeError, match=reason):
        check_key(key, SCAN)


def test_the_attachment_in_both_layouts() -> None:
    plain = attachment(A, 7, 1_500_000_000)
    named = b"".join(
        bytes((len(name),)) + name + value
        for name, value in (
            (b"sequence_number", plain[:8]),
            (b"source_timestamp", plain[8:16]),
            (b"source_gid", plain[16:]),
        )
    )
    assert (len(plain), len(named)) == (33, 77)
    assert decode_attachment(plain) == decode_attachment(named) == (7, 1.5, A)


@pytest.mark.parametrize(
    "data",
    [b"", b"\x00" * 32, b"\x00" * 33, b"\x00" * 34, struct.pack("<qqB", 1, 1, 16) + b"a" * 17],
)
def test_another_attachment_is_refused(data: bytes) -> None:
    with pytest.raises(DecodeError, match="attachment"):
        decode_attachment(data)


def test_of_two_publishers_the_first_is_heard() -> None:
    gate = OnePublisher()
    gate.check(attachment(A), 0.0)
    with pytest.raises(DecodeError, match="two publishers"):
        gate.check(attachment(B), 0.1)
    gate.check(attachment(A), 0.2)


def test_a_publisher_that_restarts_is_heard_after_a_pause() -> None:
    gate = OnePublisher()
    gate.check(attachment(A), 0.0)
    gate.check(attachment(B), REPLACED_AFTER_S + 0.01)
    with pytest.raises(DecodeError, match="two publishers"):
        gate.check(attachment(A), REPLACED_AFTER_S + 0.02)


def test_a_bridge_attaches_nothing() -> None:
    gate = OnePublisher()
    gate.check(b"", 0.0)
    gate.check(b"", 0.1)
