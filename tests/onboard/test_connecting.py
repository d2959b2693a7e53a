"""The recipes of docs/connecting.md against the simulated vehicle, through real sockets and ttys.

The vehicle's time is virtual, so that a busy computer only makes these tests slower.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import re
import tty
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.files.daemon_config import DaemonConfig
from onboard.files.yaml_file import validate
from onboard.mavlink.connections import open_link
from onboard.mavlink.endpoint import MavlinkEndpoint
from sitl.config import StartConfig, VehicleConfig
from sitl.vehicle.vehicle import SimulatedVehicle
from tests.onboard.mavlink.test_connections import free_port

PAGE = Path(__file__).parents[2] / "docs" / "connecting.md"
STEP_S = 0.02
GROUND_STATION = (255, 190)
Address = tuple[str, int]


class Peer:
    """A program on the vehicle's network: what it says, and what it has heard."""

    def __init__(self, system: int, component: int) -> None:
        self._codec = mavlink.MAVLink(None, system, component)
        self._reader = mavlink.MAVLink(None)
        self._reader.robust_parsing = True
        self.heard: list[Any] = []

    def said(self, message: Any) -> bytes:
        return bytes(message.pack(self._codec))

    def hear(self, data: bytes) -> None:
        self.heard += self._reader.parse_buffer(data) or []

    def senders(self, kind: str) -> set[tuple[int, int]]:
        return {
            (each.get_srcSystem(), each.get_srcComponent())
            for each in self.heard
            if each.get_type() == kind
        }


class Router(asyncio.DatagramProtocol):
    """Passes on what comes from one endpoint to all others, as mavlink-router and MAVProxy do."""

    def __init__(self) -> None:
        self._ends: list[tuple[asyncio.DatagramTransport, Address | None]] = []

    async def connect(self, port: int) -> None:
        """Add an endpoint that sends to a port (``Mode = Normal``, ``--out``)."""
        await self._open(None, ("127.0.0.1", port))

    async def listen(self, port: int) -> None:
        """Add an endpoint whose client speaks first (``Mode = Server``)."""
        await self._open(("127.0.0.1", port), None)

    async def _open(self, local: Address | None, remote: Address | None) -> None:
        router, number = self, len(self._ends)

        class End(asyncio.DatagramProtocol):
            def datagram_received(self, data: bytes, addr: Address) -> None:
                if router._ends[number][1] is None:
                    router._ends[number] = router._ends[number][0], addr
                router.pass_on(data, number)

        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            End, local_addr=local or ("127.0.0.1", 0)
        )
        self._ends.append((transport, remote))

    def pass_on(self, data: bytes, origin: int) -> None:
        for number, (transport, remote) in enumerate(self._ends):
            if number != origin and remote is not None:
                transport.sendto(data, remote)

    def close(self) -> None:
        for transport, _ in self._ends:
            transport.close()


class Flight:
    """A simulated vehicle in the air, and the daemon's end of its link."""

    def __init__(self, flavour: str = "px4") -> None:
        start = StartConfig(position_ned_m=(3.0, 2.0, -4.0))
        config = VehicleConfig.model_validate({"flavour": flavour, "start": start.model_dump()})
        self.vehicle = SimulatedVehicle(config)
        self.vehicle.autopilot.open_link(0)
        self.endpoint = MavlinkEndpoint(1, instance=7)
        self.now_s = 0.0
        self.poses_s: list[float] = []

    def receive(self, data: bytes) -> None:
        before = self.endpoint.pose
        self.endpoint.receive(data, self.now_s)
        if self.endpoint.pose is not before:
            self.poses_s.append(self.now_s)

    async def run(
        self,
        to_daemon: Callable[[bytes], None],
        to_vehicle: Callable[[bytes], None],
        steps: int = 170,
        also: Callable[[], None] = lambda: None,
    ) -> None:
        """Advance the vehicle; pass bytes on at both ends, which take a moment on their way."""
        for _ in range(steps):
            self.now_s += STEP_S
            self.vehicle.advance(self.now_s)
            if data := self.vehicle.bytes_to_send(0):
                to_daemon(data)
            also()
            await asyncio.sleep(0.001)
            self.endpoint.keep_alive(self.now_s, active=False)
            if data := self.endpoint.bytes_to_send():
                to_vehicle(data)
            await asyncio.sleep(0.001)

    def check(self) -> None:
        """Check that the daemon follows the vehicle, as often as it has asked for."""
        pose = self.endpoint.pose
        assert pose is not None
        assert pose.position_ned_m == pytest.approx((3.0, 2.0, -4.0), abs=1.5)
        last_s = [each for each in self.poses_s if each > self.now_s - 1.0]
        # Unasked, 30 a second come; two of those requested may share a datagram.
        assert len(last_s) >= 36, "the rate that was requested has not come"
        assert self.endpoint.counters.malformed_messages == 0


@contextlib.asynccontextmanager
async def udp_peer(port: int, peer: Peer) -> AsyncIterator[Callable[[bytes], None]]:
    """Open a program on a port; yield a function that answers the latest sender."""
    last: list[Address] = []

    class End(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: Address) -> None:
            last[:] = [addr]
            peer.hear(data)

    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        End, local_addr=("127.0.0.1", port)
    )
    try:
        yield lambda data: transport.sendto(data, last[0]) if last else None
    finally:
        transport.close()


def udp_port() -> int:
    import socket  # noqa: PLC0415  only its constant

    return free_port(socket.SOCK_DGRAM)


async def fly_through_a_tty(flavour: str) -> Flight:
    flight = Flight(flavour)
    autopilot, companion = pty.openpty()
    tty.setraw(autopilot)
    os.set_blocking(autopilot, False)
    link = await open_link(f"serial://{os.ttyname(companion)}:921600", flight.receive, 1)
    loop = asyncio.get_running_loop()
    loop.add_reader(autopilot, lambda: flight.vehicle.receive(os.read(autopilot, 65_536), 0))

    def to_daemon(data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(autopilot, data)

    await flight.run(to_daemon, link.send)
    loop.remove_reader(autopilot)
    link.close()
    os.close(autopilot)
    os.close(companion)
    return flight


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_a_serial_line(flavour: str) -> None:
    asyncio.run(fly_through_a_tty(flavour)).check()


async def fly_through_a_router(scheme: str, station: Peer, says: Callable[[], bytes]) -> Flight:
    """Fly behind a router that serves the daemon and a ground station."""
    flight, router = Flight(), Router()
    vehicle_port, daemon_port, station_port = (udp_port() for _ in range(3))
    await router.listen(vehicle_port)
    if scheme == "udpin":
        await router.connect(daemon_port)
    else:
        await router.listen(daemon_port)
    await router.connect(station_port)
    link = await open_link(f"{scheme}://127.0.0.1:{daemon_port}", flight.receive, 1)
    loop = asyncio.get_running_loop()

    class Vehicle(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, _: Address) -> None:
            flight.vehicle.receive(data, 0)

    transport, _ = await loop.create_datagram_endpoint(
        Vehicle, remote_addr=("127.0.0.1", vehicle_port)
    )
    async with udp_peer(station_port, station) as speak:
        await flight.run(transport.sendto, link.send, also=lambda: speak(says()))
    for each in (link, router, transport):
        each.close()
    return flight


@pytest.mark.parametrize("scheme", ["udpin", "udpout"])
def test_a_router_with_a_ground_station_beside(scheme: str) -> None:
    """As mavlink-router and MAVProxy forward: all hear all, and we take the vehicle's word only."""
    station = Peer(*GROUND_STATION)
    beat = station.said(mavlink.MAVLink_heartbeat_message(6, 8, 0, 6 << 16, 4, 3))
    flight = asyncio.run(fly_through_a_router(scheme, station, lambda: beat))
    flight.check()
    # The ground station sees the autopilot and us, each under its own number.
    assert station.senders("HEARTBEAT") == {(1, 1), (1, 196)}
    assert flight.endpoint.counters.foreign_messages > 0
    # A ground station's heartbeat does not count as a vehicle's, whatever its mode.
    assert (flight.endpoint.status.mode, flight.endpoint.status.armed) == ("LOITER", True)


def test_what_a_ground_station_commands_is_not_ours_and_another_system_no_vehicle_of_ours() -> None:
    station, other = Peer(*GROUND_STATION), Peer(2, 1)
    no_place = (0.0,) * 7
    data = b"".join(
        (
            station.said(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, *(0,) * 6)),
            station.said(mavlink.MAVLink_param_request_list_message(1, 1)),
            other.said(mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)),
            other.said(mavlink.MAVLink_local_position_ned_message(0, 99.0, 99.0, -99.0, 0, 0, 0)),
            other.said(mavlink.MAVLink_attitude_message(0, *no_place[:6])),
        )
    )
    flight = asyncio.run(fly_through_a_router("udpin", station, lambda: data))
    flight.check()
    assert flight.endpoint.status.external_control is False
    assert flight.endpoint.second_commander == ""
    # The autopilot has obeyed the ground station's own requests, and answered to it.
    assert (1, 1) in station.senders("COMMAND_ACK")
    assert (1, 1) in station.senders("PARAM_VALUE")


def test_a_companion_that_sends_setpoints_is_a_second_commander_and_one_that_does_not_is_none() -> (
    None
):
    companion = Peer(1, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    beat = companion.said(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    flight = asyncio.run(fly_through_a_router("udpin", companion, lambda: beat))
    flight.check()
    assert flight.endpoint.second_commander == ""
    assert not flight.endpoint.hears_other_daemon(flight.now_s)
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0, *(0.0,) * 9, 0.0, 0.0
    )
    said = beat + companion.said(setpoint)
    flight = asyncio.run(fly_through_a_router("udpin", companion, lambda: said))
    assert flight.endpoint.second_commander == "1/191"


def test_two_daemons_behind_one_router_hear_of_each_other() -> None:
    second = Peer(1, 196)
    beat = second.said(mavlink.MAVLink_heartbeat_message(18, 8, 0, 99, 4, 3))
    flight = asyncio.run(fly_through_a_router("udpin", second, lambda: beat))
    assert flight.endpoint.hears_other_daemon(flight.now_s)


def blocks(language: str) -> list[str]:
    """Return the examples of the page in a language."""
    return re.findall(
        rf"^```{language}\n(.*?)^```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )


def test_every_example_of_the_page_is_a_configuration() -> None:
    examples = blocks("yaml")
    assert len(examples) >= 6
    for example in examples:
        document = {"contract": "c.yaml", "mission": "m.yaml"} | yaml.safe_load(example)
        validate(document, DaemonConfig, source=example)
    urls = {yaml.safe_load(each).get("mavlink", {}).get("url", "") for each in examples}
    assert {url.partition("://")[0] for url in urls} >= {"serial", "udpin", "udpout", "tcpout"}
