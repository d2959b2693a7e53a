"""Signs MAVLink for MAVSDK, which cannot: a relay on loopback between it and the vehicle.

MAVSDK talks to the relay without signatures.  Only this computer's processes reach the relay, and
only for as long as the command runs; what they send it would be signed, as what they read of the
key file would be.  The relay takes the first one that sends.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_tools.vehicle.operator import UrlError
from onboard.files.mavlink_frames import FrameReader
from onboard.mavlink.connections import Link, open_link
from onboard.mavlink.link_url import LinkError
from onboard.mavlink.signing import (
    LinkSigning,
    Objection,
    is_signed,
    may_be_unsigned,
    timestamp_at,
    without_signature,
)

# The vehicle keeps one time stamp for each link id; the daemon's is another component, besides.
LINK_ID: Final = 0


class Relay(asyncio.DatagramProtocol):
    """The end of the relay that MAVSDK talks to.

    Args:
        signing: key and memory; None leaves MAVSDK to open the URL itself.
        url: of the vehicle.

    Attributes:
        url: that MAVSDK opens.
        accepted: number of messages of the vehicle that were passed on.
    """

    def __init__(self, signing: LinkSigning | None, url: str) -> None:
        self.url = url
        self._signing = signing
        self._refused: Counter[Objection] = Counter()
        self.accepted = 0
        self._to_vehicle = FrameReader(mavlink, trusts_unknown=False)
        self._from_vehicle = FrameReader(mavlink, trusts_unknown=False)
        self._link: Link | None = None
        self._local: asyncio.DatagramTransport | None = None
        self._mavsdk: tuple[str, int] | None = None

    @property
    def complaints(self) -> list[str]:
        """What of the vehicle's messages was refused, in words."""
        return [f"{number} messages were {why.value}" for why, number in self._refused.items()]

    @property
    def refuses_all(self) -> bool:
        """Whether messages were heard, and none was signed with this key."""
        return bool(self._refused) and not self.accepted

    def join(self, local: asyncio.DatagramTransport, link: Link) -> None:
        """Pass messages on between MAVSDK and the vehicle from now on."""
        self._local, self._link = local, link
        host, port = local.get_extra_info("sockname")
        self.url = f"udpout://{host}:{port}"

    def is_genuine(self, frame: bytes) -> bool:
        """Tell whether a frame may be the vehicle's."""
        return self._signing is None or self._signing.objection(frame) is None

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Sign what MAVSDK sends, and pass it on."""
        self._mavsdk = self._mavsdk or addr
        if addr != self._mavsdk or self._link is None or self._signing is None:
            return
        for message in self._to_vehicle.read(data):
            self._signing.follow_clock(time.time())
            self._link.send(self._signing.sign(bytes(message.get_msgbuf())))

    def receive(self, data: bytes) -> None:
        """Pass what the vehicle sends on to MAVSDK, if it is genuine."""
        if self._signing is None:
            return
        for message in self._from_vehicle.read(data):
            frame = bytes(message.get_msgbuf())
            objection = self._signing.accept(frame)
            if objection is not None and not (
                objection is Objection.UNSIGNED and may_be_unsigned(message)
            ):
                self._refused[objection] += 1
                continue
            self.accepted += 1
            if self._local is not None and self._mavsdk is not None:
                plain = without_signature(frame) if is_signed(frame) else frame
                self._local.sendto(plain, self._mavsdk)


@asynccontextmanager
async def signing_relay(url: str, key: bytes | None, system_id: int | None) -> AsyncIterator[Relay]:
    """Yield a relay to a vehicle; without a key it only names the vehicle's own URL.

    Args:
        url: of the vehicle, as MAVSDK takes it.
        key: 32 bytes; None for a vehicle that does not sign.
        system_id: of the vehicle; None for whichever is heard.

    Raises:
        UrlError: the URL cannot be opened.
    """
    if key is None:
        yield Relay(None, url)
        return
    relay = Relay(LinkSigning(key, LINK_ID, timestamp_at(time.time())), url)
    try:
        link = await open_link(url, relay.receive, system_id, relay.is_genuine)
    except LinkError as error:
        raise UrlError(str(error)) from error
    try:
        loop = asyncio.get_running_loop()
        local, _ = await loop.create_datagram_endpoint(lambda: relay, local_addr=("127.0.0.1", 0))
        try:
            relay.join(local, link)
            yield relay
        finally:
            local.close()
    finally:
        link.close()
