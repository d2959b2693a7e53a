"""MAVLink connection URLs -> asyncio endpoints (UDP, TCP, serial); bytes in, bytes out.

The URLs are MAVSDK's: ``udpin://0.0.0.0:14540``, ``udpout://HOST:PORT``, ``tcpout://HOST:PORT``,
``tcpin://HOST:PORT``, ``serial:///dev/ttyAMA0:921600``.
"""

from __future__ import annotations

import asyncio
import logging
import os
import termios
import tty
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol, cast
from urllib.parse import urlsplit

log = logging.getLogger(__name__)

Receive = Callable[[bytes], None]
SCHEMES: Final = ("udpin", "udpout", "tcpin", "tcpout", "serial")
RECONNECT_S: Final = 1.0
READ_BYTES: Final = 65_536


class LinkError(RuntimeError):
    """A link that cannot be opened; the message names the URL."""


class Link(Protocol):
    """An open link."""

    def send(self, data: bytes) -> None:
        """Send bytes, or drop them while nobody is connected."""

    def close(self) -> None:
        """Release the port."""


@dataclass(frozen=True)
class LinkUrl:
    """A parsed connection URL: a host and port, or a device and baud rate."""

    url: str
    scheme: str
    target: str
    number: int

    @classmethod
    def parse(cls, url: str) -> LinkUrl:
        """Parse a URL.

        Raises:
            LinkError: the URL is not one of ours.
        """
        parts = urlsplit(url)
        if parts.scheme not in SCHEMES:
            raise LinkError(f"{url}: scheme must be one of {', '.join(SCHEMES)}")
        target, _, number = (parts.netloc + parts.path).rpartition(":")
        if not target or not number.isdecimal() or not 0 < int(number) < 2**24:
            form = "/dev/DEVICE:BAUD" if parts.scheme == "serial" else "HOST:PORT"
            raise LinkError(f"{url}: expected {parts.scheme}://{form}")
        return cls(url, parts.scheme, target, int(number))


async def open_link(url: str, receive: Receive) -> Link:
    """Open a MAVLink connection; ``receive`` is called in the event loop with what arrives.

    Raises:
        LinkError: the URL is malformed, the port is in use, the device is missing.
    """
    parsed = LinkUrl.parse(url)
    try:
        match parsed.scheme:
            case "udpin":
                return await _open_udp(receive, local=(parsed.target, parsed.number))
            case "udpout":
                return await _open_udp(receive, remote=(parsed.target, parsed.number))
            case "tcpin":
                return await _TcpServer.open(parsed, receive)
            case "tcpout":
                return _TcpClient(parsed, receive)
            case _:
                return _Serial(parsed, receive)
    except OSError as error:
        raise LinkError(f"{url}: cannot be opened: {error.strerror or error}") from error


class _Udp(asyncio.DatagramProtocol):
    """Sends to its remote, or to whoever was heard last."""

    def __init__(self, receive: Receive, remote: tuple[str, int] | None) -> None:
        self._receive = receive
        self._remote = remote
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # Python 3.11's own datagram transport does not derive from the class it implements.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._remote = addr
        self._receive(data)

    def error_received(self, exc: Exception) -> None:
        # Nobody listens there yet: normal before the other side has started.
        log.debug("UDP: %s", exc)

    def send(self, data: bytes) -> None:
        if self._remote is not None and self._transport is not None:
            self._transport.sendto(data, self._remote)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


async def _open_udp(
    receive: Receive, local: tuple[str, int] | None = None, remote: tuple[str, int] | None = None
) -> _Udp:
    loop = asyncio.get_running_loop()
    bind = local or ("0.0.0.0", 0)  # noqa: S104  the autopilot may be on any interface
    _, protocol = await loop.create_datagram_endpoint(
        lambda: _Udp(receive, remote), local_addr=bind
    )
    return protocol


class _TcpServer:
    """Serves one autopilot at a time; a new connection replaces the old one."""

    def __init__(self) -> None:
        self._server: asyncio.Server | None = None
        self._writer: asyncio.StreamWriter | None = None

    @classmethod
    async def open(cls, url: LinkUrl, receive: Receive) -> _TcpServer:
        link = cls()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            if link._writer is not None:
                link._writer.close()
            link._writer = writer
            await _pump(reader, receive)

        link._server = await asyncio.start_server(serve, url.target, url.number)
        return link

    def send(self, data: bytes) -> None:
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(data)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
        if self._server is not None:
            self._server.close()


class _TcpClient:
    """Connects, and connects again when the other side went away."""

    def __init__(self, url: LinkUrl, receive: Receive) -> None:
        self._url = url
        self._receive = receive
        self._writer: asyncio.StreamWriter | None = None
        self._task = asyncio.get_running_loop().create_task(self._run(), name=url.url)

    async def _run(self) -> None:
        while True:
            try:
                reader, self._writer = await asyncio.open_connection(
                    self._url.target, self._url.number
                )
                await _pump(reader, self._receive)
            except OSError as error:
                log.info("%s: %s; trying again", self._url.url, error)
            await asyncio.sleep(RECONNECT_S)

    def send(self, data: bytes) -> None:
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(data)

    def close(self) -> None:
        self._task.cancel()
        if self._writer is not None:
            self._writer.close()


async def _pump(reader: asyncio.StreamReader, receive: Receive) -> None:
    while data := await reader.read(READ_BYTES):
        receive(data)


class _Serial:
    """A raw serial line, read when the event loop says so, opened again when it breaks."""

    def __init__(self, url: LinkUrl, receive: Receive) -> None:
        speed = getattr(termios, f"B{url.number}", None)
        if speed is None:
            raise LinkError(f"{url.url}: {url.number} baud is not a standard rate")
        self._url, self._receive, self._speed = url, receive, speed
        self._loop = asyncio.get_running_loop()
        self._descriptor: int | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._open()

    def _open(self) -> None:
        descriptor = os.open(self._url.target, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(descriptor)
        settings = termios.tcgetattr(descriptor)
        settings[4] = settings[5] = self._speed
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        self._descriptor = descriptor
        self._loop.add_reader(descriptor, self._read, descriptor)

    def _reopen(self) -> None:
        try:
            self._open()
        except (OSError, termios.error) as error:
            log.info("%s: %s; trying again", self._url.url, error)
            self._retry = self._loop.call_later(RECONNECT_S, self._reopen)

    def _read(self, descriptor: int) -> None:
        try:
            data = os.read(descriptor, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._receive(data)
        else:
            self._break()

    def _break(self) -> None:
        log.warning("%s: the line broke", self._url.url)
        self._release()
        self._retry = self._loop.call_later(RECONNECT_S, self._reopen)

    def send(self, data: bytes) -> None:
        if self._descriptor is None:
            return
        try:
            written = os.write(self._descriptor, data)
        except BlockingIOError:
            written = 0
        except OSError:
            self._break()
            return
        if written < len(data):
            log.warning("%s: too slow, dropped %d bytes", self._url.url, len(data) - written)

    def _release(self) -> None:
        if self._descriptor is not None:
            self._loop.remove_reader(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = None

    def close(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
        self._release()
