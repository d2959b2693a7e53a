"""Frames out of bytes: an intact one is always found, whatever lies around it."""

from __future__ import annotations

import struct
from itertools import chain, zip_longest
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.dialects.v20 import common as mavlink

from onboard.files.mavlink_frames import FrameReader, FrameWriter

# No start byte: it ends whatever an earlier one has begun, and begins nothing.
SILENCE = bytes(300)
ATTITUDE, VFR_HUD = mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_VFR_HUD


def attitude(time_ms: int, *, version_1: bool = False) -> bytes:
    message = mavlink.MAVLink_attitude_message(time_ms, 0.1, -0.2, 0.3, 0.0, 0.0, 0.5)
    packed: bytes = message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=version_1)
    return packed


def hud(*, version_1: bool = False) -> bytes:
    message = mavlink.MAVLink_vfr_hud_message(1.0, 2.0, 3, 4, 5.0, 6.0)
    packed: bytes = message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=version_1)
    return packed


def of_a_stranger_dialect(payload: bytes) -> bytes:
    """A frame with an id that no dialect has, and a checksum that nobody can judge."""
    return bytes((0xFD, len(payload), 0, 0, 0, 1, 1, 0xEF, 0xCD, 0xAB)) + payload + bytes(2)


def times_ms(messages: list[Any]) -> list[int]:
    return [message.time_boot_ms for message in messages]


@given(
    st.lists(st.binary(max_size=40), max_size=6),
    st.integers(1, 60),
    st.sampled_from((None, (ATTITUDE,))),
)
def test_garbage_takes_no_intact_frame_with_it(
    garbage: list[bytes], portion: int, wanted: tuple[int, ...] | None
) -> None:
    frames = [attitude(number, version_1=number % 3 == 2) for number in range(len(garbage))]
    data = b"".join(chain.from_iterable(zip_longest(garbage, frames, fillvalue=b""))) + SILENCE
    reader = FrameReader(mavlink, wanted, trusts_unknown=False)
    heard = []
    for start in range(0, len(data), portion):
        heard += reader.read(data[start : start + portion])
    assert times_ms(heard) == list(range(len(garbage)))
    assert reader.bytes_dropped == sum(map(len, garbage)) + len(SILENCE)


@given(st.lists(st.binary(max_size=40).map(lambda noise: noise.replace(b"\xfd", b"")), max_size=6))
def test_where_unknown_ids_are_trusted_only_what_looks_like_mavlink_2_does(
    garbage: list[bytes],
) -> None:
    frames = [attitude(number) for number in range(len(garbage))]
    data = b"".join(chain.from_iterable(zip_longest(garbage, frames, fillvalue=b""))) + SILENCE
    heard = FrameReader(mavlink, (ATTITUDE,), trusts_unknown=True).read(data)
    assert times_ms(heard) == list(range(len(garbage)))


def test_an_unknown_id_in_mavlink_1_is_never_trusted() -> None:
    claim = bytes((0xFE, 60, 0, 1, 1, 193))
    assert 193 not in mavlink.mavlink_map
    heard = FrameReader(mavlink, (ATTITUDE,), trusts_unknown=True).read(
        claim + attitude(1) + attitude(2) + SILENCE
    )
    assert times_ms(heard) == [1, 2]


def test_a_mavlink_1_frame_longer_than_its_message_is_not_waited_for() -> None:
    longest = mavlink.MAVLink_position_target_local_ned_message
    claim = bytes((0xFE, longest.unpacker.size + 1, 0, 1, 1, longest.id))
    assert claim[1] > len(attitude(1))
    reader = FrameReader(mavlink, (ATTITUDE,), trusts_unknown=True)
    assert times_ms(reader.read(claim + attitude(1))) == [1]


def test_the_environment_cannot_have_damaged_frames_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mavlink, "MAVLINK_IGNORE_CRC", True)  # what MAV_IGNORE_CRC does
    damaged = bytearray(attitude(1))
    damaged[15] ^= 0xFF
    reader = FrameReader(mavlink, (ATTITUDE,), trusts_unknown=True)
    assert times_ms(reader.read(bytes(damaged) + attitude(2) + SILENCE)) == [2]


def test_what_nobody_wants_is_passed_over_as_long_as_it_is_intact() -> None:
    reader = FrameReader(mavlink, (ATTITUDE,), trusts_unknown=False)
    assert times_ms(reader.read(hud() + attitude(7) + hud(version_1=True))) == [7]
    assert reader.bytes_dropped == 0
    damaged = bytearray(hud())
    damaged[12] ^= 0xFF
    # Its length cannot be believed: what it claims may be something else's.
    damaged[1] += len(attitude(8))
    assert times_ms(reader.read(bytes(damaged) + attitude(8) + SILENCE)) == [8]
    assert reader.bytes_dropped == len(damaged) + len(SILENCE)


@pytest.mark.parametrize("wanted", [None, (ATTITUDE,)])
@pytest.mark.parametrize("trusts_unknown", [True, False])
def test_an_id_outside_the_dialect_is_a_frame_only_if_the_sender_is_trusted(
    trusts_unknown: bool, wanted: tuple[int, ...] | None
) -> None:
    reader = FrameReader(mavlink, wanted, trusts_unknown=trusts_unknown)
    heard = reader.read(of_a_stranger_dialect(attitude(3)) + attitude(4))
    found = [message for message in heard if message.get_msgId() == ATTITUDE]
    assert times_ms(found) == ([4] if trusts_unknown else [3, 4])
    assert (reader.bytes_dropped == 0) is trusts_unknown


def test_a_signed_frame_is_read_with_its_signature() -> None:
    codec = mavlink.MAVLink(None, 1, 1)
    codec.signing.secret_key, codec.signing.sign_outgoing = bytes(32), True
    message = mavlink.MAVLink_attitude_message(5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    signed = message.pack(codec)
    for wanted in (None, (ATTITUDE,), (VFR_HUD,)):
        reader = FrameReader(mavlink, wanted, trusts_unknown=False)
        heard = reader.read(signed + attitude(6))
        assert times_ms(heard) == ([] if wanted == (VFR_HUD,) else [5, 6])
        assert reader.bytes_dropped == 0


class Sent(bytearray):
    def write(self, data: bytes) -> None:
        self.extend(data)


def drawn(kind: Any, rng: Random) -> Any:
    """A message with random fields, some of them zero."""
    codes = [code for code in kind.unpacker.format if code not in "<0123456789"]
    values = dict(zip(kind.ordered_fieldnames, codes, strict=True))
    return kind(*(rng.choice((0, number(values[name], rng))) for name in kind.fieldnames))


def number(code: str, rng: Random) -> float:
    """A random number that the field of this format code takes."""
    if code in "fd":
        value: float = struct.unpack(f"<{code}", struct.pack(f"<{code}", rng.gauss(0.0, 1e3)))[0]
        return value
    bits = 8 * struct.calcsize(f"<{code}")
    return rng.getrandbits(bits) - (2 ** (bits - 1) if code.islower() else 0)


KINDS_OF_NUMBERS = [
    kind for kind in ardupilotmega.mavlink_map.values() if not any(kind.array_lengths)
]


def test_every_message_of_numbers_is_coded_as_pymavlink_codes_it() -> None:
    rng, ours, theirs = Random(1), Sent(), Sent()
    writer = FrameWriter(ours, 7, 196)
    reference = ardupilotmega.MAVLink(theirs, 7, 196)
    for kind in KINDS_OF_NUMBERS:
        message = drawn(kind, rng)
        writer.send(message)
        reference.send(message)
    assert len(KINDS_OF_NUMBERS) > 150
    assert ours == theirs
    assert (writer.seq, writer.total_bytes_sent) == (reference.seq, len(theirs))


@pytest.mark.parametrize("version_1", [False, True])
def test_every_message_of_numbers_is_decoded_as_pymavlink_decodes_it(version_1: bool) -> None:
    rng, sent = Random(2), Sent()
    sender = ardupilotmega.MAVLink(sent, 7, 196)
    for kind in KINDS_OF_NUMBERS:
        if not version_1 or kind.id < 256:
            sender.send(drawn(kind, rng), force_mavlink1=version_1)
    ours = FrameReader(ardupilotmega, trusts_unknown=False).read(bytes(sent))
    theirs = ardupilotmega.MAVLink(None).parse_buffer(bytes(sent))
    assert len(ours) == len(theirs) > 100
    for one, other in zip(ours, theirs, strict=True):
        assert type(one) is type(other)
        assert attributes(one) == attributes(other)


def attributes(message: Any) -> dict[str, Any]:
    return {**vars(message), "_header": vars(message.get_header())}


def test_texts_arrays_and_signed_frames_are_left_to_pymavlink() -> None:
    ours, theirs = Sent(), Sent()
    writer, reference = FrameWriter(ours, 1, 1), ardupilotmega.MAVLink(theirs, 1, 1)
    for codec in (writer, reference):
        codec.statustext_send(4, b"Clearway", 0, 0)
        codec.obstacle_distance_send(0, 0, [7] * 72, 5, 10, 900)
        codec.signing.secret_key, codec.signing.sign_outgoing = bytes(32), True
        codec.attitude_send(5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    assert ours == theirs


def test_a_number_that_does_not_fit_is_refused() -> None:
    with pytest.raises(struct.error):
        FrameWriter(Sent(), 1, 1).attitude_send(-1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
