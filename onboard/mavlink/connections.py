"""MAVLink connection URLs -> asyncio endpoints (UDP, TCP, serial); bytes in, bytes out.

Host names are resolved once, when a link is opened: a name server that does not answer must not
delay a tick.  A port that listens sends to the vehicle alone (`onboard.mavlink.vehicle_peer`).
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import socket
from collections.abc import Callable
from functools import partial
from typing import Any, Final, Protocol, cast

from onboard.mavlink.link_url import LinkError, LinkUrl
from onboard.mavlink.serial_line import SerialLine
from onboard.mavlink.vehicle_peer import VehiclePeer

log = logging.getLogger(__name__)

Receive = Callable[[bytes], None]
# A socket address: host and port, for IPv6 also flow and scope.
Address = tuple[Any, ...]

RECONNECT_S: Final = 1.0
READ_BYTES: Final = 65_536
CONNECTIONS_MAX: Final = 8
# The kernel closes a connection whose peer acknowledges nothing for this long; by default it waits
# for minutes.
TCP_SILENCE_S: Final = 5.0
# Setpoints that would wait behind this much are dropped: late ones have no use.
TCP_BACKLOG_BYTES: Final = 16_384


class Link(Protocol):
    """An open link."""

    def send(self, data: bytes) -> None:
        """Send bytes, or drop them while the vehicle is not connected."""

    def close(self) -> None:
        """Release the port."""


async def open_link(
    url: str,
    receive: Receive,
    system_id: int | None,
    is_genuine: Callable[[bytes], bool] = lambda _: True,
) -> Link:
    """Open a MAVLink connection.

    Args:
        url: as `onboard.mavlink.link_url` describes.
        receive: called in the event loop with the bytes that arrive.
        system_id: MAVLink id of the vehicle, which alone may use a port that listens; None for
            whichever autopilot is heard.
        is_genuine: tells whether the signature of a frame permits to believe that it is the
            vehicle's.

    Raises:
        LinkError: the URL is malformed, its host unknown, the port in use, or the device unusable.
    """
    parsed = LinkUrl.parse(url)
    if parsed.scheme == "serial":
        return SerialLine(parsed, receive)
    vehicle = partial(VehiclePeer, system_id, is_genuine)
    try:
        family, address = await _resolve(parsed)
        match parsed.scheme:
            case "udpin":
                return await _UdpServer.open(family, address, receive, vehicle())
            case "udpout":
                return await _UdpClient.open(family, address, receive)
            case "tcpin":
                return await _TcpServer.open(family, address, receive, vehicle())
            case _:
                return _TcpClient(url, family, address, receive)
    except OSError as error:
        raise LinkError(f"{url}: cannot be opened: {error.strerror or error}") from error


async def _resolve(url: LinkUrl) -> tuple[socket.AddressFamily, Address]:
    """Return the address family and the first address of a URL's host.

    Raises:
        LinkError: the host has no address.
    """
    kind = socket.SOCK_DGRAM if url.scheme.startswith("udp") else socket.SOCK_STREAM
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(url.target, url.number, type=kind)
    except (socket.gaierror, UnicodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a host name"
        raise LinkError(f"{url.url}: host {url.target!r} has no address: {reason}") from error
    family, _, _, _, address = found[0]
    return family, address


class _Udp(asyncio.DatagramProtocol):
    """The common part of both ends of UDP."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # Python 3.11's own datagram transport does not derive from the class it implements.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def error_received(self, exc: Exception) -> None:
        # The other side does not listen, which is normal before it has started.
        log.debug("UDP: %s", exc)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


class _UdpServer(_Udp):
    """Bound to a port; sends to the vehicle once it has been heard."""

    def __init__(self, receive: Receive, vehicle: VehiclePeer[Address]) -> None:
        super().__init__(receive)
        self._loop = asyncio.get_running_loop()
        self._vehicle = vehicle

    @classmethod
    async def open(
        cls,
        family: socket.AddressFamily,
        address: Address,
        receive: Receive,
        vehicle: VehiclePeer[Address],
    ) -> _UdpServer:
        _, link = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: cls(receive, vehicle), local_addr=_host_and_port(address), family=family
        )
        return link

    def datagram_received(self, data: bytes, addr: Address) -> None:
        if self._vehicle.admit(data, addr, self._loop.time()):
            self._receive(data)

    def send(self, data: bytes) -> None:
        if self._vehicle.peer is not None and self._transport is not None:
            self._transport.sendto(data, self._vehicle.peer)


class _UdpClient(_Udp):
    """Sends to one address, and reads only what comes from there.

    The socket is not connected: that would fail where the network comes up after the daemon.
    """

    def __init__(self, receive: Receive, remote: Address) -> None:
        super().__init__(receive)
        self._remote = remote

    @classmethod
    async def open(
        cls, family: socket.AddressFamily, address: Address, receive: Receive
    ) -> _UdpClient:
        anywhere = "::" if family is socket.AF_INET6 else "0.0.0.0"  # noqa: S104  any interface
        _, link = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: cls(receive, address), local_addr=(anywhere, 0), family=family
        )
        return link

    def datagram_received(self, data: bytes, addr: Address) -> None:
        if addr[:2] == self._remote[:2]:
            self._receive(data)

    def send(self, data: bytes) -> None:
        if self._transport is not None:
            self._transport.sendto(data, self._remote)


def _host_and_port(address: Address) -> tuple[str, int]:
    """Return an address as asyncio takes it; the numeric host needs no further look-up."""
    host, port = socket.getnameinfo(address, socket.NI_NUMERICHOST | socket.NI_NUMERICSERV)
    return host, int(port)


class _TcpServer:
    """Listens for connections, and exchanges data with the one from the vehicle."""

    def __init__(self, receive: Receive, vehicle: VehiclePeer[int]) -> None:
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._vehicle = vehicle
        self._numbers = itertools.count(1)
        self._writers: dict[int, asyncio.StreamWriter] = {}
        self._server: asyncio.Server | None = None

    @classmethod
    async def open(
        cls,
        family: socket.AddressFamily,
        address: Address,
        receive: Receive,
        vehicle: VehiclePeer[int],
    ) -> _TcpServer:
        link = cls(receive, vehicle)
        host, port = _host_and_port(address)
        link._server = await asyncio.start_server(link._serve, host, port, family=family)
        return link

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._writers) >= CONNECTIONS_MAX:
            writer.close()
            return
        number = next(self._numbers)
        self._writers[number] = writer
        _expect_acknowledgement(writer)
        try:
            while data := await reader.read(READ_BYTES):
                if self._vehicle.admit(data, number, self._loop.time()):
                    self._receive(data)
        except OSError as error:
            log.info("TCP connection %d: %s", number, error)
        finally:
            self._vehicle.forget(number)
            del self._writers[number]
            writer.close()

    def send(self, data: bytes) -> None:
        if self._vehicle.peer is not None:
            _write(self._writers[self._vehicle.peer], data)

    def close(self) -> None:
        for writer in self._writers.values():
            writer.close()
        if self._server is not None:
            self._server.close()


class _TcpClient:
    """Connects, and reconnects when the other side has closed the connection."""

    def __init__(
        self, url: str, family: socket.AddressFamily, address: Address, receive: Receive
    ) -> None:
        self._url, self._family, self._address = url, family, address
        self._receive = receive
        self._writer: asyncio.StreamWriter | None = None
        self._reported = ""
        self._task = asyncio.get_running_loop().create_task(self._run(), name=url)

    async def _run(self) -> None:
        while True:
            try:
                await self._connect()
            except OSError as error:
                reason = error.strerror or str(error)
                if reason != self._reported:  # once, not every second
                    self._reported = reason
                    log.info("%s: %s; trying again", self._url, reason)
            await asyncio.sleep(RECONNECT_S)

    async def _connect(self) -> None:
        """Connect, and read until the other side closes the connection."""
        host, port = _host_and_port(self._address)
        reader, writer = await asyncio.open_connection(host, port, family=self._family)
        self._writer, self._reported = writer, ""
        _expect_acknowledgement(writer)
        try:
            while data := await reader.read(READ_BYTES):
                self._receive(data)
        finally:
            writer.close()

    def send(self, data: bytes) -> None:
        if self._writer is not None:
            _write(self._writer, data)

    def close(self) -> None:
        self._task.cancel()
        if self._writer is not None:
            self._writer.close()


def _expect_acknowledgement(writer: asyncio.StreamWriter) -> None:
    """Have the kernel close a connection whose other side no longer acknowledges."""
    connection = writer.get_extra_info("socket")
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(
            socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(TCP_SILENCE_S * 1e3)
        )


def _write(writer: asyncio.StreamWriter, data: bytes) -> None:
    """Write, unless the other side has stopped reading."""
    backlog_bytes = writer.transport.get_write_buffer_size()
    if not writer.is_closing() and backlog_bytes <= TCP_BACKLOG_BYTES:
        writer.write(data)
