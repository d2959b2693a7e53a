"""The simulator as a process on free ports, for tests."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def configured(directory: Path, **changes: Any) -> tuple[Path, dict[str, Any]]:
    """Write a configuration on free ports."""
    config = {
        "mavlink": [f"udpout://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"],
        "zenoh": {"listen": [f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"]},
        **changes,
    }
    path = directory / "sitl.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    return path, config


def command(path: Path) -> list[str]:
    return [sys.executable, "-m", "sitl", "--config", str(path)]


@contextmanager
def running(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Run the simulator until it says that it is ready; stop it and check how it ended."""
    with subprocess.Popen(command(path), stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            lines = iter(process.stderr.readline, "")
            assert any("ready" in line for line in lines)
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=60.0) == 0
