"""The asyncio edge of the simulator: MAVLink connection URLs as sockets.

| URL | socket | links |
|---|---|---|
| ``udpout://host:port`` | sends to that address | one |
| ``udpin://host:port`` | bound there | one for each address that sends to it |
| ``tcpin://host:port`` | listens there | one for each client |
"""

from __future__ import annotations

import asyncio
import itertools
from abc import abstractmethod
from collections.abc import Callable
from typing import Protocol, cast
from urllib.parse import urlsplit

from sitl.autopilot.protocol.link import split_frames

_DATAGRAM_LENGTH = 1400  # below the payload of an Ethernet frame
_ADDRESSES_MAX = 32  # of one UDP port; further addresses are ignored
_TCP_BACKLOG_BYTES = 1 << 20  # a client that does not read is dropped

Send = Callable[[bytes], None]
Address = tuple[str, int]


class TransportError(RuntimeError):
    """A URL that cannot be used; the message names it and the reason."""


class LinkOwner(Protocol):
    """What the sockets connect to: the simulated vehicle."""

    @abstractmethod
    def link_opened(self, link: int, send: Send) -> None:
        """A peer can be reached with ``send``."""

    @abstractmethod
    def link_received(self, link: int, data: bytes) -> None:
        """Bytes have arrived."""

    @abstractmethod
    def link_closed(self, link: int) -> None:
        """The peer has disconnected."""


class Transport:
    """All sockets of one vehicle; link numbers are never used twice."""

    def __init__(self, owner: LinkOwner) -> None:
        self._owner = owner
        self._links = itertools.count()
        self._closers: list[Callable[[], None]] = []

    async def open(self, url: str) -> None:
        """Open the socket of one URL.

        Raises:
            TransportError: not a URL of the table above, or the port cannot be opened.
        """
        scheme, address = parse_url(url)
        loop = asyncio.get_running_loop()
        try:
            if scheme == "tcpin":
                server = await loop.create_server(
                    lambda: _TcpClient(self._owner, next(self._links)), *address
                )
                self._closers.append(server.close)
                return
            transport: asyncio.DatagramTransport
            if scheme == "udpin":
                transport, _ = await loop.create_datagram_endpoint(
                    lambda: _UdpServer(self._owner, self._links), local_addr=address
                )
            else:
                transport, _ = await loop.create_datagram_endpoint(
                    lambda: _UdpClient(self._owner, self._links), remote_addr=address
                )
            self._closers.append(transport.close)
        except OSError as error:
            raise TransportError(f"{url}: {error.strerror or error}") from error

    def close(self) -> None:
        """Close every socket."""
        for close in self._closers:
            close()
        self._closers.clear()


def parse_url(url: str) -> tuple[str, Address]:
    """Return scheme and (host, port) of a MAVLink connection URL.

    Raises:
        TransportError: the scheme is not one of the module's table, or host or port are missing.
    """
    refusal = f"{url}: expected udpout://, udpin:// or tcpin:// with host:port"
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:  # not a port, or an unclosed bracket
        raise TransportError(refusal) from error
    if parts.scheme not in {"udpout", "udpin", "tcpin"} or not parts.hostname or not port:
        raise TransportError(refusal)
    return parts.scheme, (parts.hostname, port)


class _UdpClient(asyncio.DatagramProtocol):
    """Sends to one address, from which alone it receives."""

    def __init__(self, owner: LinkOwner, links: itertools.count[int]) -> None:
        self._owner = owner
        self._link = next(links)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        socket = cast("asyncio.DatagramTransport", transport)
        self._owner.link_opened(self._link, lambda data: _send_datagrams(socket, data, None))

    def datagram_received(self, data: bytes, _: Address) -> None:
        self._owner.link_received(self._link, data)

    def connection_lost(self, _: Exception | None) -> None:
        self._owner.link_closed(self._link)


class _UdpServer(asyncio.DatagramProtocol):
    """Bound to a port; each address that sends to it becomes a link."""

    def __init__(self, owner: LinkOwner, links: itertools.count[int]) -> None:
        self._owner = owner
        self._numbers = links
        self._links: dict[Address, int] = {}
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, address: Address) -> None:
        if address not in self._links and not self._admit(address):
            return
        self._owner.link_received(self._links[address], data)

    def connection_lost(self, _: Exception | None) -> None:
        for link in self._links.values():
            self._owner.link_closed(link)
        self._links.clear()

    def _admit(self, address: Address) -> bool:
        transport = self._transport
        if transport is None or len(self._links) >= _ADDRESSES_MAX:
            return False
        self._links[address] = next(self._numbers)
        self._owner.link_opened(
            self._links[address], lambda data: _send_datagrams(transport, data, address)
        )
        return True


class _TcpClient(asyncio.Protocol):
    """One client of a listening socket."""

    def __init__(self, owner: LinkOwner, link: int) -> None:
        self._owner = owner
        self._link = link

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        stream = cast("asyncio.Transport", transport)

        def send(data: bytes) -> None:
            if stream.get_write_buffer_size() > _TCP_BACKLOG_BYTES:
                stream.abort()
            else:
                stream.write(data)

        self._owner.link_opened(self._link, send)

    def data_received(self, data: bytes) -> None:
        self._owner.link_received(self._link, data)

    def connection_lost(self, _: Exception | None) -> None:
        self._owner.link_closed(self._link)


def _send_datagrams(
    transport: asyncio.DatagramTransport, data: bytes, address: Address | None
) -> None:
    if transport.is_closing():
        return
    for datagram in split_frames(data, _DATAGRAM_LENGTH):
        transport.sendto(datagram, address)
