"""One MAVLink connection: sequence, forwarding, and datagrams of whole frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.link import MavlinkLink, split_frames
from sitl.autopilot.protocol.signing import Signing, key_of_passphrase


def heartbeat() -> mavlink.MAVLink_heartbeat_message:
    return mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)


def sent(count: int) -> bytes:
    link = MavlinkLink(1, 1)
    for _ in range(count):
        link.send(heartbeat())
    return link.take()


def test_messages_have_the_links_own_sequence() -> None:
    messages = MavlinkLink(2, 2).parse(sent(3))
    assert [message.get_seq() for message in messages] == [0, 1, 2]
    assert {message.get_srcSystem() for message in messages} == {1}


def test_taking_clears_the_queue() -> None:
    link = MavlinkLink(1, 1)
    link.send(heartbeat())
    assert link.take()
    assert link.take() == b""


def test_a_forwarded_frame_is_unchanged() -> None:
    data = sent(1)
    link = MavlinkLink(9, 9)
    (message,) = link.parse(data)
    link.forward(message)
    assert link.take() == data


@given(cuts=st.lists(st.integers(0, 63), max_size=8), garbage=st.binary(max_size=20))
def test_frames_arrive_in_any_portions_behind_any_garbage(cuts: list[int], garbage: bytes) -> None:
    data = garbage.replace(b"\xfd", b"").replace(b"\xfe", b"") + sent(3)
    link, heard, start = MavlinkLink(2, 2), 0, 0
    for cut in [*sorted(cuts), len(data)]:
        heard += len(link.parse(data[start:cut]))
        start = max(start, cut)
    assert heard == link.frames_received == 3


def test_bytes_outside_frames_are_counted() -> None:
    link = MavlinkLink(2, 2)
    link.parse(b"garbage" + sent(1))
    assert link.bytes_dropped == 7


def test_a_signing_link_drops_unsigned_frames() -> None:
    signing = Signing(key_of_passphrase("secret"), 1_790_000_000.0)
    link, peer = MavlinkLink(2, 2), MavlinkLink(3, 3)
    link.sign_with(signing)
    assert link.parse(sent(2)) == []
    assert link.frames_received == 0
    assert signing.refused == 2
    peer.sign_with(Signing(key_of_passphrase("secret"), 1_790_000_000.0))
    peer.send(heartbeat())
    assert len(link.parse(peer.take())) == 1
    link.sign_with(None)
    assert len(link.parse(sent(1))) == 1


@pytest.mark.parametrize(
    ("length_max", "portions"), [(21, 5), (42, 3), (63, 2), (1000, 1), (10, 5)]
)
def test_datagrams_are_cut_between_frames(length_max: int, portions: int) -> None:
    data = sent(5)
    assert len(data) == 5 * 21
    cut = split_frames(data, length_max)
    assert len(cut) == portions
    assert b"".join(cut) == data
    assert all(len(one) % 21 == 0 for one in cut)


def test_nothing_makes_no_datagram() -> None:
    assert split_frames(b"", 100) == []


@given(st.binary(max_size=200), st.integers(1, 100))
def test_no_byte_is_lost_whatever_they_are(data: bytes, length_max: int) -> None:
    assert b"".join(split_frames(data, length_max)) == data
