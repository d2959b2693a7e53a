"""The daemon tells a service manager that it is ready, alive and stopping; here a fake one."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from onboard.service_manager import ServiceManager
from tests.onboard.test_daemon import SAID, running, settings

__all__ = ["settings"]  # a fixture


class FakeManager:
    """Listens where systemd would."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(f"\0{address[1:]}" if address.startswith("@") else address)
        self._socket.settimeout(0.05)

    def close(self) -> None:
        self._socket.close()

    def heard(self, wait_s: float = 0.0) -> list[str]:
        """Return what has arrived, and what arrives within a time."""
        messages, deadline_s = [], time.monotonic() + wait_s
        while True:
            try:
                messages.append(self._socket.recv(4096).decode())
            except TimeoutError:
                if time.monotonic() >= deadline_s:
                    return messages


@pytest.fixture(params=["path", "abstract"])
def fake(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[FakeManager]:
    name = f"@clearway-test-{os.getpid()}"
    manager = FakeManager(str(tmp_path / "notify") if request.param == "path" else name)
    yield manager
    manager.close()


def test_the_messages_in_their_order(fake: FakeManager) -> None:
    environment = {"NOTIFY_SOCKET": fake.address, "WATCHDOG_USEC": "2000000"}
    with ServiceManager.of_environment(environment) as manager:
        manager.ready()
        for tick in range(101):  # two seconds
            manager.tick(0.02 * tick, "standby" if tick < 50 else "cruise")
    heard = fake.heard()
    assert heard[:3] == ["READY=1", "STATUS=standby", "WATCHDOG=1"]
    assert heard[-1] == "STOPPING=1"
    assert heard.count("WATCHDOG=1") == 5  # four in the watchdog's time, and the first
    assert heard.count("STATUS=cruise") == 1


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"WATCHDOG_USEC": "1000"},
        {"NOTIFY_SOCKET": ""},
        {"NOTIFY_SOCKET": "@"},
        {"NOTIFY_SOCKET": "vsock:2:1234"},
    ],
)
def test_without_a_manager_nothing_happens(environment: dict[str, str]) -> None:
    with ServiceManager.of_environment(environment) as manager:
        manager.ready()
        manager.tick(0.0, "standby")


@pytest.mark.parametrize(
    "watchdog",
    [{}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}],
)
def test_a_watchdog_that_is_not_ours_is_not_fed(
    fake: FakeManager, watchdog: dict[str, str]
) -> None:
    with ServiceManager.of_environment({"NOTIFY_SOCKET": fake.address, **watchdog}) as manager:
        manager.tick(0.0, "standby")
    assert fake.heard() == ["STATUS=standby", "STOPPING=1"]


def test_a_manager_that_does_not_read_delays_nothing(
    fake: FakeManager, caplog: pytest.LogCaptureFixture
) -> None:
    with ServiceManager(fake.address, watchdog_s=4e-6) as manager:
        began_s = time.monotonic()
        for tick in range(2000):
            manager.tick(float(tick), "standby")
        assert time.monotonic() - began_s < 2.0
        assert caplog.text.count("the service manager cannot be told") == 1
        fake.heard()
        manager.tick(1e6, "standby")
        assert fake.heard() == ["WATCHDOG=1"]


def test_the_daemon_is_ready_alive_by_its_ticks_and_stops(
    tmp_path: Path, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = FakeManager(str(tmp_path / "notify"))
    monkeypatch.setenv("NOTIFY_SOCKET", fake.address)
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    with running(tmp_path, settings) as daemon:
        assert "ready: " in (tmp_path / SAID).read_text()
        heard = fake.heard(1.0)
        assert heard[0] == "READY=1"
        assert "STATUS=standby" in heard
        assert heard.count("WATCHDOG=1") >= 3
        daemon.send_signal(signal.SIGSTOP)  # its loop stands still
        fake.heard(0.2)
        assert fake.heard(0.6) == []
        daemon.send_signal(signal.SIGCONT)
        assert "WATCHDOG=1" in fake.heard(1.0)
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(timeout=60.0) == 0
    assert fake.heard()[-1] == "STOPPING=1"
    fake.close()
