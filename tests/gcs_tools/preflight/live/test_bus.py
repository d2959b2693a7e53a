"""The check of detections and daemon over real Zenoh, against a scripted daemon and sensor."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh

from gcs_tools.console.processes import free_ports
from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.live.bus import BusCheck
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.monitoring.flight_authorization import FlightAuthorizationGate
from onboard.zenoh_session import open_session
from tests.gcs_tools.running import CONFIG

pytestmark = [pytest.mark.real_time, pytest.mark.waiting]

CONTRACT = load_contract(CONFIG / "default_contract.yaml")
PERIOD_S = 0.05


class Onboard:
    """A sensor, and a daemon that says what it is told to say.

    Args:
        session: of Zenoh.
        ahead_s: the daemon's clock less this computer's.
        sensor_ahead_s: the sensor's clock less the daemon's.
        said: more of its status.
    """

    def __init__(
        self, session: zenoh.Session, ahead_s: float, sensor_ahead_s: float, said: dict[str, Any]
    ) -> None:
        self._session, self._said = session, said
        self._ahead_s, self._sensor_ahead_s = ahead_s, sensor_ahead_s
        self._gate = FlightAuthorizationGate(CONTRACT.sha256, 60.0)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def now_s(self) -> float:
        """Unix time by the daemon's clock."""
        return time.time() + self._ahead_s

    @contextmanager
    def running(self) -> Iterator[None]:
        key, answer = "clearway/vehicle/contract", json.dumps({"sha256": CONTRACT.sha256}).encode()
        self._session.declare_queryable(key, lambda query: query.reply(key, answer))
        self._session.declare_subscriber(
            "clearway/vehicle/clearance",
            lambda sample: self._gate.receive(sample.payload.to_bytes()),
        )
        self._thread.start()
        try:
            yield
        finally:
            self._stop.set()
            self._thread.join()

    def _run(self) -> None:
        sequence = 0
        while not self._stop.wait(PERIOD_S):
            now_s = self.now_s()
            frame = {
                "version": 1, "source": "front", "sequence": sequence, "frame": "local_ned",
                "stamp_unix_s": now_s + self._sensor_ahead_s, "range_m": 12.0,
                "field_of_view_deg": 120.0, "obstacles": [],
            }  # fmt: skip
            accepted = self._gate.accepts_no_progress(now_s)
            status = {
                "time_s": now_s, "detection_age_s": 0.03, "telemetry_age_s": 0.02,
                "cleared": self._gate.refusal(now_s) is None,
                "progress": "best_effort" if accepted else "guaranteed",
            }  # fmt: skip
            for key, document in (("obstacles", frame), ("status", status | self._said)):
                self._session.put(f"clearway/vehicle/{key}", json.dumps(document).encode())
            sequence += 1


def checked(
    ahead_s: float = 0.0,
    sensor_ahead_s: float = -0.01,
    *,
    accept_no_progress: bool = False,
    sensors: tuple[str, ...] = (),
    sensors_said: dict[str, Any] | None = None,
    **said: Any,
) -> dict[str, Finding]:
    """Return the findings by subject and name, the flight authorization among them."""
    port = free_ports(1)[0]
    listen = ZenohEndpoints(listen=(f"tcp/127.0.0.1:{port}",))
    connect = ZenohEndpoints(connect=(f"tcp/127.0.0.1:{port}",))
    with (
        open_session(listen) as theirs,
        open_session(connect) as ours,
        Onboard(theirs, ahead_s, sensor_ahead_s, said | {"sensors": sensors_said or {}}).running(),
    ):
        bus = BusCheck(ours, "vehicle")
        found = bus.run(assess(CONTRACT), sensors)
        authorized = bus.authorize(
            CONTRACT, found, compliant=True, accept_no_progress=accept_no_progress
        )
        found.append(authorized)
    return {f"{each.subject} {each.name}": each for each in found}


@pytest.mark.parametrize("ahead_s", [0.0, 1199.9, -1199.9])
def test_a_daemon_by_whose_clock_all_is_well_is_cleared(ahead_s: float) -> None:
    """Also one whose clock this computer does not share."""
    heard = {"lidar": {"age_s": 0.04, "stamp_ahead_s": -0.01}}
    found = checked(ahead_s, sensors=("lidar",), sensors_said=heard)
    assert "sensor lidar" in found
    assert {each.verdict for each in found.values()} == {Verdict.HOLDS}, found
    assert found["daemon flight authorization"].text == "given, and confirmed by the daemon"


def test_an_acceptance_reaches_the_daemon_and_is_confirmed() -> None:
    found = checked(accept_no_progress=True)["daemon flight authorization"]
    assert found.verdict is Verdict.HOLDS
    assert found.text == "given for one flight that may not arrive, and confirmed by the daemon"


@pytest.mark.parametrize("says", ["guaranteed", None])
def test_a_daemon_that_does_not_take_the_acceptance_has_not_confirmed_it(says: str | None) -> None:
    """One of an earlier version, for instance, would stay in STANDBY."""
    found = checked(accept_no_progress=True, progress=says)["daemon flight authorization"]
    assert found.verdict is Verdict.UNKNOWN
    assert "did not confirm it" in found.text


@pytest.mark.parametrize(
    ("said", "name", "words"),
    [
        ({"detection_age_s": None}, "daemon detections", "the daemon has no detections"),
        ({"detection_age_s": 30.0}, "daemon detections", "30.000 s old"),
        ({"telemetry_age_s": None}, "daemon telemetry", "the daemon has received no position"),
        ({"telemetry_age_s": 2.0}, "daemon telemetry", "2.000 s old"),
    ],
)
def test_what_the_daemon_lacks_is_a_refusal(said: dict[str, Any], name: str, words: str) -> None:
    """As when a sensor has renamed its source: its frames are fine, and the daemon blind."""
    found = checked(**said)
    refused = {key for key, each in found.items() if each.verdict is not Verdict.HOLDS}
    assert refused == {name, "daemon flight authorization"}
    assert found[name].verdict is Verdict.BROKEN
    assert words in found[name].text


def test_a_sensor_of_the_future_is_told_by_the_daemons_clock() -> None:
    found = checked(ahead_s=-300.0, sensor_ahead_s=20.0)
    clock = found["detections front clock"]
    assert clock.verdict is Verdict.BROKEN
    assert "ahead of the daemon's clock, which is 300.0 s behind this computer's" in clock.text
    assert found["detections front age"].verdict is Verdict.UNKNOWN
