"""What each fault makes of the frames between sensor and service."""

import json
from typing import Any

import pytest

from sitl.environment.sensor_message import ZenohMessage
from sitl.virtual.faults.detections import EDITS, KINDS, DetectionFaults
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind
from tests.sitl.virtual.faults.frames import HERE_NED_M, arriving, frame, present, two_boxes


def changed(
    kind: FaultKind, amount: float | None = None, payload: bytes | None = None
) -> list[Any]:
    """Return the parsed frames that arrive of one."""
    faults = DetectionFaults(present(kind, amount))
    return [json.loads(data) for data in arriving(faults, [payload or frame()])]


@pytest.mark.parametrize(
    ("kind", "amount", "path", "expected"),
    [
        ("detections_short_range", 5.0, ("range_m",), 5.0),
        ("detections_short_range", 50.0, ("range_m",), 12.0),
        ("detections_short_range", 5.0, ("obstacles",), []),
        ("detections_narrow_view", 60.0, ("field_of_view_deg",), 60.0),
        ("detections_narrow_view", 200.0, ("field_of_view_deg",), 120.0),
        ("detections_uncertain", 0.2, ("obstacles", 0, "uncertainty_m"), 0.2),
        ("detections_shifted", 0.03, ("obstacles", 0, "center_m", 1), pytest.approx(0.97)),
        ("detections_oversized", 3.0, ("obstacles", 0, "size_m"), [3.0, 6.0]),
        (
            "detections_wrong_units",
            0.001,
            ("obstacles", 0, "center_m"),
            pytest.approx([0.018, 0.001]),
        ),
        ("detections_wrong_units", 0.001, ("range_m",), pytest.approx(0.012)),
        ("detections_ghost", 9.0, ("obstacles", 1, "center_m"), [19.0, 0.0]),
        ("detections_renamed", None, ("obstacles", 0, "id"), "1-0"),
        ("detections_hidden", 5.0, ("obstacles",), []),
        ("detections_hidden", 5.0, ("range_m",), 12.0),
        ("sensor_clock_ahead", 5.0, ("stamp_unix_s",), 105.0),
        ("detections_split", None, ("obstacles", 0, "center_m"), [17.75, 1.0]),
        ("detections_split", None, ("obstacles", 1, "size_m"), [0.5, 2.0]),
        ("detections_wrong_frame", None, ("frame",), "body_frd"),
        ("position_reset", 3.0, ("obstacles", 0, "center_m"), [18.0, 4.0]),
    ],
)
def test_frames_change_as_named(
    kind: FaultKind, amount: float | None, path: tuple[str | int, ...], expected: object
) -> None:
    (value,) = changed(kind, amount)
    found: Any = value
    for key in path:
        found = found[key]
    assert found == expected


@pytest.mark.parametrize("kind", sorted(EDITS))
def test_an_edit_keeps_a_frame_without_obstacles_whole(kind: FaultKind) -> None:
    empty = json.dumps({**json.loads(frame()), "obstacles": []}).encode()
    (value,) = changed(kind, payload=empty)
    assert value.keys() == json.loads(frame()).keys()


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_without_faults_frames_pass_untouched(kind: FaultKind) -> None:
    schedule = FaultSchedule((Fault(kind=kind, start_s=1.0),), seed=1)
    schedule.advance(0.5, "cruise")
    payloads = [frame(), b"not even JSON"]
    assert arriving(DetectionFaults(schedule), payloads) == payloads


def test_body_frames_are_hidden_and_haunted_relative_to_the_body() -> None:
    near = frame((4.0, 0.0), "body_frd")
    (kept,) = changed("detections_hidden", 5.0, near)
    assert len(kept["obstacles"]) == 1
    (haunted,) = changed("detections_ghost", 9.0, near)
    assert haunted["obstacles"][1]["center_m"] == [9.0, 0.0]
    (declared,) = changed("detections_wrong_frame", None, near)
    assert declared["frame"] == "local_ned"


def test_a_reset_estimate_does_not_move_what_is_measured_in_the_body_frame() -> None:
    (value,) = changed("position_reset", 3.0, frame((4.0, 0.0), "body_frd"))
    assert value["obstacles"][0]["center_m"] == [4.0, 0.0]


def test_merged_boxes_are_enclosed_by_one() -> None:
    (value,) = changed("detections_merged", payload=two_boxes())
    (merged,) = value["obstacles"]
    assert merged["center_m"] == pytest.approx([18.0, 5.0])
    assert merged["size_m"][1] >= 8.0 + 2.0


def test_a_single_box_has_nothing_to_merge_with() -> None:
    assert changed("detections_merged") == [json.loads(frame())]


def test_the_halves_of_a_turned_box_lie_along_its_axis() -> None:
    seen = json.loads(frame((10.0, 0.0)))
    seen["obstacles"][0].update(yaw_deg=90.0, size_m=[4.0, 1.0])
    (value,) = changed("detections_split", payload=json.dumps(seen).encode())
    centers_m = [half["center_m"] for half in value["obstacles"]]
    assert centers_m == [pytest.approx([10.0, -1.0]), pytest.approx([10.0, 1.0])]


def test_swapped_boxes_exchange_their_names() -> None:
    faults = DetectionFaults(present("detections_swapped"))
    names = []
    for _ in range(2):
        (data,) = arriving(faults, [two_boxes()])
        names.append([box["id"] for box in json.loads(data)["obstacles"]])
    assert sorted(names) == [["1", "2"], ["2", "1"]]


def test_names_change_every_fifth_frame() -> None:
    faults = DetectionFaults(present("detections_renamed"))
    names = []
    for _ in range(12):
        (data,) = arriving(faults, [frame()])
        names.append(json.loads(data)["obstacles"][0]["id"])
    assert names == ["1-0"] * 4 + ["1-1"] * 5 + ["1-2"] * 3


def test_a_skewed_clock_runs_away_and_starts_again_with_the_next_fault() -> None:
    windows = (
        Fault(kind="sensor_clock_skewed", start_s=1.0, duration_s=2.5, amount=0.1),
        Fault(kind="sensor_clock_skewed", start_s=5.0, amount=0.1),
    )
    schedule = FaultSchedule(windows, seed=1)
    faults, stamps = DetectionFaults(schedule), []
    for now_s in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0):
        schedule.advance(now_s, "cruise")
        (data,) = arriving(faults, [frame()])
        stamps.append(json.loads(data)["stamp_unix_s"])
    assert stamps == pytest.approx([100.0, 100.1, 100.2, 100.0, 100.0, 100.1])


def test_a_stuck_sensor_repeats_the_last_frame_before_the_fault() -> None:
    schedule = FaultSchedule((Fault(kind="detections_stuck", start_s=1.0, duration_s=1.0),), seed=1)
    faults, arrived = DetectionFaults(schedule), []
    for step in range(6):
        schedule.advance(step * 0.5, "cruise")
        arrived += arriving(faults, [b"%d" % step])
    assert arrived == [b"0", b"1", b"1", b"1", b"4", b"5"]


def test_a_sensor_stuck_from_the_start_repeats_its_first_frame() -> None:
    faults = DetectionFaults(present("detections_stuck"))
    assert [arriving(faults, [b"%d" % step]) for step in range(3)] == [[b"0"]] * 3


def test_a_sensor_that_is_off_sends_nothing() -> None:
    assert changed("detections_off") == []


def test_a_declared_range_that_is_no_number_is_still_json_to_python() -> None:
    (value,) = changed("detections_nan")
    assert value["range_m"] != value["range_m"]


def test_garbage_is_seeded() -> None:
    sent = [DetectionFaults(present("detections_garbage")) for _ in range(2)]
    first, second = ([arriving(one, [frame()]) for _ in range(20)] for one in sent)
    assert first == second
    assert len({data for (data,) in first}) > 10
    assert all(len(data) < 400 for (data,) in first)


def test_an_intermittent_sensor_loses_its_share_of_frames() -> None:
    faults = DetectionFaults(present("detections_intermittent", 0.25))
    arrived = sum(len(arriving(faults, [frame()])) for _ in range(1000))
    assert 700 < arrived < 800


def test_a_slow_sensor_lets_one_frame_in_four_through() -> None:
    faults = DetectionFaults(present("detections_slow"))
    heard = [arriving(faults, [frame()]) for _ in range(40)]
    assert sum(map(len, heard)) == 10


def test_late_frames_arrive_late_and_in_order() -> None:
    schedule = FaultSchedule((Fault(kind="detections_late", amount=0.1),), seed=1)
    faults, heard = DetectionFaults(schedule), []
    for step in range(20):
        schedule.advance(step * 0.05, "cruise")
        sent = [b"%d" % step] if step < 5 else []
        heard.append([int(data) for data in arriving(faults, sent)])
    assert heard[:8] == [[], [], [0], [1], [2], [3], [4], []]


def test_frames_in_the_queue_are_not_overtaken_when_the_delay_ends() -> None:
    fault = Fault(kind="detections_late", duration_s=0.3, amount=0.5)
    schedule = FaultSchedule((fault,), seed=1)
    faults, heard = DetectionFaults(schedule), []
    for step in range(10):
        schedule.advance(step * 0.1, "cruise")
        heard += arriving(faults, [b"%d" % step])
    assert heard == [b"%d" % step for step in range(10)]


def test_a_frame_out_of_order_follows_the_next() -> None:
    faults = DetectionFaults(present("detections_out_of_order", 1.0))
    one, other = frame((1.0, 0.0)), frame((2.0, 0.0))
    assert arriving(faults, [one, other]) == [other, one]


def test_edits_of_two_faults_add_up() -> None:
    kinds: tuple[FaultKind, ...] = ("detections_oversized", "detections_uncertain")
    schedule = FaultSchedule(tuple(Fault(kind=kind) for kind in kinds), seed=1)
    schedule.advance(0.0, "cruise")
    (data,) = arriving(DetectionFaults(schedule), [frame()])
    (box,) = json.loads(data)["obstacles"]
    assert (box["size_m"], box["uncertainty_m"]) == ([3.0, 6.0], 0.15)


def test_what_is_not_json_is_lost_and_garbled_but_not_edited() -> None:
    scan = ZenohMessage("lidar", b"\x00\x01\x00\x00...", "0/scan/type/hash", b"attached")
    assert DetectionFaults(present("detections_ghost")).arriving([scan], HERE_NED_M) == [scan]
    assert DetectionFaults(present("detections_off")).arriving([scan], HERE_NED_M) == []
    (garbled,) = DetectionFaults(present("detections_garbage")).arriving([scan], HERE_NED_M)
    assert garbled.payload != scan.payload
    assert garbled._replace(payload=scan.payload) == scan
