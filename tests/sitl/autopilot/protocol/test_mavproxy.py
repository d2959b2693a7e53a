"""MAVProxy as a process against the simulator as a process, watched on another link.

The flight is the transcript of the README: `tests/test_docs.py`.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import pytest
from pymavlink import mavutil

from tests.sitl.process import configured, free_port, running

LIMIT_S = 30.0
WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.397742\t8.545594\t488.0\t1
1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t5.0\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.397842\t8.545594\t5.0\t1
"""


class Console:
    """MAVProxy's prompt: lines in, and what it has printed so far."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._input = process.stdin
        self._text = ""
        self._changed = threading.Condition()
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def _read(self, output: TextIO) -> None:
        while text := output.read(1):
            with self._changed:
                self._text += text
                self._changed.notify_all()

    def say(self, line: str) -> None:
        self._input.write(line + "\n")
        self._input.flush()

    def expect(self, words: str) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: words in self._text, LIMIT_S), self._text


class Observer:
    """A second client, to see what the vehicle really does."""

    def __init__(self, port: int) -> None:
        self._link: Any = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=254, source_component=1
        )
        self._link.wait_heartbeat(timeout=LIMIT_S)
        self._link.mav.command_long_send(1, 1, 511, 0, 32, 50_000, 0, 0, 0, 0, 0)

    def wait_for(self, kind: str, condition: str) -> None:
        """Wait for a message for which pymavlink's condition holds."""
        assert self._link.recv_match(
            type=kind, condition=condition, blocking=True, timeout=LIMIT_S
        ), (kind, condition)

    def close(self) -> None:
        self._link.close()


@contextmanager
def mavproxy(directory: Path, **config: Any) -> Iterator[tuple[Console, Observer]]:
    """The simulator, MAVProxy connected to it, and an observer."""
    udp, tcp = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    urls = [f"udpout://127.0.0.1:{udp}", f"tcpin://127.0.0.1:{tcp}"]
    path, _ = configured(directory, mavlink=urls, speed_factor=3.0, **config)
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    assert script is not None
    command = [
        # Unbuffered: through a pipe its words would come when some kilobytes of them are together.
        *(sys.executable, "-u", script, f"--master=udpin:127.0.0.1:{udp}"),
        *("--state-basedir", str(directory), "--default-modules", "mode,arm,wp,param,cmdlong,misc"),
    ]
    with (
        running(path),
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=directory,
        ) as process,
    ):
        observer = Observer(tcp)
        try:
            yield Console(process), observer
        finally:
            observer.close()
            process.terminate()
            assert process.stdin is not None
            process.stdin.close()  # it waits at its prompt
            process.wait(timeout=60.0)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_mavproxy_loads_and_lists_waypoints(tmp_path: Path, flavour: str) -> None:
    (tmp_path / "plan.txt").write_text(WAYPOINTS, encoding="utf-8")
    with mavproxy(tmp_path, flavour=flavour) as (console, observer):
        console.expect("parameters")
        console.say("wp load plan.txt")
        console.expect("Sent all 3 waypoints")
        console.expect("TYPE_MISSION: ACCEPTED")
        console.say("wp list")
        console.expect("16 3 47.3978420000 8.5455940000 5.000000")
        console.say("long DO_SET_MODE 129 4 6" if flavour == "px4" else "mode LAND")
        mode = 4 << 16 | 6 << 24 if flavour == "px4" else 9
        observer.wait_for("HEARTBEAT", f"HEARTBEAT.custom_mode == {mode}")
