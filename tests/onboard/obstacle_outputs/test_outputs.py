"""What is sent after each tick: nothing unless asked for, at its rate, to the one that is meant."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.daemon_config import DaemonConfig, ObstacleOutputs
from onboard.mavlink.transmitter import Transmitter
from onboard.obstacle_outputs.outputs import ObstaclePublisher, Shown
from onboard.perception.ros2.cdr import CdrReader
from onboard.recording.messages import KnownObstacle, Obstacles, Record, StateRecord
from onboard.recording.mover_record import KnownMover, MoversRecord

URL = "udpout://127.0.0.1:14550"
MAP = Obstacles(
    time_s=1.0,
    height_m=4.0,
    obstacles=[
        KnownObstacle(id="a", measured_ned_m=[(4.5, -0.5), (5.5, -0.5), (5.5, 0.5), (4.5, 0.5)])
    ],
)


class Bench:
    def __init__(self, **outputs: Any) -> None:
        config = ObstacleOutputs.model_validate(outputs)
        self.vehicle_link = Transmitter(1)
        self.publisher = ObstaclePublisher(config, 1, self.vehicle_link)

    def run(self, seconds: float, *first: Record, yaw_rad: float | None = 0.0) -> list[Shown]:
        """Collect the records of every tick; those that are given in the first one."""
        shown = []
        for tick in range(round(seconds * 50)):
            state = StateRecord(
                time_s=1.0 + tick / 50.0, position_ned_m=(0.0, 0.0, -4.0), yaw_rad=yaw_rad
            )
            records = [state, *first] if tick == 0 else [state]
            shown.append(self.publisher.collect(records, tick / 50.0))
        return shown


def messages(data: bytes, kind: str) -> list[Any]:
    found = mavlink.MAVLink(None).parse_buffer(data) or []
    return [each for each in found if each.get_type() == kind]


def test_nothing_is_sent_unless_it_is_asked_for() -> None:
    bench = Bench()
    assert set(bench.run(2.0, MAP)) == {Shown(b"", None)}
    assert bench.vehicle_link.bytes_to_send() == b""


def test_a_ground_station_gets_sectors_at_their_rate_and_heartbeats() -> None:
    bench = Bench(obstacle_distance={"url": URL, "rate_hz": 4.0})
    data = b"".join(each.to_ground for each in bench.run(2.0, MAP))
    sectors = messages(data, "OBSTACLE_DISTANCE")
    assert len(sectors) == 8
    assert len(messages(data, "HEARTBEAT")) == 2
    message = sectors[-1]
    assert message.distances[0] == 450
    assert message.distances[36] == 65535
    assert (message.frame, message.increment, message.increment_f) == (12, 5, 5.0)
    assert (message.max_distance, message.angle_offset) == (6000, 0.0)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 196)
    assert bench.vehicle_link.bytes_to_send() == b""  # the autopilot gets none


def test_movers_are_sectors_too_where_each_may_be_by_now() -> None:
    """A box seen 4 m ahead at 1 m/s comes nearer by 1 cm in 10 ms, without another sighting."""
    box = [(4.0, -0.5), (5.0, -0.5), (5.0, 0.5), (4.0, 0.5)]
    walker = KnownMover(id="ring/1", seen_s=1.0, speed_max_mps=1.0, box_ned_m=box)
    movers = MoversRecord(time_s=1.0, stamp_error_s=0.1, movers=[walker])
    bench = Bench(obstacle_distance={"url": URL, "rate_hz": 4.0})
    data = b"".join(each.to_ground for each in bench.run(2.0, movers, MAP))
    ahead_cm = [message.distances[0] for message in messages(data, "OBSTACLE_DISTANCE")]
    assert ahead_cm == pytest.approx([390 - 26 * index for index in range(8)], abs=2)
    bench = Bench(obstacle_distance={"url": URL, "rate_hz": 4.0})
    gone = MoversRecord(time_s=1.1)
    data = b"".join(each.to_ground for each in bench.run(1.0, movers, gone, MAP))
    assert messages(data, "OBSTACLE_DISTANCE")[-1].distances[0] == 450


def test_the_autopilot_gets_them_only_where_that_is_asked_for() -> None:
    bench = Bench(obstacle_distance={"through_autopilot": True})
    assert {each.to_ground for each in bench.run(1.0, MAP)} == {b""}
    assert len(messages(bench.vehicle_link.bytes_to_send(), "OBSTACLE_DISTANCE")) == 2


def test_without_a_pose_no_bearing_is_known() -> None:
    bench = Bench(obstacle_distance={"url": URL})
    data = b"".join(each.to_ground for each in bench.run(1.0, MAP, yaw_rad=None))
    assert messages(data, "OBSTACLE_DISTANCE") == []
    assert len(messages(data, "HEARTBEAT")) == 1


def test_markers_come_at_their_rate_with_the_map_as_it_is() -> None:
    bench = Bench(markers={"rate_hz": 5.0})
    payloads = [each.markers for each in bench.run(1.0, MAP) if each.markers is not None]
    assert len(payloads) == 5
    assert [CdrReader(each).u32() for each in payloads] == [2] * 5
    empty = Obstacles(time_s=2.0, obstacles=[])
    gone = bench.publisher.collect([StateRecord(time_s=3.0), empty], 2.0).markers
    assert gone is not None
    assert CdrReader(gone).u32() == 1


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ({}, "either url or through_autopilot"),
        ({"url": URL, "through_autopilot": True}, "either url or through_autopilot"),
        ({"url": URL, "rate_hz": 50.0}, "rate_hz"),
    ],
)
def test_outputs_that_make_no_sense(shown: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ObstacleOutputs.model_validate({"obstacle_distance": shown})


def test_the_daemon_never_reads_its_own_map_as_a_sensor() -> None:
    source = {"kind": "obstacle_distance", "name": "p", "range_m": 5.0, "uncertainty_m": 0.1}
    document = {"contract": "c", "mission": "m", "sources": [source]}
    looped = {"outputs": {"obstacle_distance": {"through_autopilot": True}}}
    with pytest.raises(ValidationError, match="'p' would read it back"):
        DaemonConfig.model_validate(document | looped)
    beside = {"outputs": {"obstacle_distance": {"url": URL}}}
    assert DaemonConfig.model_validate(document | beside).outputs.obstacle_distance is not None
