"""Signatures agree with pymavlink's, which is not ours, and the rules are the specification's."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.signing import (
    LinkSigning,
    Objection,
    is_signed,
    may_be_unsigned,
    timestamp_at,
    without_signature,
)
from tests.onboard.mavlink.test_endpoint import Autopilot

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
NOW = timestamp_at(1_790_000_000.0)
MINUTE = 6_000_000


def signing(timestamp: int = NOW, key: bytes = KEY) -> LinkSigning:
    return LinkSigning(key, 3, timestamp)


def frame(timestamp: int | None = None, key: bytes = KEY, link_id: int = 0) -> bytes:
    """A heartbeat as pymavlink signs it; unsigned without a time stamp."""
    autopilot = Autopilot()
    if timestamp is not None:
        autopilot.mav.signing.secret_key, autopilot.mav.signing.link_id = key, link_id
        autopilot.mav.signing.sign_outgoing = True
        autopilot.mav.signing.timestamp = timestamp
    return autopilot.heartbeat(0, armed=False)


def test_what_is_signed_here_pymavlink_accepts_and_strips_to_the_same() -> None:
    plain, ours = frame(), signing()
    signed = ours.sign(plain)
    receiver = mavlink.MAVLink(None)
    receiver.signing.secret_key = KEY
    receiver.signing.timestamp = NOW
    assert receiver.decode(bytearray(signed)).get_signed()
    assert (signed[-13], int.from_bytes(signed[-12:-6], "little")) == (3, NOW + 1)
    assert is_signed(signed)
    assert not is_signed(plain)
    assert without_signature(signed) == plain


def test_what_pymavlink_signs_is_accepted_once() -> None:
    ours = signing()
    assert ours.objection(frame(NOW)) is None
    assert ours.accept(frame(NOW)) is None
    assert ours.accept(frame(NOW)) is Objection.REPLAYED
    assert ours.objection(frame(NOW - 1)) is Objection.REPLAYED
    assert ours.accept(frame(NOW, link_id=1)) is None  # a stream of its own
    assert ours.accept(frame(NOW + 1)) is None


def test_unsigned_and_forged_frames_are_refused_and_leave_no_trace() -> None:
    ours, damaged = signing(), bytearray(frame(NOW))
    damaged[-1] ^= 1
    assert ours.accept(frame()) is Objection.UNSIGNED
    assert ours.accept(frame(NOW + MINUTE, OTHER_KEY)) is Objection.FORGED
    assert ours.accept(bytes(damaged)) is Objection.FORGED
    assert ours.accept(frame(NOW)) is None
    assert ours.timestamp == NOW


@pytest.mark.parametrize(("behind", "accepted"), [(MINUTE, True), (MINUTE + 1, False)])
def test_a_sender_may_begin_a_minute_late(behind: int, *, accepted: bool) -> None:
    assert (signing().accept(frame(NOW - behind)) is None) is accepted


def test_time_never_goes_back_and_follows_the_clock_and_the_other_side() -> None:
    ours = signing()
    ours.follow_clock(0.0)
    assert ours.timestamp == NOW
    ours.follow_clock(1_790_000_001.0)
    assert ours.timestamp == NOW + 100_000
    assert ours.accept(frame(NOW + 500_000)) is None
    first, second = (int.from_bytes(ours.sign(frame())[-12:-6], "little") for _ in range(2))
    assert (first, second) == (NOW + 500_001, NOW + 500_002)


def test_what_cannot_be_signed_is_an_error_of_ours() -> None:
    with pytest.raises(ValueError, match="not an unsigned MAVLink 2 frame"):
        signing().sign(frame(NOW))
    with pytest.raises(ValueError, match="another dialect"):
        signing().sign(b"\xfd\x00\x00\x00\x00\x01\x01\xff\xff\xff\x00\x00")


def test_radios_sign_nothing() -> None:
    assert may_be_unsigned(mavlink.MAVLink_radio_status_message(0, 0, 0, 0, 0, 0, 0))
    assert not may_be_unsigned(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
