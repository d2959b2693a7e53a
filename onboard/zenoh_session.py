"""Opens Zenoh sessions for the daemon, the simulation and the operator's tools."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from typing import Final

import zenoh
import zenoh.ext

from onboard.files.yaml_file import FileError
from onboard.files.zenoh_endpoints import ZenohEndpoints

# Peers that only connect never reach each other, even through a router: each needs a listener whose
# address the others can learn.  This one serves processes of this computer.
_LOOPBACK: Final = "tcp/127.0.0.1:0"
_LOOPBACK_ADDRESS: Final = "127.0.0.1"
# How long a client waits for its router; a peer waits in the background, without limit.
_CLIENT_PATIENCE_MS: Final = 5000
# Of each publisher of static transforms: it repeats all that it has, or has one message for each.
_HISTORY_SAMPLES: Final = 100


@contextlib.contextmanager
def open_session(endpoints: ZenohEndpoints) -> Iterator[zenoh.Session]:
    """Open a Zenoh session, and always close it: an open one keeps the process alive.

    Args:
        endpoints: how to join.

    Raises:
        FileError: the ``config_file`` cannot be used.
        zenoh.ZError: an endpoint is malformed or in use, or a client finds no router.
    """
    session = zenoh.open(_configuration(endpoints))
    try:
        yield session
    finally:
        session.close()  # type: ignore[no-untyped-call]  # untyped in its own stubs


def subscribe_with_history(
    session: zenoh.Session, key: str, receive: Callable[[zenoh.Sample], None]
) -> None:
    """Subscribe to what is published, and to the last that was published before.

    ROS 2 publishes static transforms once, and keeps them for those who come later (durability
    "transient local"), which rmw_zenoh and zenoh-bridge-ros2dds do by Zenoh's advanced publisher.

    Args:
        session: an open session.
        key: key expression.
        receive: called in Zenoh's thread.
    """
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=_HISTORY_SAMPLES)
    zenoh.ext.declare_advanced_subscriber(session, key, receive, history=history)


def _configuration(endpoints: ZenohEndpoints) -> zenoh.Config:
    if endpoints.config_file is not None:
        path = endpoints.config_file
        try:
            return zenoh.Config.from_file(str(path))
        except zenoh.ZError as error:
            # Zenoh appends a position in its own source.
            reason = " ".join(str(error).partition(" at /")[0].split())
            raise FileError(f"{path}: not a Zenoh configuration: {reason}") from error
    config = zenoh.Config()
    listen = endpoints.listen
    if endpoints.connect or listen:
        config.insert_json5("scouting/multicast/enabled", "false")
    elif endpoints.mode == "peer":
        # Nothing listens beyond this computer unless an endpoint says so.
        config.insert_json5("scouting/multicast/interface", json.dumps(_LOOPBACK_ADDRESS))
        listen = (_LOOPBACK,)
    if endpoints.mode == "client":
        listen = ()
        config.insert_json5("connect/timeout_ms", json.dumps(_CLIENT_PATIENCE_MS))
    elif endpoints.connect and not listen:
        listen = (_LOOPBACK,)
    config.insert_json5("mode", json.dumps(endpoints.mode))
    config.insert_json5("connect/endpoints", json.dumps(endpoints.connect))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    return config
