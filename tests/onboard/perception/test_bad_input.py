"""Every kind of bad input is counted, dropped, and said once, by the sensor's name and a reason."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from onboard.perception.intake import Refusal
from onboard.perception.ros2.point_cloud import POINTS_MAX
from tests.onboard.perception.ros2.encoding import attachment, laser_scan, point_cloud
from tests.onboard.perception.ros2.encoding import scan_all_round as all_round
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S
from tests.onboard.perception.sources.test_mavlink_ranges import obstacle_distance
from tests.onboard.perception.test_sensor_channels import KEY, KINDS, KNOWN, Bench, source

POINTS = KNOWN.replace("/scan/", "/points/").replace("LaserScan", "PointCloud2")
POINTS = POINTS.rpartition("/")[0] + "/TypeHashNotSupported"


def scan(ranges_m: float = 5.0, **changes: Any) -> bytes:
    changes = {"stamp_unix_s": EPOCH_UNIX_S} | changes
    return all_round(np.full(360, ranges_m), **changes)


def cloud_of(count: int) -> bytes:
    """Return a cloud that says how many points it has, with their data."""
    data = np.zeros((count, 3), "<f4").tobytes()
    return point_cloud(
        np.zeros((1, 3)), stamp_unix_s=EPOCH_UNIX_S, data=data, width=count, step=12,
        row_step=12 * count,
    )  # fmt: skip


def zenoh(kind: str, payload: Callable[[], bytes], key: str = KNOWN) -> Callable[[Bench], None]:
    def send(bench: Bench) -> None:
        bench.channels.receive(kind, payload(), 0.0, key=key, attachment=attachment())

    return send


def link(payload: bytes) -> Callable[[Bench], None]:
    return lambda bench: bench.channels.receive_mavlink(330, payload, 0.1)


BAD = {
    "a type of another name": (
        zenoh("laserscan", scan, KEY.replace("LaserScan", "Image") + "x"), "another type"),
    "another definition": (zenoh("laserscan", scan, KEY + "RIHS01_00"), "unknown hash of the type"),
    "no CDR": (zenoh("laserscan", lambda: b"\x02\x01\0\0" + scan()[4:]), "not plain CDR"),
    "the other order of bytes said wrongly": (
        zenoh("laserscan", lambda: b"\x00\x00\0\0" + scan()[4:]), "string too long"),
    "cut off": (zenoh("laserscan", lambda: scan()[:30]), "truncated"),
    "cut off in its ranges": (
        zenoh("laserscan", lambda: scan()[:-9]), "sequence longer than the payload"),
    "more than the message": (zenoh("laserscan", lambda: scan() + bytes(9)), "bytes left over"),
    "an angle that is none": (
        zenoh("laserscan", lambda: scan(angle_min_rad=math.nan)), "not finite"),
    "ranges that are none": (zenoh("laserscan", lambda: scan(math.nan)), "mostly blind"),
    "no increment": (
        zenoh("laserscan", lambda: scan(angle_increment_rad=0.0)), "angle increment"),
    "limits the wrong way round": (
        zenoh("laserscan", lambda: scan(range_min_m=9.0, range_max_m=1.0)), "range limits"),
    "no beam": (zenoh("laserscan", lambda: laser_scan(())), "number of beams"),
    "a clock of another day": (
        zenoh("laserscan", lambda: scan(stamp_unix_s=EPOCH_UNIX_S - 86_400.0)),
        "no pose at its stamp"),
    "a simulation's clock": (
        zenoh("laserscan", lambda: scan(stamp_unix_s=12.0)), "no pose at its stamp"),
    "more than a million points": (
        zenoh("pointcloud2", lambda: cloud_of(POINTS_MAX + 1), POINTS), "number of points"),
    "points without coordinates": (
        zenoh("pointcloud2", lambda: cloud_of(POINTS_MAX)[:-5], POINTS),
        "sequence longer than the payload"),
    "sectors without a width": (link(obstacle_distance({}, increment=0)), "increment"),
    "sectors of a width that is none": (
        link(obstacle_distance({}, increment=0, increment_f=math.nan)), "increment"),
    "sectors from nowhere": (link(obstacle_distance({}, angle_offset=math.inf)), "angle offset"),
    "sectors of an unknown frame": (link(obstacle_distance({}, frame=3)), "coordinate frame"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_it_is_counted_dropped_and_said_once(name: str) -> None:
    send, reason = BAD[name]
    bench = Bench(*(source(kind) for kind in KINDS))
    for _ in range(2):
        send(bench)
        assert bench.sources_taken() == []
    (refusal,) = bench.channels.take_news()
    assert refusal.reason == reason
    assert bench.channels.sensors[refusal.sensor].input.refused == {reason: 2}
    assert bench.counters.malformed_frames == 2
    send(bench)
    bench.sources_taken()
    assert bench.channels.take_news() == []


def test_an_unknown_frame_id_is_said_by_name() -> None:
    bench = Bench(source("laserscan", "front", frame_id="laser"))
    for frame_id in ("laser", "odom", "odom"):
        zenoh("front", lambda frame_id=frame_id: scan(frame_id=frame_id))(bench)  # type: ignore[misc]  # bound now
    assert bench.sources_taken() == ["front"]
    assert bench.channels.take_news() == [Refusal("front", "another frame_id")]


def test_the_other_order_of_bytes_is_read_alike() -> None:
    frames = []
    for order in "<>":
        bench = Bench(source("laserscan"))
        zenoh("laserscan", lambda order=order: scan(order=order))(bench)  # type: ignore[misc]  # bound now
        frames += list(bench.channels.take(EPOCH_UNIX_S))
    assert frames[0] == frames[1]


def test_a_million_points_are_read() -> None:
    bench = Bench(source("pointcloud2", no_return_is_free_to_m=8.0))
    zenoh("pointcloud2", lambda: cloud_of(POINTS_MAX), POINTS)(bench)
    assert bench.sources_taken() == ["pointcloud2"]
    assert bench.channels.take_news() == []
