"""Plain CDR: alignment, both orders of bytes, and everything that a payload may get wrong."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.perception.ros2.cdr import STRING_BYTES_MAX, CdrReader, DecodeError

LITTLE, BIG = b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"


def test_numbers_are_aligned_from_behind_the_header() -> None:
    reader = CdrReader(LITTLE + b"\x07" + bytes(3) + struct.pack("<I", 9) + struct.pack("<d", 2.5))
    assert (reader.u8(), reader.u32(), reader.f64()) == (7, 9, 2.5)
    reader.end()


def test_the_header_says_the_order_of_bytes() -> None:
    for header, order in ((LITTLE, "<"), (BIG, ">")):
        reader = CdrReader(header + struct.pack(f"{order}iIf", -5, 7, 0.5))
        assert (reader.i32(), reader.u32(), reader.f32()) == (-5, 7, 0.5)


def test_a_sequence_of_floats_in_both_orders() -> None:
    for header, order in ((LITTLE, "<"), (BIG, ">")):
        reader = CdrReader(header + struct.pack(f"{order}I3f", 3, 1.0, -2.0, 3.5))
        assert reader.f32s().tolist() == [1.0, -2.0, 3.5]


def test_an_empty_sequence_of_doubles_takes_no_padding() -> None:
    reader = CdrReader(LITTLE + struct.pack("<I", 4))
    reader.u32()
    assert reader.f64s(0) == ()
    reader.end()


@pytest.mark.parametrize(("text", "length"), [("laser", 6), ("", 1), ("", 0), ("größe", 8)])
def test_strings(text: str, length: int) -> None:
    data = (text.encode() + b"\x00")[:length]
    assert CdrReader(LITTLE + struct.pack("<I", length) + data).text() == text


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (struct.pack("<I", 3) + b"abc", "string without end"),
        (struct.pack("<I", 3) + b"\xff\xff\x00", "string is not UTF-8"),
        (struct.pack("<I", STRING_BYTES_MAX + 1) + bytes(5000), "string too long"),
        (struct.pack("<I", 9) + b"a\x00", "truncated"),
        (b"\x01", "truncated"),
    ],
)
def test_a_malformed_string_is_refused(data: bytes, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        CdrReader(LITTLE + data).text()


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x00", b"\x00\x01\x00", b"\x00\x02\x00\x00", b"\x00\x06\x00\x00", b'{"version": 1}'],
)
def test_other_encapsulations_are_refused(payload: bytes) -> None:
    with pytest.raises(DecodeError, match="not plain CDR"):
        CdrReader(payload)


def test_a_sequence_longer_than_the_payload_allocates_nothing() -> None:
    with pytest.raises(DecodeError, match="sequence longer"):
        CdrReader(LITTLE + struct.pack("<I", 0xFFFFFFFF) + bytes(64)).f32s()


def test_a_boolean_is_0_or_1() -> None:
    assert CdrReader(LITTLE + b"\x01").flag() is True
    with pytest.raises(DecodeError, match="boolean"):
        CdrReader(LITTLE + b"\x02").flag()


def test_padding_at_the_end_is_no_rest() -> None:
    CdrReader(LITTLE + bytes(3)).end()
    with pytest.raises(DecodeError, match="left over"):
        CdrReader(LITTLE + bytes(4)).end()


@given(st.lists(st.floats(width=32, allow_nan=False), max_size=8), st.sampled_from("<>"))
def test_floats_come_back_as_they_were(values: list[float], order: str) -> None:
    header = LITTLE if order == "<" else BIG
    data = struct.pack(f"{order}I{len(values)}f", len(values), *values)
    assert CdrReader(header + data).f32s().tolist() == values
