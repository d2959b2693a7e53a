"""MAVLink connection URLs, in MAVSDK's notation.

``udpin://0.0.0.0:14540``, ``udpout://HOST:PORT``, ``tcpin://HOST:PORT``, ``tcpout://HOST:PORT``,
``serial:///dev/ttyAMA0:921600``.  An IPv6 host stands in brackets: ``udpin://[::]:14540``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

SCHEMES: Final = ("udpin", "udpout", "tcpin", "tcpout", "serial")
PORT_MAX: Final = 65_535
# No UART is faster; a larger number is a typing error.
BAUD_MAX: Final = 20_000_000


class LinkError(RuntimeError):
    """A link cannot be opened; the message names the URL."""


@dataclass(frozen=True)
class LinkUrl:
    """A parsed connection URL.

    Attributes:
        url: as written.
        scheme: one of `SCHEMES`.
        target: host without brackets, or device.
        number: port, or baud rate.
    """

    url: str
    scheme: str
    target: str
    number: int

    @classmethod
    def parse(cls, url: str) -> LinkUrl:
        """Parse a URL.

        Raises:
            LinkError: scheme, host or device, or port or baud rate is missing or not valid.
        """
        scheme, _, rest = url.partition("://")
        if scheme not in SCHEMES:
            raise LinkError(f"{url}: scheme must be one of {', '.join(SCHEMES)}")
        serial = scheme == "serial"
        target, _, number = rest.rpartition(":")
        if not serial and target.startswith("[") and target.endswith("]"):
            target = target[1:-1]
        elif not serial and ":" in target:
            raise LinkError(f"{url}: write an IPv6 address in brackets: {scheme}://[::1]:PORT")
        if not _is_device(target) if serial else not _is_host(target):
            form = "/dev/DEVICE:BAUD" if serial else "HOST:PORT"
            raise LinkError(f"{url}: expected {scheme}://{form}")
        name, limit = ("baud rate", BAUD_MAX) if serial else ("port", PORT_MAX)
        # A longer number is beyond the limit, and Python refuses to parse a very long one.
        valid = number.isascii() and number.isdecimal() and len(number) <= len(str(BAUD_MAX))
        if not valid or not 1 <= int(number) <= limit:
            raise LinkError(f"{url}: {name} {number!r} is not a number from 1 to {limit}")
        return cls(url, scheme, target, int(number))


def _is_host(text: str) -> bool:
    return bool(text) and text.isprintable() and not set(text) & set(" /@[]?#")


def _is_device(text: str) -> bool:
    return text.startswith("/") and "\0" not in text
