"""One log a flight, within the quota of its directory."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gcs_tools.logs.flight_log import read_log
from onboard.files.daemon_config import DaemonConfig, log_directory
from onboard.recording.directory_quota import DirectoryQuota
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import Margins, StateRecord
from onboard.recording.recorder import FlightRecorder
from onboard.recording.rotation import LogRotation

EPOCH_S = 1.7e9


def state(number: int, *, armed: bool | None) -> StateRecord:
    return StateRecord(time_s=EPOCH_S + number, obstacles_known=number, armed=armed)


def names(directory: Path) -> Callable[[], Path]:
    numbers: Iterator[int] = iter(range(100))
    return lambda: directory / f"flight-{next(numbers)}.mcap"


def test_each_flight_has_its_log_complete_by_itself(tmp_path: Path) -> None:
    next_path = names(tmp_path)
    with FlightRecorder(next_path(), {"contract_sha256": "c"}, next_path) as recorder:
        recorder.write([Margins(time_s=EPOCH_S, compliant=True, clauses=[])])
        for number, armed in enumerate([None, False, True, True, None, False, False, True, False]):
            recorder.write([state(number, armed=armed)])
            recorder.write_mavlink("sent", EPOCH_S + number, bytes([number]))
    logs = [read_log(tmp_path / f"flight-{number}.mcap") for number in range(3)]
    assert [[each.obstacles_known for each in log.states] for log in logs] == [
        [0, 1, 2, 3, 4, 5],
        [6, 7, 8],
        [],
    ]
    assert all(log.complete for log in logs)
    assert all([margins.compliant for margins in log.margins] == [True] for log in logs)
    identifiers = {log.metadata["clearway"]["log_id"] for log in logs}
    assert len(identifiers) == 3
    assert {log.metadata["clearway"]["contract_sha256"] for log in logs} == {"c"}
    assert recorder.path == tmp_path / "flight-2.mcap"


def test_without_names_all_flights_are_one_log(tmp_path: Path) -> None:
    with FlightRecorder(tmp_path / "flight.mcap", {}) as recorder:
        for number, armed in enumerate([True, False, True, False]):
            recorder.write([state(number, armed=armed)])
    assert [path.name for path in tmp_path.iterdir()] == ["flight.mcap"]
    assert len(read_log(tmp_path / "flight.mcap").states) == 4


def test_a_next_log_that_cannot_be_begun_ends_the_log_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with FlightRecorder(tmp_path / "a.mcap", {}, lambda: tmp_path / "no" / "b.mcap") as recorder:
        for number, armed in enumerate([True, False, False]):
            recorder.write([state(number, armed=armed)])
    assert recorder.failure is not None
    assert "the flight log ends here" in caplog.text
    assert len(read_log(tmp_path / "a.mcap").states) == 2


# ---------------------------------------------------------------------------- quota


def old_logs(directory: Path, count: int, size_bytes: int = 1000) -> list[Path]:
    paths = [directory / f"flight-{number}.mcap" for number in range(count)]
    for age, path in enumerate(reversed(paths)):
        path.write_bytes(bytes(size_bytes))
        os.utime(path, (1e9 - age, 1e9 - age))
    return paths


def test_the_oldest_logs_make_room(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    paths = old_logs(tmp_path, 5)
    DirectoryQuota(tmp_path, 4500).make_room(2000)
    assert [path.exists() for path in paths] == [False, False, False, True, True]
    assert caplog.text.count("removed for the quota") == 3
    DirectoryQuota(tmp_path, 4500).make_room(2000)
    assert [path.exists() for path in paths] == [False, False, False, True, True]


def test_only_flight_logs_are_removed(tmp_path: Path) -> None:
    kept = [tmp_path / name for name in ("notes.txt", "flight.mcap", "survey.mcap")]
    for path in kept:
        path.write_bytes(bytes(9000))
    target = tmp_path / "elsewhere"
    target.write_bytes(bytes(9000))
    link, folder = tmp_path / "flight-link.mcap", tmp_path / "flight-folder.mcap"
    link.symlink_to(target)
    folder.mkdir()
    (removed,) = old_logs(tmp_path, 1)
    DirectoryQuota(tmp_path, 1).make_room(0)
    assert not removed.exists()
    assert all(path.exists() for path in (*kept, target, link, folder))


def test_a_log_that_cannot_be_removed_is_passed_over(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths, unlink = old_logs(tmp_path, 3), Path.unlink

    def refuse_first(path: Path, *, missing_ok: bool = False) -> None:
        if path == paths[0]:
            raise PermissionError(13, "Permission denied")
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse_first)
    DirectoryQuota(tmp_path, 2500).make_room(0)
    assert [path.exists() for path in paths] == [True, False, True]
    assert "cannot be removed for the quota: Permission denied" in caplog.text


def test_every_part_of_a_log_makes_room_and_the_newest_stay(tmp_path: Path) -> None:
    old = old_logs(tmp_path, 3, 30_000)
    quota = DirectoryQuota(tmp_path, 100_000)
    parts = LogRotation(tmp_path / "flight-9.mcap", part_bytes=20_000, quota=quota)
    with FlightLog(parts, {}) as log:
        number = 0
        while len(list(tmp_path.glob("flight-9*"))) < 3:
            noise = os.urandom(64).hex()
            log.write([StateRecord(time_s=EPOCH_S + number, position_doubt=noise)])
            number += 1
    total = sum(path.stat().st_size for path in tmp_path.iterdir())
    assert total < 100_000 + 70_000  # a chunk is written after its part counts as full
    assert not old[0].exists()
    assert old[2].exists() or not old[1].exists()


# ---------------------------------------------------------------------------- where


@pytest.mark.parametrize(
    ("written", "environment", "expected"),
    [
        (None, {}, "/base/flights"),
        (None, {"STATE_DIRECTORY": "/var/lib/clearway"}, "/var/lib/clearway/flights"),
        (None, {"STATE_DIRECTORY": "/a:/b"}, "/a/flights"),
        ("logs", {"STATE_DIRECTORY": "/a"}, "/base/logs"),
        ("/disk", {}, "/disk"),
    ],
)
def test_logs_go_beside_the_configuration_or_where_the_service_may_write(
    written: str | None, environment: dict[str, str], expected: str
) -> None:
    document = {"contract": "c.yaml", "mission": "m.yaml", "log_directory": written}
    config = DaemonConfig.model_validate(document)
    assert log_directory(Path("/base"), config, environment) == Path(expected)
