"""`clearway status` and `clearway doctor`: output and exit codes, files, and a scripted daemon."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
import zenoh

from gcs_tools.console.processes import free_ports
from gcs_tools.doctor import command, companion
from gcs_tools.doctor.diagnosis import Diagnosis
from gcs_tools.doctor.observation import Observation, observe
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.bus import BusConfig
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.recording.messages import EventRecord, Margins, as_json
from onboard.zenoh_session import open_session
from tests.gcs_tools.doctor.test_diagnosis import CONTRACT, SEEN, WELL, seen_with
from tests.gcs_tools.running import Clearway

FAULTY = seen_with(telemetry_age_s=None)


@pytest.fixture
def folder(clearway: Clearway, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    assert clearway("init", tmp_path / "mine").code == 0
    monkeypatch.chdir(tmp_path / "mine")
    return tmp_path / "mine"


def hears(monkeypatch: pytest.MonkeyPatch, seen: Observation) -> None:
    monkeypatch.setattr(command, "observe", lambda _: seen)


def test_status_waits_until_all_is_well(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    asked = iter((Observation(), FAULTY, SEEN))
    monkeypatch.setattr(command, "observe", lambda _: next(asked))
    assert clearway("status", "--daemon-config", "onboard.yaml", "--wait", "60").code == 0
    assert next(asked, None) is None


def test_status_waits_no_longer_than_asked(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    hears(monkeypatch, FAULTY)
    assert clearway("status", "--daemon-config", "onboard.yaml", "--wait", "0.01").code == 1


@pytest.mark.parametrize(
    ("seen", "code", "words"),
    [
        (SEEN, 0, ("phase", "standby", "sensors", "front, 0.05 s old", "mode LOITER")),
        (FAULTY, 1, ("MISSING", "link: the daemon has received no position", "never heard")),
        (Observation(), 2, ("no status was heard", "start it with")),
    ],
)
def test_status(
    clearway: Clearway,
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    seen: Observation,
    code: int,
    words: tuple[str, ...],
) -> None:
    hears(monkeypatch, seen)
    for where in ((), ("--daemon-config", "onboard.yaml"), ("--zenoh-config", "bus.yaml")):
        ran = clearway("status", *where)
        assert (ran.code, ran.err) == (code, "")
        for word in words:
            assert word in ran.out


@pytest.mark.parametrize(
    ("seen", "code", "words"),
    [
        (SEEN, 0, ("ok       disk", "ok       link", "nothing is missing")),
        (FAULTY, 1, ("MISSING  link", "-> check mavlink.url", "1 missing, 0 unknown")),
        (Observation(), 2, ("UNKNOWN  daemon", "-> start it", "0 missing, 1 unknown")),
    ],
)
def test_doctor(
    clearway: Clearway,
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    seen: Observation,
    code: int,
    words: tuple[str, ...],
) -> None:
    hears(monkeypatch, seen)
    ran = clearway("doctor", "--daemon-config", "onboard.yaml")
    assert (ran.code, ran.err) == (code, "")
    for word in words:
        assert word in ran.out


def test_json_for_programs(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    hears(monkeypatch, FAULTY)
    document = json.loads(clearway("status", "--format", "json").out)
    assert document["status"]["phase"] == "standby"
    (link,) = [each for each in document["diagnoses"] if each["name"] == "link"]
    assert link["verdict"] == "broken"
    assert link["cure"]
    document = json.loads(
        clearway("doctor", "--daemon-config", "onboard.yaml", "--format", "json").out
    )
    assert {"contract", "disk", "link"} <= {each["name"] for each in document["diagnoses"]}
    hears(monkeypatch, Observation())
    assert json.loads(clearway("status", "--format", "json").out)["status"] is None


def test_the_vehicle_is_asked_only_on_request(
    clearway: Clearway, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    asked = []

    def diagnose_vehicle(url: str, contract: object, *_: object) -> list[Diagnosis]:
        asked.append((url, contract))
        return [Diagnosis("vehicle battery", Verdict.BROKEN, "empty", "charge it")]

    monkeypatch.setattr("gcs_tools.doctor.vehicle.diagnose_vehicle", diagnose_vehicle)
    hears(monkeypatch, SEEN)
    assert clearway("doctor").code == 0
    assert asked == []
    ran = clearway("doctor", "--vehicle", "udpin://127.0.0.1:1")
    assert asked == [("udpin://127.0.0.1:1", CONTRACT)]
    assert ran.code == 1
    assert "charge it" in ran.out
    hears(monkeypatch, replace(SEEN, contract=None))
    ran = clearway("doctor", "--vehicle", "udpin://127.0.0.1:1")
    assert ran.code == 2
    assert "give the daemon's file by --daemon-config" in ran.out
    assert len(asked) == 1


# ---------------------------------------------------------------------------- the computer


def changed(folder: Path, **keys: object) -> companion.DaemonFiles:
    path = folder / "onboard.yaml"
    document = yaml.safe_load(path.read_text(encoding="utf-8")) | keys
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return companion.load_daemon_files(path)


def test_a_full_disk(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=5e8))
    files = changed(folder, log_directory="new/deep")
    found = {each.name: each for each in companion.diagnose_files(files)}
    assert found["disk"].verdict is Verdict.BROKEN
    assert "0.5 GB free" in found["disk"].text
    assert "log_quota_mb" in found["disk"].cure


@pytest.mark.parametrize(
    ("device", "allowed", "verdict", "words"),
    [
        ("/dev/no-such-port", True, Verdict.BROKEN, "does not exist"),
        ("/dev/null", False, Verdict.BROKEN, "may not be opened"),
        ("/dev/null", True, Verdict.HOLDS, "can be opened"),
    ],
)
def test_the_serial_port(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    device: str,
    allowed: bool,
    verdict: Verdict,
    words: str,
) -> None:
    monkeypatch.setattr("os.access", lambda *_: allowed)
    files = changed(folder, mavlink={"url": f"serial://{device}:57600"})
    found = {each.name: each for each in companion.diagnose_files(files)}
    assert found["serial port"].verdict is verdict
    assert words in found["serial port"].text
    assert bool(found["serial port"].cure) is (verdict is Verdict.BROKEN)


# ---------------------------------------------------------------------------- over Zenoh


@contextmanager
def scripted_daemon(session: zenoh.Session) -> Iterator[None]:
    """Publish what a daemon does, and what another program might."""
    stop = threading.Event()
    answer = json.dumps({"contract": CONTRACT.model_dump(mode="json"), "sha256": "x"}).encode()
    session.declare_queryable(
        "clearway/vehicle/contract", lambda query: query.reply("clearway/vehicle/contract", answer)
    )

    def run() -> None:
        while not stop.wait(0.05):
            session.put("clearway/vehicle/status", b"not a status")
            session.put("clearway/vehicle/status", as_json(replace(WELL, time_s=1.0)))
            margins = Margins(time_s=1.0, compliant=True, clauses=[])
            session.put("clearway/vehicle/margins", as_json(margins))
            event = EventRecord(time_s=1.0, name="refused", text="beside the leg")
            session.put("clearway/vehicle/events", as_json(event))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_a_daemon_is_observed_over_zenoh() -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    bus = BusConfig(connect=(endpoint,), listen=())
    with open_session(ZenohEndpoints(listen=(endpoint,))) as session, scripted_daemon(session):
        seen = observe(bus, hear_timeout_s=30.0, listen_s=0.4)
    assert len(seen.states) > 1
    assert seen.state == replace(WELL, time_s=1.0)
    assert seen.margins is not None
    assert {event.text for event in seen.events} == {"beside the leg"}
    assert seen.contract == CONTRACT
    assert seen.ahead_s is not None
    assert seen.ahead_s < -1e9
    assert observe(bus, hear_timeout_s=0.2) == Observation()
