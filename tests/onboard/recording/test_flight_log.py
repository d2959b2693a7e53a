"""The flight log as the official readers see it, whatever happens to the writer."""

from __future__ import annotations

import hashlib
import json
import logging
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import SummaryOffset
from mcap.stream_reader import StreamReader
from pymavlink.dialects.v20 import common as mavlink

from gcs_tools.logs.flight_log import read_log
from onboard.recording.flight_log import FORMAT_VERSION, FlightLog
from onboard.recording.messages import EventRecord, Margins, StateRecord
from onboard.recording.rotation import LogRotation
from onboard.recording.writer_thread import LogThread

EPOCH_S = 1_790_000_000.0


def state(number: int, noise: str = "") -> StateRecord:
    time_s = EPOCH_S + number * 0.02
    return StateRecord(time_s=time_s, obstacles_known=number, position_doubt=noise)


def noise_of(number: int) -> str:
    """Text that does not compress, so that a log of it has several chunks."""
    return hashlib.sha256(str(number).encode()).hexdigest() * 2


def heartbeat(sequence: int) -> bytes:
    packer = mavlink.MAVLink(None, 1, 1)
    packer.seq = sequence
    packed: bytes = packer.heartbeat_encode(2, 12, 0, 0, 4).pack(packer)
    return packed


def test_the_official_reader_finds_every_message_and_the_metadata(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {"seed": "7"}) as log:
        for number in range(500):
            log.write([state(number)])
        log.write_mavlink("received", EPOCH_S, heartbeat(0))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        read = [(channel.topic, message) for _, channel, message in reader.iter_messages()]
        (metadata,) = reader.iter_metadata()
    numbers = [json.loads(m.data)["obstacles_known"] for topic, m in read if topic == "/state"]
    assert numbers == list(range(500))
    assert [m.data for topic, m in read if topic == "/mavlink/received"] == [heartbeat(0)]
    assert metadata.metadata["seed"] == "7"
    assert metadata.metadata["format_version"] == str(FORMAT_VERSION)
    assert metadata.metadata["version_clearway"]


def test_the_same_records_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        with FlightLog(tmp_path / name, {"seed": "1"}) as log:
            log.write(state(number) for number in range(1000))
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_killed_writer_leaves_all_but_its_last_second(tmp_path: Path) -> None:
    # As long as what a tick leaves behind.
    program = """if True:
        import os, signal, sys
        from pathlib import Path
        from onboard.recording.messages import StateRecord
        from onboard.recording.flight_log import FlightLog
        log = FlightLog(Path(sys.argv[1]), {})
        for number in range(1000):
            state = StateRecord(time_s=number * 0.02, obstacles_known=number, mode="x" * 500)
            log.write([state])
        os.kill(os.getpid(), signal.SIGKILL)
    """
    path = tmp_path / "flight.mcap"
    root = Path(__file__).parents[3]
    killed = subprocess.run([sys.executable, "-c", program, path], cwd=root, check=False)
    assert killed.returncode == -signal.SIGKILL
    log = read_log(path)
    assert not log.complete
    assert "breaks off" in log.problems[0]
    numbers = [state.obstacles_known for state in log.states]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 1000 - 60


def test_a_full_part_is_followed_by_one_that_says_again_what_lasts(tmp_path: Path) -> None:
    parts = LogRotation(tmp_path / "flight.mcap", part_bytes=20_000, kept=2)
    with FlightLog(parts, {"seed": "1"}) as log:
        margins = Margins(time_s=EPOCH_S, compliant=True, clauses=[])
        log.write([margins, EventRecord(time_s=EPOCH_S, text="once")])
        for number in range(4000):
            log.write([state(number, noise_of(number))])
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 2
    assert "flight.mcap" not in names
    states = []
    for path in sorted(tmp_path.iterdir(), key=lambda path: int(path.name.split(".")[1])):
        part = read_log(path)
        assert part.complete
        assert part.metadata["clearway"]["seed"] == "1"
        assert [margins.compliant for margins in part.margins] == [True]
        assert part.events == ()
        states += [each.obstacles_known for each in part.states]
    assert states == list(range(states[0], 4000))


def test_a_log_whose_next_part_cannot_be_opened_is_closed_all_the_same(tmp_path: Path) -> None:
    directory, moved = tmp_path / "flights", tmp_path / "moved"
    directory.mkdir()
    log = FlightLog(LogRotation(directory / "flight.mcap", part_bytes=1), {})
    directory.rename(moved)
    with pytest.raises(FileNotFoundError):
        log.write([state(0)])
    log.close()
    assert read_log(moved / "flight.mcap").complete


def test_a_log_of_another_flight_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").write_text("yesterday's")
    with pytest.raises(FileExistsError):
        FlightLog(LogRotation(tmp_path / "flight.mcap"), {})
    assert (tmp_path / "flight.mcap").read_text() == "yesterday's"


def test_parts_of_another_flight_are_passed_over_and_kept(tmp_path: Path) -> None:
    foreign = [tmp_path / f"flight.{number}.mcap" for number in (2, 4)]
    for path in foreign:
        path.write_text("yesterday's")
    with FlightLog(LogRotation(tmp_path / "flight.mcap", part_bytes=1, kept=2), {}) as log:
        for number in range(3):
            log.write([state(number)])
    assert [path.read_text() for path in foreign] == ["yesterday's"] * 2
    ours = sorted(path.name for path in tmp_path.iterdir() if path not in foreign)
    assert ours == ["flight.5.mcap", "flight.6.mcap"]


def test_a_damaged_chunk_ends_what_is_read_not_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        for number in range(3000):
            log.write([state(number, noise_of(number))])
    data = bytearray(path.read_bytes())
    # Within the compressed records of a chunk, not in what describes them.
    chunk = data.index(b"\x28\xb5\x2f\xfd", len(data) // 3)
    data[chunk + 1000 : chunk + 1064] = b"\xaa" * 64
    path.write_bytes(data)
    log_read = read_log(path)
    assert not log_read.complete
    assert 0 < len(log_read.states) < 3000


def test_schemas_are_named_and_mavlink_has_none(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        log.write([state(0), EventRecord(time_s=EPOCH_S)])
        log.write_mavlink("sent", EPOCH_S, heartbeat(0))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = {
        channel.topic: summary.schemas[channel.schema_id].name if channel.schema_id else None
        for channel in summary.channels.values()
    }
    assert schemas == {
        "/state": "clearway.state",
        "/events": "clearway.events",
        "/mavlink/sent": None,
    }


# ---------------------------------------------------------------------------- thread


def test_jobs_are_done_in_order_and_before_it_closes() -> None:
    done: list[int] = []
    with LogThread() as thread:
        for number in range(1000):
            thread.submit(lambda number=number: done.append(number))  # type: ignore[misc]  # bound
    assert done == list(range(1000))


def test_a_slow_disk_drops_lines_and_never_waits(caplog: pytest.LogCaptureFixture) -> None:
    started, release = threading.Event(), threading.Event()
    done: list[int] = []

    def block() -> None:
        started.set()
        release.wait()

    with LogThread(capacity=2) as thread:
        thread.submit(block)
        started.wait()
        for number in range(5):
            thread.submit(lambda number=number: done.append(number))  # type: ignore[misc]  # bound
        assert thread.dropped == 3
        release.set()
    assert done == [0, 1]
    assert "too slow" in caplog.text
    assert "dropped: 3" in caplog.text


def test_a_full_disk_ends_the_log_and_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    done: list[str] = []

    def fail() -> None:
        raise OSError(28, "No space left on device")

    with caplog.at_level(logging.ERROR), LogThread() as thread:
        thread.submit(fail)
        thread.submit(lambda: done.append("after"))
    assert done == []
    assert caplog.text.count("No space left on device") == 1


def test_every_record_type_is_valid_mcap(tmp_path: Path) -> None:
    """What `mcap doctor` checks: the stream parses with CRCs, and the summary agrees with it."""
    path = tmp_path / "flight.mcap"
    with FlightLog(path, {}) as log:
        log.write(
            state(number) if number % 3 else EventRecord(time_s=EPOCH_S + number * 0.02)
            for number in range(5000)
        )
    with path.open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
        kinds = [type(r).__name__ for r in records]
        file.seek(0)
        summary = make_reader(file).get_summary()
        readers = SeekingReader(file, validate_crcs=True), NonSeekingReader(file)
        with_index, without = (
            [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
            for reader in readers
            if not file.seek(0)
        )
    assert with_index == without
    offsets = [r for r in records if isinstance(r, SummaryOffset)]
    assert all(offset.group_length > 0 for offset in offsets)
    assert summary is not None
    assert summary.statistics is not None
    assert kinds[0] == "Header"
    assert kinds[-1] == "Footer"
    assert summary.statistics.message_count == kinds.count("Message") == 5000
    assert summary.statistics.chunk_count == len(summary.chunk_indexes)
