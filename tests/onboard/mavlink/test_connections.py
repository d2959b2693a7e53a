import asyncio
import contextlib
import errno
import functools
import grp
import os
import pty
import socket
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from onboard.mavlink.connections import Link, open_link
from onboard.mavlink.link_url import LinkError, LinkUrl
from onboard.mavlink.vehicle_peer import SILENCE_S, VehiclePeer

VEHICLE = 3


def heartbeat(
    system_id: int = VEHICLE,
    component_id: int = mavlink.MAV_COMP_ID_AUTOPILOT1,
    autopilot: int = mavlink.MAV_AUTOPILOT_PX4,
    *,
    version: int = 2,
) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, autopilot, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
    sender = mavlink.MAVLink(None, system_id, component_id)
    return bytes(message.pack(sender, force_mavlink1=version == 1))


def position() -> bytes:
    message = mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    return bytes(message.pack(mavlink.MAVLink(None, VEHICLE, 1)))


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.mark.parametrize(
    ("url", "scheme", "target", "number"),
    [
        ("udpin://127.0.0.1:14540", "udpin", "127.0.0.1", 14540),
        ("udpout://127.0.0.1:14540", "udpout", "127.0.0.1", 14540),
        ("tcpout://autopilot.local:5760", "tcpout", "autopilot.local", 5760),
        ("udpin://[::]:14540", "udpin", "::", 14540),
        ("tcpout://[::1]:5760", "tcpout", "::1", 5760),
        ("udpout://[fe80::1%eth0]:65535", "udpout", "fe80::1%eth0", 65535),
        ("serial:///dev/ttyAMA0:921600", "serial", "/dev/ttyAMA0", 921600),
    ],
)
def test_urls_are_those_of_mavsdk(url: str, scheme: str, target: str, number: int) -> None:
    parsed = LinkUrl.parse(url)
    assert (parsed.scheme, parsed.target, parsed.number) == (scheme, target, number)


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("", "scheme must be one of udpin"),
        ("udp://:14540", "scheme must be one of udpin"),
        ("udpin:0.0.0.0:14540", "scheme must be one of udpin"),
        ("udpin://0.0.0.0", "expected udpin://HOST:PORT"),
        ("udpin://:14540", "expected udpin://HOST:PORT"),
        ("udpin://[]:14540", "expected udpin://HOST:PORT"),
        ("udpin://0.0.0.0/x:14540", "expected udpin://HOST:PORT"),
        ("udpin://0.0.0.0:", "port '' is not a number from 1 to 65535"),
        ("udpin://h:x", "port 'x' is not"),
        ("udpin://0.0.0.0:0", "port '0' is not"),
        ("udpin://0.0.0.0:99999", "port '99999' is not"),
        ("udpin://0.0.0.0:-1", "port '-1' is not"),
        ("udpin://0.0.0.0:١٤٥٤٠", "is not a number"),
        ("udpin://0.0.0.0:" + "9" * 5000, "is not a number"),
        ("udpin://::1:14540", "write an IPv6 address in brackets"),
        ("udpin://[::1:14540", "write an IPv6 address in brackets"),
        ("serial:///dev/tty", "expected serial:///dev/DEVICE:BAUD"),
        ("serial://ttyACM0:57600", "expected serial:///dev/DEVICE:BAUD"),
        ("serial:///dev/tty\0:57600", "expected serial:///dev/DEVICE:BAUD"),
        ("serial:///dev/ttyACM0:99999999", "baud rate '99999999' is not"),
    ],
)
def test_malformed_url_is_named(url: str, reason: str) -> None:
    with pytest.raises(LinkError) as refused:
        LinkUrl.parse(url)
    assert str(refused.value).startswith(f"{url}: ")
    assert reason in str(refused.value)


@contextlib.asynccontextmanager
async def opened(url: str, receive: Callable[[bytes], None]) -> AsyncIterator[Link]:
    link = await open_link(url, receive, VEHICLE)
    try:
        yield link
    finally:
        link.close()
        await asyncio.sleep(0)


async def until(
    condition: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None
) -> None:
    for _ in range(500):
        if condition():
            return
        meanwhile()
        await asyncio.sleep(0.01)
    pytest.fail("nothing arrived within 5 s")


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "localhost"])
@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcpout")])
def test_bytes_go_both_ways(listening: str, calling: str, host: str) -> None:
    kind = socket.SOCK_DGRAM if listening == "udpin" else socket.SOCK_STREAM
    address = f"{host}:{free_port(kind)}"
    at_server, at_client = bytearray(), bytearray()

    async def exchange() -> None:
        async with (
            opened(f"{listening}://{address}", at_server.extend) as server,
            opened(f"{calling}://{address}", at_client.extend) as client,
        ):
            await until(lambda: bool(at_server), meanwhile=lambda: client.send(heartbeat()))
            server.send(b"pong")
            await until(lambda: bytes(at_client) == b"pong")

    asyncio.run(exchange())
    assert bytes(at_server).startswith(heartbeat())


NOT_THE_VEHICLE = {
    "garbage": b"\x00\x01 not MAVLink",
    "another vehicle": heartbeat(system_id=VEHICLE + 1),
    "a component of the vehicle": heartbeat(component_id=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER),
    "a ground station": heartbeat(255, 190, mavlink.MAV_AUTOPILOT_INVALID),
    "no autopilot": heartbeat(autopilot=mavlink.MAV_AUTOPILOT_INVALID),
    "a damaged heartbeat": heartbeat()[:-1] + b"\x00",
    "half a heartbeat": heartbeat()[:-3],
    "a position": position(),
}


@pytest.mark.parametrize("kind", NOT_THE_VEHICLE)
def test_only_the_vehicle_becomes_the_peer(kind: str) -> None:
    peer: VehiclePeer[str] = VehiclePeer(VEHICLE)
    assert peer.admit(NOT_THE_VEHICLE[kind], "stranger", 0.0)  # read and counted, never answered
    assert peer.peer is None
    assert peer.admit(b"\x00" + position() + heartbeat(version=1), "vehicle", 0.1)
    assert peer.peer == "vehicle"
    for now_s in (0.2, 100.0):
        assert not peer.admit(NOT_THE_VEHICLE[kind], "stranger", now_s)
        assert peer.peer == "vehicle"
    assert peer.ignored == 2


def test_vehicle_is_followed_to_another_port_only_after_silence() -> None:
    peer: VehiclePeer[str] = VehiclePeer(VEHICLE)
    peer.admit(heartbeat(), "first", 0.0)
    assert not peer.admit(heartbeat(), "second", SILENCE_S)  # a double, or a forger
    assert peer.admit(position(), "first", SILENCE_S)  # no heartbeat: not enough to stay
    assert peer.admit(heartbeat(), "second", SILENCE_S + 0.01)
    assert peer.peer == "second"
    assert not peer.admit(heartbeat(), "first", SILENCE_S + 0.02)


def test_a_peer_that_is_gone_is_replaced_at_once() -> None:
    peer: VehiclePeer[int] = VehiclePeer(VEHICLE)
    peer.admit(heartbeat(), 1, 0.0)
    peer.forget(2)
    assert peer.peer == 1
    peer.forget(1)
    assert peer.admit(heartbeat(), 2, 0.01)
    assert peer.peer == 2


@pytest.mark.parametrize("stranger", ["before the vehicle", "after the vehicle"])
@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcpout")])
def test_set_points_go_to_the_vehicle_alone(listening: str, calling: str, stranger: str) -> None:
    kind = socket.SOCK_DGRAM if listening == "udpin" else socket.SOCK_STREAM
    address = f"127.0.0.1:{free_port(kind)}"
    at_daemon, at_vehicle, at_stranger = bytearray(), bytearray(), bytearray()

    async def say(link: Link, data: bytes, heard: bytes) -> None:
        await until(lambda: heard in at_daemon, meanwhile=lambda: link.send(data))

    async def exchange() -> None:
        async with (
            opened(f"{listening}://{address}", at_daemon.extend) as daemon,
            opened(f"{calling}://{address}", at_stranger.extend) as other,
            opened(f"{calling}://{address}", at_vehicle.extend) as vehicle,
        ):
            if stranger == "before the vehicle":
                await say(other, b"hello", b"hello")
                daemon.send(b"setpoint")  # dropped: that is not the vehicle
            await say(vehicle, heartbeat(), heartbeat())
            for _ in range(5):
                other.send(b"hello" + heartbeat())
                await asyncio.sleep(0.01)
                daemon.send(b"setpoint")
            await until(lambda: b"setpoint" in at_vehicle)

    asyncio.run(exchange())
    assert not at_stranger


def test_a_caller_reads_only_what_its_address_sends() -> None:
    heard = bytearray()

    async def call() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            autopilot.bind(("127.0.0.1", 0))
            autopilot.settimeout(5.0)
            url = f"udpout://127.0.0.1:{autopilot.getsockname()[1]}"
            async with opened(url, heard.extend) as link:
                link.send(b"hello")
                _, daemon = autopilot.recvfrom(100)
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                    stranger.sendto(heartbeat(), daemon)
                autopilot.sendto(b"telemetry", daemon)
                await until(lambda: bool(heard))
                link.send(b"setpoint")
                assert autopilot.recv(100) == b"setpoint"

    asyncio.run(call())
    assert heard == b"telemetry"


@pytest.mark.parametrize("scheme", ["udpin", "udpout", "tcpin", "tcpout"])
@pytest.mark.parametrize("host", ["no-such-host.invalid", "a" * 64, "a..b", "fe80::1%nowhere"])
def test_unknown_host_is_one_error_with_the_url(scheme: str, host: str) -> None:
    url = f"{scheme}://{f'[{host}]' if ':' in host else host}:14540"
    with pytest.raises(LinkError, match="has no address") as refused:
        asyncio.run(open_link(url, lambda _: None, VEHICLE))
    assert url in str(refused.value)
    assert host in str(refused.value)


@pytest.mark.parametrize("scheme", ["udpout", "tcpout"])
def test_names_are_resolved_once_and_off_the_tick(
    scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def resolve(host: str, port: int, *_: object, **__: object) -> list[Any]:
        asked.append(threading.current_thread().name)
        return [(socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("127.0.0.1", int(port)))]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)

    async def send() -> None:
        async with opened(f"{scheme}://autopilot.local:9", lambda _: None) as link:
            for _ in range(5):
                link.send(b"setpoint")
                await asyncio.sleep(0.01)

    asyncio.run(send())
    assert len(asked) == 1
    assert asked[0] != threading.main_thread().name


def test_tcp_client_connects_again() -> None:
    address = f"127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    heard = bytearray()

    async def reconnect() -> None:
        async with opened(f"tcpout://{address}", lambda _: None) as client:
            for greeting in (b"first", b"second"):
                heard.clear()
                async with opened(f"tcpin://{address}", heard.extend):
                    await until(
                        lambda: bool(heard), meanwhile=functools.partial(client.send, greeting)
                    )
                assert bytes(heard).startswith(greeting)

    asyncio.run(reconnect())


@pytest.mark.parametrize("scheme", ["udpin", "tcpin"])
def test_port_in_use_is_one_error_with_the_url(scheme: str) -> None:
    kind = socket.SOCK_DGRAM if scheme == "udpin" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as holder:
        holder.bind(("127.0.0.1", 0))
        if kind is socket.SOCK_STREAM:
            holder.listen()
        url = f"{scheme}://127.0.0.1:{holder.getsockname()[1]}"
        with pytest.raises(LinkError, match=f"{url}: cannot be opened"):
            asyncio.run(open_link(url, lambda _: None, VEHICLE))


def test_serial_device_that_is_missing_at_the_start_is_waited_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("onboard.mavlink.serial_line.RETRY_S", 0.02)
    caplog.set_level("INFO")
    device, heard = tmp_path / "tty", bytearray()

    async def plug_in_late() -> None:
        async with opened(f"serial://{device}:57600", heard.extend) as link:
            link.send(b"into the void")
            await asyncio.sleep(0.2)
            ours, terminal = pty.openpty()
            device.symlink_to(os.ttyname(terminal))
            await until(lambda: "opened" in caplog.text)
            os.write(ours, b"here")
            await until(lambda: bytes(heard) == b"here")
            os.close(ours)
            os.close(terminal)

    asyncio.run(plug_in_late())
    assert caplog.text.count("No such file or directory; waiting for it") == 1


@pytest.mark.parametrize(
    ("device", "reason"),
    [
        ("/dev/null", "not a serial device"),
        ("/dev", "Is a directory"),
        ("/etc/hostname", "not a serial device"),
    ],
)
def test_what_is_not_a_serial_device_is_refused(device: str, reason: str) -> None:
    url = f"serial://{device}:57600"
    with pytest.raises(LinkError, match=f"{url}: cannot be opened: {reason}"):
        asyncio.run(open_link(url, lambda _: None, VEHICLE))


def test_serial_line_without_permission_names_the_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "tty"
    device.touch()

    def refuse(*_: object) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("onboard.mavlink.serial_line.os.open", refuse)
    group = grp.getgrgid(device.stat().st_gid).gr_name
    with pytest.raises(LinkError, match=f"permission denied: .* in the group {group}"):
        asyncio.run(open_link(f"serial://{device}:57600", lambda _: None, VEHICLE))


@pytest.mark.parametrize("number", [errno.EBUSY, errno.EACCES])
def test_serial_line_of_another_process_is_refused(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pty.openpty()

    def refuse(*_: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("onboard.mavlink.serial_line.fcntl.ioctl", refuse)
    with pytest.raises(LinkError, match=r"another process|permission denied"):
        asyncio.run(open_link(f"serial://{os.ttyname(theirs)}:57600", lambda _: None, VEHICLE))
    os.close(ours)
    os.close(theirs)


def test_odd_baud_rate_is_refused() -> None:
    with pytest.raises(LinkError, match="57601 baud"):
        asyncio.run(open_link("serial:///dev/null:57601", lambda _: None, VEHICLE))


def test_serial_line_carries_raw_bytes() -> None:
    ours, theirs = pty.openpty()
    heard = bytearray()

    async def exchange() -> None:
        async with opened(f"serial://{os.ttyname(theirs)}:57600", heard.extend) as link:
            os.write(ours, b"\x00\x03\x0d\xfd")  # bytes that a cooked line would eat
            await until(lambda: bytes(heard) == b"\x00\x03\x0d\xfd")
            link.send(b"\x0a\x11")
            await until(lambda: os.read(ours, 100) == b"\x0a\x11")

    try:
        asyncio.run(exchange())
    finally:
        os.close(ours)
        os.close(theirs)


def test_broken_serial_line_is_opened_again(tmp_path: Path) -> None:
    device, heard = tmp_path / "tty", bytearray()

    async def replug() -> None:
        first, terminal = pty.openpty()
        device.symlink_to(os.ttyname(terminal))
        os.close(terminal)
        async with opened(f"serial://{device}:57600", heard.extend) as link:
            os.close(first)
            await asyncio.sleep(0.05)
            link.send(b"into the void")
            second, terminal = pty.openpty()
            device.unlink()
            device.symlink_to(os.ttyname(terminal))
            for _ in range(500):
                os.write(second, b"back")
                await asyncio.sleep(0.01)
                if heard:
                    break
            os.close(second)
            os.close(terminal)

    asyncio.run(replug())
    assert heard.startswith(b"back")
