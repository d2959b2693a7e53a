"""Daemons of a fleet, as processes: what their files must say, and that they hear each other."""

from __future__ import annotations

import json
import queue
import socket
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from onboard.fleet.link import KEY_PREFIX
from tests.onboard.mavlink.test_endpoint import Autopilot
from tests.onboard.test_daemon import (
    CONFIG,
    free_port,
    neighbour,
    refused,
    running,
    settings,
)

__all__ = ["settings"]  # the fixture
FLEET = CONFIG / "fleet" / "crossing.yaml"
PEERS = {"northbound": "southbound", "southbound": "northbound"}


def member(settings: dict[str, Any], name: str = "northbound") -> dict[str, Any]:
    return settings | {
        "mission": str(FLEET.parent / f"{name}_mission.yaml"),
        "geofence": str(FLEET.parent / f"{name}_geofence.yaml"),
        "fleet": {"file": str(FLEET), "name": name},
    }


@pytest.mark.parametrize(
    ("fleet", "said"),
    [
        ({"name": "upbound"}, "no vehicle is called 'upbound'"),
        ({"file": "nowhere.yaml"}, "nowhere.yaml"),
        ({"key_file": "none.key"}, "none.key"),
        ({"lane": 3.0}, "fleet.lane is not a known key"),
        ({"name": "southbound"}, "southbound"),
    ],
    ids=str,
)
def test_a_fleet_that_cannot_be_joined_is_refused(
    fleet: dict[str, Any], said: str, tmp_path: Path, settings: dict[str, Any]
) -> None:
    stated = member(settings)
    stated["fleet"] |= fleet
    assert said in refused(tmp_path, stated)


class Vehicle:
    """The autopilot of one daemon: it says where it is, and where its local frame is."""

    def __init__(self, url: str, kind: int, origin_deg: tuple[float, float]) -> None:
        self._says, self._kind = Autopilot(), kind
        self._origin_e7 = [round(each * 1e7) for each in origin_deg]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", int(url.rpartition(":")[2])))

    def speak(self) -> None:
        says = self._says
        for data in (says.heartbeat(0, armed=False, autopilot=self._kind), says.attitude()):
            self._socket.send(data)
        says.mav.gps_global_origin_send(*self._origin_e7, 0)
        self._socket.send(says.said())
        self._socket.send(says.position(0.0))

    def close(self) -> None:
        self._socket.close()


def answering(sample: zenoh.Sample) -> str | None:
    """Return who has sent a heartbeat, if it echoes one of the other's."""
    sender = str(sample.key_expr).split("/")[-2]
    with suppress(ValueError):  # our own rubbish
        if PEERS[sender] in json.loads(sample.payload.to_bytes())["echoes"]:
            return sender
    return None


def test_two_daemons_hear_each_other(tmp_path: Path, settings: dict[str, Any]) -> None:
    """On real sessions; rubbish under a peer's name is dropped, and both go on."""
    heard: queue.Queue[zenoh.Sample] = queue.Queue()
    first, second = member(settings), member(settings, "southbound")
    second["contract"] = str(CONFIG / "px4_contract.yaml")
    second["mavlink"] = {"url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"}
    second["zenoh"] = {"listen": [], "connect": first["zenoh"]["listen"]}
    second["vehicle"] = "v2"
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    with (
        running(tmp_path / "one", first) as one,
        neighbour(first) as session,
        running(tmp_path / "two", second) as two,
        closing(Vehicle(first["mavlink"]["url"], 3, (47.3973373, 8.5456870))) as north,
        closing(Vehicle(second["mavlink"]["url"], 12, (47.3981467, 8.5455010))) as south,
    ):
        session.declare_subscriber(f"{KEY_PREFIX}/*/heartbeat", heard.put)
        session.put(f"{KEY_PREFIX}/southbound/heartbeat", b"\xff{")
        session.put(f"{KEY_PREFIX}/nowhere/at_all", b"")
        missing, deadline_s = set(PEERS), time.monotonic() + 30.0
        while missing and time.monotonic() < deadline_s:
            north.speak()
            south.speak()
            with suppress(queue.Empty):
                missing.discard(answering(heard.get(timeout=0.05)))
        assert not missing
        assert (one.poll(), two.poll()) == (None, None)
