"""Message signing: what a signed vehicle obeys, and what it refuses."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.protocol.signing import key_of_passphrase
from sitl.config import VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.sitl.mavlink_client import COMPANION, Outbox

START_UNIX_S = 1_790_000_000.0
MINUTE = 60 * 100_000
WORDS = "open sesame"
KEY = key_of_passphrase(WORDS)
ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def vehicle(**config: Any) -> SimulatedVehicle:
    flown = SimulatedVehicle(
        VehicleConfig(signing_passphrase=WORDS, realism="ideal", **config),
        start_unix_s=START_UNIX_S,
    )
    flown.advance(1.5)
    return flown


def now_ticks() -> int:
    return round((START_UNIX_S - 1_420_070_400) * 100_000)


def frame(
    message: Any = ARM,
    key: bytes | None = KEY,
    ticks: int | None = None,
    component: int = COMPANION,
) -> bytes:
    """A message as pymavlink, which is not ours, signs it; unsigned without a key."""
    outbox = Outbox()
    codec = mavlink.MAVLink(outbox, 1, component)
    if key is not None:
        codec.signing.secret_key = key
        codec.signing.sign_outgoing = True
        codec.signing.timestamp = now_ticks() if ticks is None else ticks
    codec.send(message)
    return bytes(outbox)


def obeys(flown: SimulatedVehicle, data: bytes, link: int = 0) -> bool:
    flown.autopilot.commander.disarm(force=True)
    flown.receive(data, link)
    return flown.autopilot.commander.armed


def test_a_genuine_frame_is_obeyed_and_answers_are_signed() -> None:
    flown = vehicle()
    assert obeys(flown, frame())
    reader = mavlink.MAVLink(None, 255, 190)
    reader.signing.secret_key = KEY
    messages = reader.parse_buffer(flown.bytes_to_send()) or []
    assert "COMMAND_ACK" in {message.get_type() for message in messages}
    assert all(message.get_signed() for message in messages)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda: frame(key=None),
        lambda: frame(key=hashlib.sha256(b"guess").digest()),
        lambda: frame()[:-1] + bytes([frame()[-1] ^ 1]),
        lambda: frame(ticks=now_ticks() - 2 * MINUTE),
    ],
    ids=["unsigned", "wrong key", "damaged signature", "two minutes old"],
)
def test_anything_else_is_refused_and_counted(spoil: Callable[[], bytes]) -> None:
    flown = vehicle()
    assert not obeys(flown, spoil())
    assert flown.autopilot.signing is not None
    assert flown.autopilot.signing.refused == 1


def test_a_replayed_frame_is_refused_on_every_link() -> None:
    flown = vehicle()
    recorded = frame()
    assert obeys(flown, recorded)
    assert not obeys(flown, recorded)
    assert not obeys(flown, recorded, link=1)
    assert obeys(flown, frame(ticks=now_ticks() + 1))


def test_senders_are_told_apart() -> None:
    flown = vehicle()
    assert obeys(flown, frame(ticks=now_ticks() + 1000))
    assert obeys(flown, frame(component=190))


def test_a_forgery_from_the_future_does_not_lock_the_owner_out() -> None:
    flown = vehicle()
    assert not obeys(flown, frame(key=bytes(32), ticks=now_ticks() + 10_000 * MINUTE))
    assert obeys(flown, frame())


def test_a_refused_frame_does_not_take_its_neighbours_with_it() -> None:
    flown = vehicle()
    assert obeys(flown, frame(key=None) + frame())


def setup_signing(key: bytes) -> Any:
    return mavlink.MAVLink_setup_signing_message(1, 1, list(key), now_ticks())


def test_signing_is_set_up_and_ended_over_mavlink() -> None:
    flown = SimulatedVehicle(VehicleConfig(realism="ideal"), start_unix_s=START_UNIX_S)
    flown.advance(1.5)
    assert obeys(flown, frame(key=None))
    flown.receive(frame(setup_signing(KEY), key=None))
    assert not obeys(flown, frame(key=None))
    flown.receive(frame(setup_signing(bytes(32)), key=None))  # not genuine: no way out
    assert not obeys(flown, frame(key=None))
    flown.receive(frame(setup_signing(bytes(32)), ticks=now_ticks() + 5))
    assert obeys(flown, frame(key=None))


@pytest.mark.parametrize("position", range(0, 55, 7))
def test_no_changed_byte_goes_unnoticed(position: int) -> None:
    flown = vehicle()
    data = bytearray(frame())
    data[position % len(data)] ^= 0x40
    assert not obeys(flown, bytes(data) + bytes(300))
