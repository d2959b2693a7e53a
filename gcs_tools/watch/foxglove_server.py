"""Serves the live flight to Foxglove and Lichtblick over a WebSocket; nothing can be sent back."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from foxglove import Context, start_server

from gcs_tools.console.errors import CommandError
from gcs_tools.export.foxglove_channels import foxglove_channels
from gcs_tools.export.scene import Scene
from gcs_tools.watch.feed import Feed
from onboard.recording.messages import Record


@contextlib.contextmanager
def serving_foxglove(feed: Feed, vehicle: str, host: str, port: int) -> Iterator[str]:
    """Serve records and scene of a feed while the context lasts; yield the URL.

    Args:
        feed: of the daemon's records.
        vehicle: name of the server in the viewer.
        host: address to listen on.
        port: 0 for any that is free.

    Raises:
        CommandError: the address cannot be listened on.
    """
    context = Context()
    try:
        server = start_server(name=f"Clearway {vehicle}", host=host, port=port, context=context)
    except (RuntimeError, OSError) as error:
        raise CommandError(f"{host}:{port}: cannot be served on: {error}") from error
    # Zenoh may call from several threads.
    lock = threading.Lock()
    with foxglove_channels(context, Scene()) as channels:

        def send(record: Record) -> None:
            with lock:
                channels.send(record)

        feed.on_record = send
        try:
            yield f"ws://{host}:{server.port}"
        finally:
            feed.on_record = None
            server.stop()
