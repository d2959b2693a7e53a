"""Bags of SQLite and MCAP, in folders and alone, whole, compressed and damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.replay.recording import MAVLINK, RecordedMessage, open_recording
from onboard.recording.flight_log import FlightLog
from tests.gcs_tools.replay.bags import Message, drive, write_bag, write_mcap, write_sqlite
from tests.onboard.perception.sources.scenes import EPOCH_UNIX_S

DRIVE = drive(0.5)
# Longer than a chunk of MCAP, of which nothing is read unless it is whole.
LONG = [each for _ in range(4) for each in drive(12.0)]
TOPICS = {"/odom": "nav_msgs/Odometry", "/scan": "sensor_msgs/LaserScan"}


def read(path: Path) -> list[RecordedMessage]:
    return list(open_recording(path).messages())


def same(found: list[RecordedMessage], expected: list[Message]) -> None:
    assert [(each.topic, each.payload) for each in found] == [
        (each.topic, each.payload) for each in expected
    ]
    assert [each.time_unix_s - EPOCH_UNIX_S for each in found] == pytest.approx(
        [each.time_s for each in expected], abs=1e-6
    )


@pytest.mark.parametrize("form", ["db3", "mcap", "folder", "parts", "no metadata", "compressed"])
def test_every_form_of_a_recording_is_read_in_order(tmp_path: Path, form: str) -> None:
    half = len(DRIVE) // 2
    match form:
        case "db3":
            path = write_sqlite(tmp_path / "a.db3", DRIVE)
        case "mcap":
            path = write_mcap(tmp_path / "a.mcap", DRIVE)
        case "folder":
            path = write_bag(tmp_path / "bag", DRIVE)
        case "parts":
            path = write_bag(tmp_path / "bag", DRIVE[:half], DRIVE[half:])
        case "no metadata":
            path = tmp_path / "bag"
            write_bag(path, DRIVE)
            (path / "metadata.yaml").unlink()
        case _:
            path = write_bag(tmp_path / "bag", DRIVE, compressed=True, mode="MESSAGE")
    assert open_recording(path).topics == TOPICS
    same(read(path), DRIVE)


def test_a_compressed_file_alone_is_read_by_the_metadata_beside_it(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", DRIVE, compressed=True, mode="MESSAGE")
    same(read(bag / "bag_0.db3"), DRIVE)


def test_the_mavlink_of_our_own_log(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        log.write_mavlink("received", EPOCH_UNIX_S, b"abc")
    recording = open_recording(path)
    assert recording.topics == {"/mavlink/received": MAVLINK}
    assert list(recording.messages()) == [
        RecordedMessage(EPOCH_UNIX_S, "/mavlink/received", MAVLINK, b"abc")
    ]


def test_a_file_that_is_cut_is_read_up_to_there(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", LONG)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    recording = open_recording(path)
    assert recording.topics == TOPICS
    found = list(recording.messages())
    assert 0 < len(found) < len(LONG)
    (problem,) = recording.problems
    assert "damaged from here on" in problem


def test_a_message_that_cannot_be_decompressed_is_left_out(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", DRIVE, mode="MESSAGE")
    recording = open_recording(bag)
    assert list(recording.messages()) == []
    assert recording.problems[0] == "a message cannot be decompressed"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.mcap", b"no mcap at all", "is not an MCAP file"),
        ("a.db3", b"no database at all, but long enough to be one" * 20, "is not a bag of SQLite"),
        ("a.bag", b"#ROSBAG V2.0", "expected a bag's folder, a file .db3 or .mcap"),
        ("a.db3.zstd", b"", "zstd -d a.db3.zstd"),
    ],
)
def test_what_is_no_recording_is_refused(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(CommandError, match=words):
        open_recording(path)


def test_what_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="No such file"):
        open_recording(tmp_path / "a.mcap")
    with pytest.raises(CommandError, match=r"neither metadata\.yaml nor"):
        open_recording(tmp_path)
    bag = write_bag(tmp_path / "bag", DRIVE)
    (bag / "bag_0.db3").unlink()
    with pytest.raises(CommandError, match=r"bag_0\.db3: cannot be read"):
        open_recording(bag)
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}\n")
    with pytest.raises(CommandError, match="names no file"):
        open_recording(bag)
    (bag / "metadata.yaml").write_text("{")
    with pytest.raises(CommandError, match="is not YAML"):
        open_recording(bag)
