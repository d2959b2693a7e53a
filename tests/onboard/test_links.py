import asyncio
import contextlib
import functools
import os
import pty
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from onboard.links import Link, LinkError, LinkUrl, open_link


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
        ("serial:///dev/ttyAMA0:921600", "serial", "/dev/ttyAMA0", 921600),
    ],
)
def test_urls_are_those_of_mavsdk(url: str, scheme: str, target: str, number: int) -> None:
    parsed = LinkUrl.parse(url)
    assert (parsed.scheme, parsed.target, parsed.number) == (scheme, target, number)


@pytest.mark.parametrize(
    "url",
    ["", "udp://:14540", "udpin://0.0.0.0", "udpin://:14540", "udpin://h:x", "serial:///dev/tty"],
)
def test_malformed_url_is_named(url: str) -> None:
    with pytest.raises(LinkError, match=url or "scheme"):
        LinkUrl.parse(url)


@contextlib.asynccontextmanager
async def opened(url: str, receive: Callable[[bytes], None]) -> AsyncIterator[Link]:
    link = await open_link(url, receive)
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


@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcpout")])
def test_bytes_go_both_ways(listening: str, calling: str) -> None:
    kind = socket.SOCK_DGRAM if listening == "udpin" else socket.SOCK_STREAM
    address = f"127.0.0.1:{free_port(kind)}"
    at_server, at_client = bytearray(), bytearray()

    async def exchange() -> None:
        async with (
            opened(f"{listening}://{address}", at_server.extend) as server,
            opened(f"{calling}://{address}", at_client.extend) as client,
        ):
            await until(lambda: bool(at_server), meanwhile=lambda: client.send(b"ping"))
            server.send(b"pong")
            await until(lambda: bytes(at_client) == b"pong")

    asyncio.run(exchange())
    assert bytes(at_server).startswith(b"ping")


def test_udp_sends_nothing_before_it_has_heard_anyone() -> None:
    async def send() -> None:
        url = f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
        async with opened(url, lambda _: None) as link:
            link.send(b"to nobody")

    asyncio.run(send())


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
            asyncio.run(open_link(url, lambda _: None))


def test_missing_serial_device_is_one_error_with_the_url() -> None:
    with pytest.raises(LinkError, match="serial:///dev/no-such-device:57600: cannot be opened"):
        asyncio.run(open_link("serial:///dev/no-such-device:57600", lambda _: None))


def test_odd_baud_rate_is_refused() -> None:
    with pytest.raises(LinkError, match="57601 baud"):
        asyncio.run(open_link("serial:///dev/null:57601", lambda _: None))


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
