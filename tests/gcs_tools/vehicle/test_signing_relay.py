"""The relay signs what MAVSDK sends and hides signatures from it; the peer is pymavlink's codec."""

from __future__ import annotations

import asyncio
import socket
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.console.errors import CommandError
from gcs_tools.console.keys import mavlink_key, operator_key
from gcs_tools.console.processes import free_ports
from gcs_tools.vehicle.operator import UrlError
from gcs_tools.vehicle.signing_relay import Relay, signing_relay
from onboard.mavlink.signing import is_signed, timestamp_at
from tests.onboard.mavlink.test_endpoint import Autopilot
from tests.onboard.mavlink.test_signing import KEY, OTHER_KEY, frame


def plain_socket() -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(("127.0.0.1", 0))
    bound.setblocking(False)
    return bound


async def received(bound: socket.socket) -> bytes:
    return await asyncio.wait_for(asyncio.get_running_loop().sock_recv(bound, 2048), 5.0)


def exchange(key: bytes, signed_with: bytes) -> tuple[bytes | None, list[Any], Relay]:
    """Return what MAVSDK hears of the vehicle, what the vehicle hears, and the relay."""

    async def run() -> tuple[bytes | None, list[Any], Relay]:
        url = f"udpin://127.0.0.1:{free_ports(1)[0]}"
        outside = ("127.0.0.1", int(url.rpartition(":")[2]))
        with plain_socket() as mavsdk, plain_socket() as vehicle:
            async with signing_relay(url, key, None) as relay:
                inside = ("127.0.0.1", int(relay.url.rpartition(":")[2]))
                assert relay.url.startswith("udpout://127.0.0.1:")
                mavsdk.sendto(frame(), inside)
                await asyncio.sleep(0.02)
                vehicle.sendto(frame(timestamp_at(time.time()), signed_with), outside)
                await asyncio.sleep(0.02)
                mavsdk.sendto(frame(), inside)
                try:
                    heard: bytes | None = mavsdk.recv(2048)
                except BlockingIOError:
                    return None, [], relay
                other = Autopilot()
                other.mav.signing.secret_key = KEY
                return heard, list(other.heard(await received(vehicle))), relay

    return asyncio.run(run())


def test_both_sides_hear_what_they_expect() -> None:
    heard, (told,), relay = exchange(KEY, KEY)
    assert heard is not None
    assert not is_signed(heard)
    assert told.get_signed()
    assert told.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT
    assert relay.complaints == []
    assert (relay.accepted, relay.refuses_all) == (1, False)


def test_with_a_wrong_key_mavsdk_hears_nothing_and_the_reason_is_kept() -> None:
    heard, _, relay = exchange(OTHER_KEY, KEY)
    assert heard is None
    assert (relay.accepted, relay.refuses_all) == (0, True)
    assert relay.complaints == ["1 messages were signed with another key, or altered"]


def test_without_a_key_mavsdk_opens_the_vehicles_own_url() -> None:
    async def url() -> str:
        async with signing_relay("udpin://127.0.0.1:14550", None, 1) as relay:
            return relay.url

    assert asyncio.run(url()) == "udpin://127.0.0.1:14550"


def test_a_url_that_cannot_be_opened_is_named() -> None:
    async def opened() -> None:
        async with signing_relay("udp://nowhere", KEY, 1):
            pass

    with pytest.raises(UrlError, match="udp://nowhere"):
        asyncio.run(opened())


def test_keys_of_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "a.key"
    path.touch(0o600)
    path.write_text(KEY.hex())
    assert operator_key(None) is None
    assert mavlink_key(None, None) is None
    assert operator_key(path) == mavlink_key(path, "udpin://127.0.0.1:14550") == KEY
    with pytest.raises(CommandError, match="--mavlink-key needs --vehicle"):
        mavlink_key(path, None)
