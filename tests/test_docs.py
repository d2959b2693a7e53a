"""What the documentation tells people to type: it runs, and does what it says."""

import queue
import re
import shlex
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from onboard.config import ZenohEndpoints, load_contract
from onboard.contract import assess
from onboard.daemon import open_session
from onboard.obstacles import parse_frame

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def contract_commands() -> list[str]:
    shell = "".join(block for page in PAGES for block in blocks(page, "sh"))
    return re.findall(r"^clearway contract .*$", shell.replace("\\\n", ""), re.MULTILINE)


@pytest.mark.parametrize("command", contract_commands())
def test_contract_commands_work_as_written(command: str) -> None:
    words = shlex.split(command, comments=True)
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", *words[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("vehicle", ["px4", "ardupilot"])
def test_contracts_to_start_from_comply(vehicle: str) -> None:
    assessment = assess(load_contract(ROOT / "config" / f"{vehicle}_contract.yaml"))
    assert assessment.compliant
    plan_jerk_mps3 = assessment.limits.right_mps2 / assessment.terms.attitude_lag_s
    assert plan_jerk_mps3 <= 10.0  # as the vehicles' numbers were measured


def test_the_sensor_of_the_vehicle_page_is_understood() -> None:
    (program,) = blocks(ROOT / "docs" / "vehicles.md", "python")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endpoints = ZenohEndpoints(listen=(f"tcp/127.0.0.1:{port}",))
    received: queue.Queue[bytes] = queue.Queue()

    def receive(sample: zenoh.Sample) -> None:
        received.put(sample.payload.to_bytes())

    with open_session(endpoints) as session:
        session.declare_subscriber("clearway/vehicle/obstacles", receive)
        sensor = subprocess.Popen([sys.executable, "-c", program.replace("7447", str(port))])
        try:
            frames = [parse_frame(received.get(timeout=20.0)) for _ in range(3)]
        finally:
            sensor.terminate()
            sensor.wait()
    assert [frame.sequence - frames[0].sequence for frame in frames] == [0, 1, 2]
    assert frames[0].obstacles[0].id == "7"
