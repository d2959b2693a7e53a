"""The simulator as a process: real sockets, the real `mavsdk` package, a real Zenoh peer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import queue
import signal
import socket
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
import zenoh
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mcap.reader import make_reader

from onboard.files.obstacle_field import ObstacleField
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.zenoh_session import open_session
from sitl.__main__ import main
from sitl.config import SitlConfig
from sitl.environment.formats.ros2_topics import Ros2Publisher, Ros2Topic
from sitl.environment.sensor import SensorConfig
from sitl.environment.sensor_message import ZenohMessage
from sitl.live.service import Bus, LiveSimulator
from tests.sitl.process import configured, free_port, running


async def fly(url: str) -> float:
    """Do what an operator does; return the height reached [m]."""
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as sdk:
        await sdk.add_any_connection(url)
        system = await sdk.first_autopilot(timeout_s=60.0)
        assert system is not None
        telemetry, action = TelemetryAsync(system), ActionAsync(system)
        async for healthy in telemetry.subscribe_health_all_ok():
            if healthy:
                break
        await action.set_takeoff_altitude(1.0)
        await action.arm()
        await action.takeoff()
        height_m = 0.0
        async for motion in telemetry.subscribe_position_velocity_ned():
            height_m = -motion.position.down_m
            if height_m > 0.9:
                break
        await action.land()
        async for armed in telemetry.subscribe_armed():
            if not armed:
                break
        return height_m


def test_mavsdk_connects_arms_takes_off_and_lands(tmp_path: Path) -> None:
    path, config = configured(
        tmp_path, parameters={"COM_DISARM_LAND": 0.1}, truth_log=str(tmp_path / "truth.mcap")
    )
    with running(path):
        url = config["mavlink"][0].replace("udpout", "udpin")
        height_m = asyncio.run(asyncio.wait_for(fly(url), timeout=120.0))
    assert height_m == pytest.approx(1.0, abs=0.15)
    with (tmp_path / "truth.mcap").open("rb") as file:
        records = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages()]
    assert max(-record["position_ned_m"][2] for record in records) == pytest.approx(1.0, abs=0.1)
    assert records[-1]["position_ned_m"][2] == pytest.approx(0.0, abs=0.01)
    assert all(a["time_unix_s"] < b["time_unix_s"] for a, b in pairwise(records))


def putting_into(messages: queue.Queue[dict[str, Any]]) -> Callable[[zenoh.Sample], None]:
    return lambda sample: messages.put(json.loads(sample.payload.to_bytes()))


def test_detections_and_truth_on_zenoh_and_a_tcp_client(tmp_path: Path) -> None:
    field = tmp_path / "field.yaml"
    field.write_text("[{id: oak, center_ned_m: [6, 0], size_m: [1, 1]}]", encoding="utf-8")
    tcp_port = free_port(socket.SOCK_STREAM)
    path, config = configured(
        tmp_path, vehicle="kite", field="field.yaml", mavlink=[f"tcpin://127.0.0.1:{tcp_port}"]
    )
    with running(path):
        settings = zenoh.Config()
        settings.insert_json5("scouting/multicast/enabled", "false")
        settings.insert_json5("connect/endpoints", json.dumps(config["zenoh"]["listen"]))
        frames: queue.Queue[dict[str, Any]] = queue.Queue()
        truths: queue.Queue[dict[str, Any]] = queue.Queue()
        with zenoh.open(settings) as session:
            session.declare_subscriber("clearway/kite/obstacles", putting_into(frames))
            session.declare_subscriber("clearway/kite/truth", putting_into(truths))
            first, second = frames.get(timeout=60.0), frames.get(timeout=60.0)
            truth = truths.get(timeout=60.0)
            tokens = [
                str(reply.ok.key_expr)
                for reply in session.liveliness().get("clearway/kite/obstacles/*")
                if reply.ok is not None
            ]
        assert tokens == ["clearway/kite/obstacles/front"]
        assert second["sequence"] == first["sequence"] + 1
        assert [obstacle["id"] for obstacle in first["obstacles"]] == ["oak"]
        assert truth["clearance_m"] == pytest.approx(5.2)
        assert truth["collisions"] == 0
        with socket.create_connection(("127.0.0.1", tcp_port), timeout=60.0) as client:
            assert client.recv(1) == b"\xfd"


def test_what_start_up_takes_makes_no_stamp_late(monkeypatch: pytest.MonkeyPatch) -> None:
    config = SitlConfig(mavlink=(f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}",))
    made_s = time.monotonic()
    monkeypatch.setattr("sitl.live.service.time.monotonic", lambda: made_s)
    simulator = LiveSimulator(config, ObstacleField.of([]))
    monkeypatch.setattr("sitl.live.service.time.monotonic", lambda: made_s + 2.0)
    stop = asyncio.Event()
    stop.set()
    asyncio.run(simulator.run(stop, session=MagicMock()))
    assert simulator.scene.vehicle.truth.time_s == pytest.approx(2.0, abs=0.01)


def test_a_sensor_that_speaks_ros_2_has_the_key_and_the_token_of_its_topic() -> None:
    sensor = SensorConfig(source="lidar", publishes="laserscan", ros2=Ros2Topic(topic="/scan"))
    config = SitlConfig(vehicle="kite", sensors=(sensor,))
    publisher = Ros2Publisher(sensor.ros2, "laserscan", "lidar")
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    samples: queue.Queue[zenoh.Sample] = queue.Queue()
    with (
        open_session(ZenohEndpoints(listen=(endpoint,))) as session,
        open_session(ZenohEndpoints(connect=(endpoint,))) as ros,
    ):
        ros.declare_subscriber("0/scan/**", samples.put)
        bus = Bus(session, config, [publisher])
        message = ZenohMessage("lidar", b"scan", publisher.key, publisher.attachment(5.0))
        sample = None
        while sample is None:  # until the two have found each other
            bus.publish(message)
            with contextlib.suppress(queue.Empty):
                sample = samples.get(timeout=0.1)
        tokens = [
            str(reply.ok.key_expr)
            for key in ("@ros2_lv/**", "clearway/kite/obstacles/*")
            for reply in ros.liveliness().get(key)
            if reply.ok is not None
        ]
    assert str(sample.key_expr) == publisher.key
    assert sample.payload.to_bytes() == b"scan"
    assert sample.attachment is not None
    assert sample.attachment.to_bytes() == message.attachment
    assert tokens == [publisher.token(tokens[0].split("/")[2])]


def test_several_vehicles_in_one_process(tmp_path: Path) -> None:
    ports = [free_port(socket.SOCK_STREAM) for _ in range(3)]
    names = ["kite", "lark", "wren"]
    fleet = [
        {
            "vehicle": name,
            "system_id": number,
            "mavlink": [f"tcpin://127.0.0.1:{port}"],
            "start": {"position_ned_m": [0.0, 5.0 * number, -3.0]},
        }
        for number, (name, port) in enumerate(zip(names, ports, strict=True), 1)
    ]
    path, config = configured(tmp_path, **fleet[0], fleet=fleet[1:])
    with running(path):
        settings = zenoh.Config()
        settings.insert_json5("scouting/multicast/enabled", "false")
        settings.insert_json5("connect/endpoints", json.dumps(config["zenoh"]["listen"]))
        with zenoh.open(settings) as session:
            for number, name in enumerate(names, 1):
                truths: queue.Queue[dict[str, Any]] = queue.Queue()
                session.declare_subscriber(f"clearway/{name}/truth", putting_into(truths))
                position = truths.get(timeout=60.0)["position_ned_m"]
                assert position == pytest.approx([0.0, 5.0 * number, -3.0], abs=0.05)
        for number, port in enumerate(ports, 1):
            with socket.create_connection(("127.0.0.1", port), timeout=60.0) as client:
                assert client.recv(10)[5] == number  # the sender's system id


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"sistem_id": 1}, "sistem_id"),
        ({"fleet": [{"vehicle": "b", "system_id": 1, "mavlink": []}]}, "the same system_id"),
        (
            {"fleet": [{"vehicle": "b", "system_id": 2, "mavlink": ["udp://x:1"]}]},
            "udp://x:1",
        ),
        ({"multirotor": {"mass_kg": -1.0}}, "multirotor.mass_kg [kg] = -1.0"),
        ({"parameters": {"NO_SUCH": 1.0}}, "NO_SUCH"),
        ({"parameters": {"MPC_TILTMAX_AIR": 95.0}}, "MPC_TILTMAX_AIR = 95"),
        ({"mavlink": ["udp://127.0.0.1:1"]}, "udp://127.0.0.1:1"),
        ({"mavlink": ["udpin://127.0.0.1"]}, "udpin://127.0.0.1"),
        ({"mavlink": ["udpin://127.0.0.1:99999"]}, "udpin://127.0.0.1:99999"),
        ({"mavlink": ["udpin://[::1:14550"]}, "udpin://[::1:14550"),
        ({"field": "missing.yaml"}, "missing.yaml"),
        ({"zenoh": {"listen": ["nonsense"]}}, "nonsense"),
        ({"truth_log": "/no/such/directory/truth.mcap"}, "/no/such/directory"),
    ],
)
def test_unusable_configurations_end_with_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], expected: str
) -> None:
    path, _ = configured(tmp_path, **changes)
    assert main(["--config", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("clearway-sitl: error: ")
    assert expected in line


@pytest.mark.parametrize(
    ("scheme", "kind"), [("udpin", socket.SOCK_DGRAM), ("tcpin", socket.SOCK_STREAM)]
)
def test_port_in_use_names_the_url(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    scheme: str,
    kind: socket.SocketKind,
) -> None:
    with socket.socket(socket.AF_INET, kind) as holder:
        holder.bind(("127.0.0.1", 0))
        if kind is socket.SOCK_STREAM:
            holder.listen()
        url = f"{scheme}://127.0.0.1:{holder.getsockname()[1]}"
        path, _ = configured(tmp_path, mavlink=[url])
        assert main(["--config", str(path)]) == 2
    assert url in capsys.readouterr().err


def test_zenoh_port_in_use_names_the_endpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        path, _ = configured(tmp_path, zenoh={"listen": [endpoint]})
        assert main(["--config", str(path)]) == 2
    assert endpoint in capsys.readouterr().err


def test_starts_although_no_zenoh_peer_answers(tmp_path: Path) -> None:
    silent = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    path, _ = configured(tmp_path, zenoh={"listen": [], "connect": [silent]})
    with running(path) as process:
        process.send_signal(signal.SIGHUP)  # a terminal that closes
