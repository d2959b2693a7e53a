"""Tells systemd that the daemon is ready, alive and stopping (sd_notify).

The protocol is one datagram of ``KEY=value`` lines to the socket that the service manager names:
https://www.freedesktop.org/software/systemd/man/latest/sd_notify.html.  Without such a name nothing
is sent.  A datagram that cannot be sent at once is dropped: no tick waits for the manager.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Mapping
from types import TracebackType
from typing import Final, Self

log = logging.getLogger(__name__)

# The manager restarts a daemon that it has not heard for the watchdog's time; the manual asks for
# twice that rate, and a dropped datagram or two must not matter.
SIGNS_PER_WATCHDOG: Final = 4.0


class ServiceManager:
    """The service manager that has started this process, if one has.

    Args:
        address: of its socket: a path, or a name that begins with ``@``; None for no manager.
        watchdog_s: how long it waits for a sign of life; None if it does not.
    """

    def __init__(self, address: str | None = None, watchdog_s: float | None = None) -> None:
        self._socket: socket.socket | None = None
        self._period_s = None if watchdog_s is None else watchdog_s / SIGNS_PER_WATCHDOG
        self._due_s = 0.0
        self._status = ""
        self._lost = False
        if address is not None:
            self._address = f"\0{address[1:]}" if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    @classmethod
    def of_environment(cls, environment: Mapping[str, str]) -> Self:
        """Return the manager that the environment names (NOTIFY_SOCKET, WATCHDOG_USEC)."""
        address = environment.get("NOTIFY_SOCKET")
        for_us = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        microseconds = environment.get("WATCHDOG_USEC", "")
        watched = for_us and microseconds.isascii() and microseconds.isdecimal()
        watchdog_s = int(microseconds) / 1e6 if watched else 0.0
        # Anything but a path or an abstract name, such as VSOCK, is not ours to reach.
        local = address is not None and address.startswith(("/", "@")) and len(address) > 1
        return cls(address if local else None, watchdog_s or None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Say that the daemon stops, for whatever reason."""
        self._send("STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def ready(self) -> None:
        """Say that the daemon serves from now on."""
        self._send("READY=1")

    def tick(self, now_s: float, status: str) -> None:
        """Say that a tick has ended, as often as the watchdog needs; the status when it changes.

        Args:
            now_s: time of the tick.
            status: one line for ``systemctl status``.
        """
        if status != self._status:
            self._status = status
            self._send(f"STATUS={status}")
        if self._period_s is not None and now_s >= self._due_s:
            self._due_s = now_s + self._period_s
            self._send("WATCHDOG=1")

    def _send(self, message: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError as error:
            if not self._lost:
                log.warning("the service manager cannot be told %s: %s", message, error)
            self._lost = True
        else:
            self._lost = False
