"""Serves the live view: one page, and a stream of server-sent events.  Nothing can be sent back."""

from __future__ import annotations

import contextlib
import ipaddress
import threading
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final

from gcs_tools.console.errors import CommandError
from gcs_tools.page import render
from gcs_tools.watch.feed import Feed

# How often a silent stream says that it is still there.
_KEEP_ALIVE_S: Final = 1.0


def page(vehicle: str) -> str:
    """Return the page of the live view."""
    return render("watch.html", vehicle=vehicle)


@contextlib.contextmanager
def serving(feed: Feed, vehicle: str, host: str, port: int) -> Iterator[str]:
    """Serve the page while the context lasts; yield its URL.

    Args:
        feed: what is shown.
        vehicle: its name.
        host: address to listen on.
        port: 0 for any that is free.

    Raises:
        CommandError: the address cannot be listened on.
    """
    try:
        server = _Server((host, port), _handler(feed, page(vehicle).encode(), host))
    except OSError as error:
        raise CommandError(f"{host}:{port}: cannot be served on: {error.strerror}") from error
    thread = threading.Thread(target=server.serve_forever, name="watch", daemon=True)
    thread.start()
    try:
        yield f"http://{host}:{server.server_port}/"
    finally:
        feed.close()
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True


def _handler(feed: Feed, page_bytes: bytes, host: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            """Answer with the page or the stream."""
            routes: dict[str, Callable[[], None]] = {"/": self._page, "/stream": self._stream}
            route = routes.get(self.path)
            if not _is_for(self.headers.get("Host", ""), host):
                self.send_error(HTTPStatus.FORBIDDEN)
            elif route is None:
                self.send_error(HTTPStatus.NOT_FOUND)
            else:
                # Whoever watched has gone: nothing to do.
                with contextlib.suppress(ConnectionError):
                    route()

        def _page(self) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page_bytes)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(page_bytes)

        def _stream(self) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.send_header("Connection", "close")
            self.end_headers()
            messages, count = feed.snapshot()
            while not feed.closed:
                lines = [f"data: {message.as_json()}\n\n" for message in messages]
                self.wfile.write(("".join(lines) or ": still here\n\n").encode())
                messages, count = feed.wait(count, _KEEP_ALIVE_S)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002  as inherited
            """Say nothing: the terminal belongs to the operator."""

    return Handler


def _is_for(asked: str, host: str) -> bool:
    """Tell whether a request means us.

    Some other site's name that resolves to loopback must not get at what only this computer sees.
    """
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = host == "localhost"
    name = asked.rpartition(":")[0] or asked
    return not loopback or name in {"localhost", "127.0.0.1", "[::1]", host}
