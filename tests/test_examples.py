"""The programs in examples/ run as they are, and do what they say."""

import queue
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.perception.sources.json_v1 import parse_frame
from onboard.zenoh_session import open_session
from tests.onboard.test_daemon import free_port

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SECONDS = 60.0


def run(name: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_publisher_sends_frames_that_the_daemon_reads() -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    received: queue.Queue[bytes] = queue.Queue()

    def receive(sample: zenoh.Sample) -> None:
        received.put(sample.payload.to_bytes())

    with open_session(ZenohEndpoints(listen=(address,))) as session:
        session.declare_subscriber("clearway/v7/obstacles", receive)
        run("detection_publisher.py", "--connect", address, "--vehicle", "v7", "--frames", "20")
        payloads = [received.get(timeout=SECONDS)]
        while not received.empty():
            payloads.append(received.get())
    read = [parse_frame(payload) for payload in payloads]
    first = read[0].sequence
    assert [frame.sequence for frame in read] == list(range(first, 20))
    assert [frame.stamp_unix_s for frame in read] == sorted(frame.stamp_unix_s for frame in read)
    assert {(frame.source, len(frame.obstacles)) for frame in read} == {("front", 1)}


def test_the_embedded_autonomy_avoids_and_arrives() -> None:
    said = run("embed_autonomy.py")
    order = [
        said.index(words) for words in ("control granted", "my_detector/tree", "mission flown")
    ]
    assert order == sorted(order)
    assert "violation" not in said


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_every_example_is_tested_and_named_for_contributors(path: Path) -> None:
    tests = "".join(test.read_text("utf-8") for test in (ROOT / "tests").glob("test_example*.py"))
    assert f'"{path.name}"' in tests
    assert f"examples/{path.name}" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
