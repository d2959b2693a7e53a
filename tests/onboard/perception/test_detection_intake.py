"""Messages wait, are decoded in order, and never raise."""

import json
from collections.abc import Sequence

import pytest

from onboard.perception.detection import MAX_PENDING_FRAMES, DetectionFrame
from onboard.perception.intake import DetectionIntake, Refusal
from onboard.perception.sources.json_v1 import JsonV1Source
from tests.onboard.perception.messages import detection_frame, frame

NOW_UNIX_S = 1_790_000_001.0


class SplitSource:
    """A sensor whose frames come in two messages; `!` is malformed, `*` two frames at once."""

    def __init__(self) -> None:
        self.malformed = 0
        self.read_unix_s: list[float] = []
        self._parts: list[bytes] = []

    def read(self, payload: bytes, now_unix_s: float) -> Sequence[DetectionFrame]:
        self.read_unix_s.append(now_unix_s)
        if payload == b"!":
            self.malformed += 1
            return ()
        if payload == b"*":
            return detection_frame(sequence=1), detection_frame(sequence=2)
        self._parts.append(payload)
        if len(self._parts) < 2:
            return ()
        source = b"".join(self._parts).decode()
        self._parts.clear()
        return (detection_frame(source=source, stamp_unix_s=now_unix_s),)


def test_frames_come_in_the_order_of_their_arrival() -> None:
    intake = DetectionIntake(JsonV1Source())
    for sequence in (3, 1, 2):
        intake.receive(json.dumps(frame(sequence=sequence)).encode())
    assert [read.sequence for read in intake.take(NOW_UNIX_S)] == [3, 1, 2]
    assert list(intake.take(NOW_UNIX_S)) == []


def test_what_is_malformed_is_counted_and_takes_no_frame_with_it() -> None:
    intake = DetectionIntake(JsonV1Source())
    for payload in (b"", b"\xff\xfe", json.dumps(frame()).encode(), b"[]", b"{}"):
        intake.receive(payload)
    assert len(list(intake.take(NOW_UNIX_S))) == 1
    assert intake.counters.malformed_frames == 4
    assert intake.counters.dropped_frames == 0


@pytest.mark.parametrize("excess", [0, 1, 100])
def test_of_a_flood_the_oldest_are_dropped_and_counted(excess: int) -> None:
    intake = DetectionIntake(JsonV1Source())
    for sequence in range(MAX_PENDING_FRAMES + excess):
        intake.receive(json.dumps(frame(sequence=sequence)).encode())
    taken = [read.sequence for read in intake.take(NOW_UNIX_S)]
    assert taken == list(range(excess, MAX_PENDING_FRAMES + excess))
    assert intake.counters.dropped_frames == excess


def test_what_is_not_read_now_waits_for_the_next_tick() -> None:
    """A defect in what takes the frames must not lose those behind."""
    intake = DetectionIntake(JsonV1Source())
    for sequence in (1, 2):
        intake.receive(json.dumps(frame(sequence=sequence)).encode())
    assert next(intake.take(NOW_UNIX_S)).sequence == 1
    assert [read.sequence for read in intake.take(NOW_UNIX_S)] == [2]


def test_a_source_may_need_several_messages_for_a_frame_and_the_time_for_its_stamp() -> None:
    source = SplitSource()
    intake = DetectionIntake(source)
    intake.receive(b"li")
    assert list(intake.take(1.0)) == []
    intake.receive(b"!")
    intake.receive(b"dar")
    (read,) = intake.take(2.0)
    assert (read.source, read.stamp_unix_s) == ("lidar", 2.0)
    assert source.read_unix_s == [1.0, 2.0, 2.0]
    assert intake.counters.malformed_frames == 1


def test_a_source_may_complete_several_frames_with_one_message() -> None:
    intake = DetectionIntake(SplitSource())
    intake.receive(b"*")
    assert [read.sequence for read in intake.take(NOW_UNIX_S)] == [1, 2]


def test_a_frame_under_the_name_of_another_sensor_is_dropped() -> None:
    intake = DetectionIntake(JsonV1Source())
    intake.names_taken = frozenset({"front"})
    for source in ("front", "rear", "front"):
        intake.receive(json.dumps(frame(source=source)).encode())
    assert [read.source for read in intake.take(NOW_UNIX_S)] == ["rear"]
    assert intake.counters.malformed_frames == 2
    assert intake.take_news() == [Refusal("front", "detections as JSON come under its name")]
    assert intake.take_news() == []
