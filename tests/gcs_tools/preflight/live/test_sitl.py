"""Pre-flight against the bundled SITL in both flavours: processes, UDP, Zenoh."""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh
from pymavlink import mavutil

from gcs_tools.console.processes import Children, free_ports
from gcs_tools.preflight.arm_authorization import AUTHORIZER_SYSTEM_ID
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.zenoh_session import open_session
from sitl.config import HomeConfig
from tests.gcs_tools.running import CONFIG, Clearway, until
from tests.gcs_tools.terminal import Terminal, terminal

pytestmark = pytest.mark.real_time

CONTRACT, MISSION = CONFIG / "paper_contract.yaml", CONFIG / "paper_mission.yaml"
# The paper's vehicle is quicker than PX4 with its default gains of 6.5.
PX4 = {"COM_OF_LOSS_T": 0.5, "COM_RC_IN_MODE": 4, "MC_ROLL_P": 11.0, "MC_PITCH_P": 11.0}
ARDUPILOT = {"GUID_TIMEOUT": 0.5, "PSC_JERK_XY": 20.0, "FS_THR_ENABLE": 0}


class Site:
    """A vehicle and its daemon, running."""

    def __init__(self, directory: Path, flavour: str, parameters: dict[str, float]) -> None:
        self.ports = free_ports(5)
        daemon, operator, tuner, sitl_bus, daemon_bus = self.ports
        self.endpoints = [f"tcp/127.0.0.1:{port}" for port in (daemon_bus, sitl_bus)]
        links = [f"udpout://127.0.0.1:{port}" for port in (daemon, operator, tuner)]
        self.files: dict[str, dict[str, Any]] = {
            "sitl": {
                "flavour": flavour, "mavlink": links, "parameters": parameters,
                "zenoh": {"listen": self.endpoints[1:]},
            },
            "onboard": {
                "contract": str(CONTRACT), "mission": str(MISSION), "require_preflight": True,
                "mavlink": {"url": f"udpin://127.0.0.1:{daemon}"},
                "zenoh": {"listen": self.endpoints[:1], "connect": self.endpoints[1:]},
                "log_file": "flight.mcap",
            },
            "bus": {"connect": self.endpoints},
        }  # fmt: skip
        for name, document in self.files.items():
            (directory / f"{name}.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
        self.directory = directory

    def start(self, children: Children) -> None:
        for module in ("sitl", "onboard"):
            log = self.directory / f"{module}.log"
            config = str(self.directory / f"{module}.yaml")
            children.start(module, module, "--config", config, log_path=log)
        until(lambda: "ready" in (self.directory / "sitl.log").read_text(), timeout_s=60.0)
        until(lambda: "ready" in (self.directory / "onboard.log").read_text())

    def arguments(self, *more: str) -> list[str]:
        return [
            "preflight", "--contract", str(CONTRACT), "--mission", str(MISSION),
            "--vehicle", f"udpin://127.0.0.1:{self.ports[1]}",
            "--zenoh-config", str(self.directory / "bus.yaml"), "--endurance", "900",
            "--format", "json", *more,
        ]  # fmt: skip

    def cleared(self) -> bool:
        with open_session(ZenohEndpoints(connect=(self.endpoints[0],))) as session:
            statuses = session.declare_subscriber(
                "clearway/vehicle/status", zenoh.handlers.FifoChannel(1)
            )
            status: dict[str, Any] = json.loads(statuses.recv().payload.to_bytes())
        return bool(status["cleared"])

    def see_once(self, source: str) -> None:
        """Send one frame of a sensor that is called otherwise from then on."""
        frame = {
            "version": 1, "source": source, "sequence": 0, "stamp_unix_s": time.time(),
            "frame": "local_ned", "range_m": 12.0, "field_of_view_deg": 120.0, "obstacles": [],
        }  # fmt: skip
        with open_session(ZenohEndpoints(connect=(self.endpoints[0],))) as session:
            key = "clearway/vehicle/obstacles"
            with session.declare_publisher(key) as publisher:
                until(lambda: publisher.matching_status)
                publisher.put(json.dumps(frame).encode())

    def tune(self, name: str, value: int) -> None:
        """Set an integer parameter as any ground station would."""
        link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self.ports[2]}", source_system=200)
        try:
            assert link.wait_heartbeat(timeout=60.0)
            # PX4 takes integers bit by bit, ArduPilot as plain floats.
            bitwise = self.files["sitl"]["flavour"] == "px4"
            sent = struct.unpack("<f", struct.pack("<i", value))[0] if bitwise else float(value)
            kind = mavutil.mavlink.MAV_PARAM_TYPE_INT32
            link.mav.param_set_send(1, 1, name.encode(), sent, kind)
            assert link.recv_match(type="PARAM_VALUE", blocking=True, timeout=60.0)
        finally:
            link.close()

    def arm(self) -> int:
        """Ask to arm as any ground station would; return the MAV_RESULT."""
        link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self.ports[2]}", source_system=200)
        try:
            assert link.wait_heartbeat(timeout=60.0)
            link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
            ack = link.recv_match(
                condition="COMMAND_ACK.command == 400", type="COMMAND_ACK",
                blocking=True, timeout=60.0,
            )  # fmt: skip
            return int(ack.result)
        finally:
            link.close()

    def fence(self, radius_m: float) -> None:
        """Have the vehicle stay within a circle around its home, as any ground station would."""
        link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self.ports[2]}", source_system=200)
        mission_type, global_frame = mavutil.mavlink.MAV_MISSION_TYPE_FENCE, 0
        circle = mavutil.mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
        home = HomeConfig()
        at = (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), 0.0)
        try:
            assert link.wait_heartbeat(timeout=60.0)
            link.mav.mission_count_send(1, 1, 1, mission_type)
            assert link.recv_match(type="MISSION_REQUEST_INT", blocking=True, timeout=60.0)
            parameters = (radius_m, 0.0, 0.0, 0.0)
            link.mav.mission_item_int_send(
                1, 1, 0, global_frame, circle, 0, 1, *parameters, *at, mission_type
            )
            assert link.recv_match(type="MISSION_ACK", blocking=True, timeout=60.0).type == 0
        finally:
            link.close()

    @contextmanager
    def authorising(self, *more: str, code: int) -> Iterator[tuple[dict[str, str], Terminal]]:
        """Check at a terminal, and while the context lasts answer requests to arm by the verdict.

        Args:
            more: arguments of the check.
            code: with which the check has to exit.
        """
        path = self.directory / "preflight.json"
        arguments = self.arguments("--authorize", "60", "-o", str(path), *more)
        with terminal() as screen:
            answering = subprocess.Popen(
                [sys.executable, "-m", "gcs_tools", *arguments], stderr=screen.written_to
            )
            try:
                until(lambda: any("answering arm requests for 60 s" in x for x in screen.lines))
                yield verdicts(path.read_bytes()), screen
            finally:
                answering.send_signal(signal.SIGINT)
                assert answering.wait(timeout=60.0) == code


def verdicts(written: str | bytes) -> dict[str, str]:
    """What was found live, by subject and name."""
    found = json.loads(written)["live"]
    return {f"{each['subject']} {each['name']}": each["verdict"] for each in found}


@contextmanager
def site(directory: Path, flavour: str, parameters: dict[str, float]) -> Iterator[Site]:
    with Children() as children:
        running = Site(directory, flavour, parameters)
        running.start(children)
        yield running


def test_px4_is_cleared_and_may_arm_as_long_as_all_is_well(tmp_path: Path) -> None:
    asks = {
        "COM_ARM_AUTH_REQ": 1, "COM_ARM_AUTH_ID": AUTHORIZER_SYSTEM_ID, "COM_ARM_AUTH_TO": 1.0,
        "COM_DISARM_PRFLT": 1.0,
    }  # fmt: skip
    temporarily_rejected, accepted = 1, 0
    with site(tmp_path, "px4", {**PX4, **asks}) as place:
        assert place.arm() == temporarily_rejected  # nobody answers
        assert not place.cleared()
        with place.authorising(code=0) as (found, _):
            assert found["daemon contract"] == found["daemon flight authorization"] == "holds"
            assert found["vehicle COM_OBL_RC_ACT"] == found["vehicle geofence areas"] == "holds"
            assert place.cleared()
            assert place.arm() == accepted
        place.tune("COM_OBL_RC_ACT", 3)
        with place.authorising("--set", "vehicle.radius_m=0.29", code=1) as (found, screen):
            assert found["daemon contract"] == found["vehicle COM_OBL_RC_ACT"] == "broken"
            # What the check before granted is withdrawn; on the ground it has disarmed meanwhile.
            assert not place.cleared()
            assert place.arm() == temporarily_rejected
        assert screen.shares == sorted(screen.shares)
        assert max(screen.shares) == round(100 * 12 / 13)  # the last of thirteen steps was begun
        assert screen.estimates
        assert any("checking: telemetry rates" in line for line in screen.lines)


def test_authorizing_needs_a_vehicle(clearway: Clearway) -> None:
    ran = clearway("preflight", "--contract", str(CONTRACT), "--authorize", "10")
    assert (ran.code, "--vehicle" in ran.err) == (2, True)


def test_ardupilot_tells_what_it_lacks(clearway: Clearway, tmp_path: Path) -> None:
    with site(tmp_path, "ardupilot", ARDUPILOT) as place:
        place.fence(radius_m=60.0)
        ran = clearway(*place.arguments())
        found = verdicts(ran.out)
        assert ran.code == 0, {name: v for name, v in found.items() if v != "holds"}
        assert found["vehicle PSC_JERK_XY"] == found["vehicle geofence areas"] == "holds"
        assert "inclusion circle by " in ran.out
        place.tune("FS_THR_ENABLE", 1)
        place.see_once("spare")
        ran = clearway(*place.arguments())
        found = verdicts(ran.out)
        assert ran.code == 1
        assert found["vehicle FS_THR_ENABLE"] == "broken"
        # The daemon relies on a sensor that was heard once; what arrives here is fine.
        assert found["detections front age"] == "holds"
        assert found["daemon detections"] == "broken"
        assert not place.cleared()
