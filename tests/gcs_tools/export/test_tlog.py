"""The .tlog derived from a flight log: as the daemon used to write it, and in pymavlink."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from gcs_tools.console.errors import CommandError
from gcs_tools.export.tlog import FrameSplitter, write_tlog
from onboard.recording.flight_log import Direction, FlightLog
from onboard.recording.messages import StateRecord
from onboard.recording.rotation import PART_BYTES, LogRotation
from tests.gcs_tools.running import Clearway

EPOCH_S = 1_790_000_000.0
Traffic = list[tuple[Direction, float, bytes]]


def heartbeat(sequence: int) -> bytes:
    packer = mavlink.MAVLink(None, 1, 1)
    packer.seq = sequence
    packed: bytes = packer.heartbeat_encode(2, 12, 0, 0, 4).pack(packer)
    return packed


def logged(path: Path, traffic: Traffic, part_bytes: int = PART_BYTES) -> None:
    with FlightLog(LogRotation(path, part_bytes), {}) as log:
        for direction, time_s, data in traffic:
            log.write([StateRecord(time_s=time_s)])
            log.write_mavlink(direction, time_s, data)


def written_in_flight(traffic: Traffic) -> bytes:
    """What the daemon wrote before the log held everything: each frame with its time in µs."""
    splitters = {"received": FrameSplitter(), "sent": FrameSplitter()}
    entries = [
        struct.pack(">Q", round(time_s * 1e6)) + frame
        for direction, time_s, data in traffic
        for frame in splitters[direction].split(data)
    ]
    return b"".join(entries)


def random_traffic(seed: int, count: int) -> Traffic:
    """Frames in portions that do not end where frames do, with noise between."""
    draw = random.Random(seed)
    streams: dict[Direction, bytes] = {
        "received": b"".join(heartbeat(n % 256) + draw.randbytes(n % 3) for n in range(count)),
        "sent": b"".join(heartbeat(n % 256) for n in range(count)),
    }
    traffic: Traffic = []
    time_s = EPOCH_S
    while any(streams.values()):
        direction = draw.choice([name for name, rest in streams.items() if rest])
        length = draw.randrange(1, 60)
        time_s += draw.random() * 0.01
        traffic.append((direction, time_s, streams[direction][:length]))
        streams[direction] = streams[direction][length:]
    return traffic


@pytest.mark.parametrize("seed", range(3))
def test_it_is_what_the_daemon_would_have_written_byte_for_byte(tmp_path: Path, seed: int) -> None:
    traffic = random_traffic(seed, 200)
    logged(tmp_path / "flight.mcap", traffic)
    count, problems = write_tlog([tmp_path / "flight.mcap"], tmp_path / "flight.tlog")
    assert count > 300
    assert problems == []
    assert (tmp_path / "flight.tlog").read_bytes() == written_in_flight(traffic)


def test_pymavlink_replays_it(tmp_path: Path) -> None:
    traffic: Traffic = [
        # Several frames in one datagram, one frame over two reads, and noise between frames.
        ("received", EPOCH_S, heartbeat(0) + heartbeat(1)),
        ("received", EPOCH_S + 1.0, b"\x00noise" + heartbeat(2)[:5]),
        ("sent", EPOCH_S + 1.5, heartbeat(3)),
        ("received", EPOCH_S + 2.0, heartbeat(2)[5:]),
    ]
    logged(tmp_path / "flight.mcap", traffic)
    assert write_tlog([tmp_path / "flight.mcap"], tmp_path / "flight.tlog") == (4, [])
    replay = mavutil.mavlink_connection(str(tmp_path / "flight.tlog"))
    read = []
    while (message := replay.recv_match()) is not None:
        read.append((message.get_type(), message.get_seq(), message._timestamp))
    replay.close()
    assert read == [
        ("HEARTBEAT", 0, EPOCH_S),
        ("HEARTBEAT", 1, EPOCH_S),
        ("HEARTBEAT", 3, EPOCH_S + 1.5),
        ("HEARTBEAT", 2, EPOCH_S + 2.0),
    ]


def test_a_frame_may_begin_in_one_part_and_end_in_the_next(
    tmp_path: Path, clearway: Clearway
) -> None:
    traffic = random_traffic(7, 400)
    logged(tmp_path / "flight.mcap", traffic, part_bytes=15_000)
    assert len(list(tmp_path.glob("flight*.mcap"))) > 1
    ran = clearway("export", tmp_path, "--tlog")
    assert (ran.code, ran.err) == (0, "")
    assert (tmp_path / "flight.tlog").read_bytes() == written_in_flight(traffic)


def test_a_cut_log_is_exported_up_to_the_cut(tmp_path: Path, clearway: Clearway) -> None:
    traffic = random_traffic(1, 4000)
    path = tmp_path / "flight.mcap"
    logged(path, traffic)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    ran = clearway("export", path, "--tlog")
    assert ran.code == 0
    assert "breaks off before its end" in ran.err
    whole = written_in_flight(traffic)
    exported = (tmp_path / "flight.tlog").read_bytes()
    assert 1000 < len(exported) < len(whole)
    assert whole.startswith(exported)


@pytest.mark.parametrize("content", [b"", b"not a log", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "flight.mcap").write_bytes(content)
    with pytest.raises(CommandError, match="is not a flight log"):
        write_tlog([tmp_path / "flight.mcap"], tmp_path / "flight.tlog")
    assert not (tmp_path / "flight.tlog").exists()


def test_a_log_without_traffic_leaves_an_earlier_file_untouched(tmp_path: Path) -> None:
    logged(tmp_path / "flight.mcap", [])
    (tmp_path / "flight.tlog").write_text("yesterday's")
    with pytest.raises(CommandError, match="has no MAVLink traffic"):
        write_tlog([tmp_path / "flight.mcap"], tmp_path / "flight.tlog")
    assert (tmp_path / "flight.tlog").read_text() == "yesterday's"


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    logged(tmp_path / "flight.mcap", [("sent", EPOCH_S, heartbeat(0))])
    with pytest.raises(CommandError, match=r"nowhere/flight\.tlog: cannot be written"):
        write_tlog([tmp_path / "flight.mcap"], tmp_path / "nowhere" / "flight.tlog")


def test_a_signed_frame_and_one_of_version_1_keep_their_length() -> None:
    packer = mavlink.MAVLink(None, 1, 1)
    packer.signing.secret_key = b"k" * 32
    packer.signing.sign_outgoing = True
    signed = packer.heartbeat_encode(2, 12, 0, 0, 4).pack(packer)
    old = mavlink.MAVLink(None, 1, 1).heartbeat_encode(2, 12, 0, 0, 4)
    old_bytes = old.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)
    assert old_bytes[0] == 0xFE
    assert FrameSplitter().split(signed + old_bytes) == [signed, old_bytes]


@given(st.binary(max_size=400), st.integers(1, 50))
def test_portions_do_not_matter(data: bytes, length: int) -> None:
    whole, portioned = FrameSplitter(), FrameSplitter()
    portions = [data[i : i + length] for i in range(0, len(data), length)]
    assert [f for portion in portions for f in portioned.split(portion)] == whole.split(data)
