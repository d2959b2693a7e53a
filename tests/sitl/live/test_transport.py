"""MAVLink connection URLs."""

import asyncio

import pytest

from sitl.live.transport import Send, Transport, TransportError, parse_url


class Owner:
    """Keeps what the sockets report."""

    def __init__(self) -> None:
        self.opened: dict[int, Send] = {}
        self.received: list[tuple[int, bytes]] = []
        self.closed: list[int] = []
        self.has_received = asyncio.Event()
        self.has_closed = asyncio.Event()

    def link_opened(self, link: int, send: Send) -> None:
        self.opened[link] = send

    def link_received(self, link: int, data: bytes) -> None:
        self.received.append((link, data))
        self.has_received.set()

    def link_closed(self, link: int) -> None:
        self.closed.append(link)
        self.has_closed.set()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("udpout://127.0.0.1:14550", ("udpout", ("127.0.0.1", 14550))),
        ("udpin://192.168.1.2:14540", ("udpin", ("192.168.1.2", 14540))),
        ("tcpin://localhost:5760", ("tcpin", ("localhost", 5760))),
        ("udpout://[::1]:14550", ("udpout", ("::1", 14550))),
    ],
)
def test_urls_have_scheme_host_and_port(url: str, expected: tuple[str, tuple[str, int]]) -> None:
    assert parse_url(url) == expected


@pytest.mark.parametrize(
    "url",
    [
        "",
        "127.0.0.1:14550",
        "serial:///dev/ttyS0",
        "tcpout://127.0.0.1:5760",
        "udpout://127.0.0.1",
        "udpout://:14550",
        "udpout://127.0.0.1:0",
        "udpout://127.0.0.1:70000",
        "udpout://127.0.0.1:port",
        "udpout://[::1:14550",
    ],
)
def test_other_urls_are_refused_with_what_is_expected(url: str) -> None:
    with pytest.raises(TransportError, match="expected udpout://, udpin:// or tcpin://"):
        parse_url(url)


def test_a_port_that_is_taken_is_an_error_that_names_the_url() -> None:
    async def opened_on_a_taken_port() -> None:
        transport = Transport(Owner())
        server = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        try:
            await transport.open(f"tcpin://127.0.0.1:{port}")
        finally:
            server.close()
            transport.close()

    with pytest.raises(TransportError, match=r"tcpin://127\.0\.0\.1:\d+: "):
        asyncio.run(opened_on_a_taken_port())


def test_a_client_of_a_port_becomes_a_link_and_gets_answers() -> None:
    async def exchanged() -> tuple[Owner, bytes]:
        owner = Owner()
        probe = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
        port = probe.sockets[0].getsockname()[1]
        probe.close()
        await probe.wait_closed()
        transport = Transport(owner)
        await transport.open(f"tcpin://127.0.0.1:{port}")
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"hello")
        await owner.has_received.wait()
        owner.opened[0](b"answer")
        answer = await asyncio.wait_for(reader.readexactly(6), 5.0)
        writer.close()
        await owner.has_closed.wait()
        transport.close()
        return owner, answer

    owner, answer = asyncio.run(asyncio.wait_for(exchanged(), 10.0))
    assert owner.received == [(0, b"hello")]
    assert answer == b"answer"
    assert owner.closed == [0]
