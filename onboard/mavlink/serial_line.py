"""A raw serial connection in the event loop, reopened when it is lost.

On termios rather than a library: pyserial-asyncio-fast and serialx lock the device by flock alone,
which other programs ignore, and queue what a slow line cannot take, where late setpoints must be
dropped.  Waiting for a device, its errors and reopening it would remain to be written here.
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import logging
import os
import termios
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Final

from onboard.mavlink.link_url import LinkError, LinkUrl

log = logging.getLogger(__name__)

RETRY_S: Final = 1.0
READ_BYTES: Final = 65_536
# Not plugged in yet, or just unplugged.
_ABSENT: Final = frozenset({errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO})


class SerialLine:
    """A serial connection to the autopilot, which waits for a device that is missing.

    Args:
        url: device and baud rate.
        receive: called in the event loop with the bytes that arrive.

    Raises:
        LinkError: the baud rate is not standard, or the device is not permitted, in use, or not
            serial.
    """

    def __init__(self, url: LinkUrl, receive: Callable[[bytes], None]) -> None:
        speed = getattr(termios, f"B{url.number}", None)
        if speed is None:
            raise LinkError(
                f"{url.url}: {url.number} baud is not a standard rate, expected one such as 57600"
            )
        self._url, self._receive, self._speed = url, receive, speed
        self._loop = asyncio.get_running_loop()
        self._descriptor: int | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._reported = ""
        try:
            self._open()
        except (OSError, termios.error) as error:
            if not isinstance(error, OSError) or error.errno not in _ABSENT:
                raise LinkError(f"{url.url}: cannot be opened: {self._reason(error)}") from error
            self._wait_for_device(error)

    def _open(self) -> None:
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK
        descriptor = os.open(self._url.target, flags)
        try:
            tty.setraw(descriptor)
            settings = termios.tcgetattr(descriptor)
            settings[4] = settings[5] = self._speed
            termios.tcsetattr(descriptor, termios.TCSANOW, settings)
            # Two processes on one device would each read half of every frame.
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        except (OSError, termios.error):
            os.close(descriptor)
            raise
        self._descriptor = descriptor
        self._loop.add_reader(descriptor, self._read, descriptor)

    def _reopen(self) -> None:
        try:
            self._open()
        except (OSError, termios.error) as error:
            self._wait_for_device(error)
        else:
            self._reported = ""
            log.info("%s: opened", self._url.url)

    def _wait_for_device(self, error: OSError | termios.error) -> None:
        reason = self._reason(error)
        if reason != self._reported:  # once, not every second
            self._reported = reason
            log.warning("%s: %s; waiting for it", self._url.url, reason)
        self._retry = self._loop.call_later(RETRY_S, self._reopen)

    def _reason(self, error: OSError | termios.error) -> str:
        number = int(error.args[0])  # termios.error is not an OSError
        match number:
            case errno.ENOTTY:
                return "not a serial device"
            case errno.EACCES | errno.EPERM:
                return f"permission denied: the user must be in the group {self._group()}"
            case errno.EBUSY:
                return "another process has opened it"
            case _:
                return os.strerror(number)

    def _group(self) -> str:
        """Return the group that may open the device; ``dialout`` if it cannot be read."""
        try:
            return Path(self._url.target).group()
        except (OSError, KeyError):
            return "dialout"

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
            self._lose()

    def _lose(self) -> None:
        log.warning("%s: serial connection lost", self._url.url)
        self._release()
        self._retry = self._loop.call_later(RETRY_S, self._reopen)

    def send(self, data: bytes) -> None:
        """Send bytes; drop them while the device is missing, and what it is too slow to take."""
        if self._descriptor is None:
            return
        try:
            written = os.write(self._descriptor, data)
        except BlockingIOError:
            written = 0
        except OSError:
            self._lose()
            return
        if written < len(data):
            log.warning("%s: too slow, dropped %d bytes", self._url.url, len(data) - written)

    def _release(self) -> None:
        if self._descriptor is not None:
            self._loop.remove_reader(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = None

    def close(self) -> None:
        """Close the device, and stop waiting for it."""
        if self._retry is not None:
            self._retry.cancel()
        self._release()
