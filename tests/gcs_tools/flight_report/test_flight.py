"""Which files make a flight, and what is wrong with those that do not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.flight_report import flight
from gcs_tools.flight_report.flight import logs_of, read_flight
from gcs_tools.logs.flight_log import Log
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import StateRecord

SHA = "0123abcd"
STATE = StateRecord(time_s=1e9, phase="cruise")


@pytest.fixture
def logs(monkeypatch: pytest.MonkeyPatch) -> dict[str, Log]:
    """Logs by file name; a file without one is damaged."""
    found = {"flight.mcap": Log(states=[STATE], metadata={"clearway": {"contract_sha256": SHA}})}

    def read(path: Path, watch: Callable[[int], None]) -> Log:
        watch(path.stat().st_size)
        if path.name not in found:
            raise CommandError(f"{path}: is not a flight log")
        return found[path.name]

    monkeypatch.setattr(flight, "read_log", read)
    return found


def files(directory: Path, *names: str) -> Path:
    for name in names:
        (directory / name).write_bytes(b"12345")
    return directory


def test_a_directory_means_the_flight_in_it(tmp_path: Path) -> None:
    files(tmp_path, "flight.mcap")
    assert logs_of(tmp_path) == [tmp_path / "flight.mcap"]
    files(tmp_path, "truth.mcap")
    assert logs_of(tmp_path) == [tmp_path / "flight.mcap", tmp_path / "truth.mcap"]
    assert logs_of(tmp_path / "flight.mcap") == logs_of(tmp_path)


def test_a_log_by_another_name_has_no_ground_truth_beside_it(tmp_path: Path) -> None:
    files(tmp_path, "other.mcap", "truth.mcap")
    assert logs_of(tmp_path / "other.mcap") == [tmp_path / "other.mcap"]


def test_a_flight_is_named_after_its_directory_or_its_file(
    logs: dict[str, Log], tmp_path: Path
) -> None:
    directory = tmp_path / "paper-1"
    directory.mkdir()
    files(directory, "flight.mcap", "field_test.mcap")
    assert read_flight(directory).name == "paper-1"
    logs["field_test.mcap"] = logs["flight.mcap"]
    assert read_flight(directory / "field_test.mcap").name == "field_test"


def test_ground_truth_may_be_in_the_log_itself(logs: dict[str, Log], tmp_path: Path) -> None:
    truth = TruthRecord(time_unix_s=1e9, position_ned_m=(0.0, 0.0, 0.0))
    logs["flight.mcap"] = Log(states=[STATE], truths=[truth])
    assert read_flight(files(tmp_path, "flight.mcap")).truth.truths == [truth]


def test_a_damaged_ground_truth_is_a_problem_of_its_own(
    logs: dict[str, Log], tmp_path: Path
) -> None:
    read = read_flight(files(tmp_path, "flight.mcap", "truth.mcap"))
    assert read.truth.truths == ()
    assert not read.truth.complete
    (problem,) = read.truth.problems
    assert problem.endswith("truth.mcap: is not a flight log")
    assert read.log.problems == ()


def test_reading_is_told_over_both_logs(logs: dict[str, Log], tmp_path: Path) -> None:
    logs["truth.mcap"] = Log()
    told: list[int] = []
    read_flight(files(tmp_path, "flight.mcap", "truth.mcap"), told.append)
    assert told == [5, 10]


@pytest.mark.parametrize(
    ("metadata", "reason"),
    [
        ({"clearway": {}}, "has no flight: nothing was recorded"),
        ({}, "has no flight: it is not a log of Clearway"),
    ],
)
def test_a_log_without_states_has_no_flight(
    logs: dict[str, Log], tmp_path: Path, metadata: dict[str, dict[str, str]], reason: str
) -> None:
    logs["flight.mcap"] = Log(metadata=metadata)
    with pytest.raises(CommandError, match=reason):
        read_flight(files(tmp_path, "flight.mcap"))


@pytest.mark.parametrize(
    ("content", "taken"),
    [
        (json.dumps({"contract_sha256": SHA, "outcome": "arrived"}), True),
        (json.dumps({"contract_sha256": "other", "outcome": "arrived"}), False),
        (json.dumps([SHA]), False),
        ("{broken", False),
        ("", False),
        ("\ud800", False),
    ],
)
def test_only_this_flight_s_result_counts(
    logs: dict[str, Log], tmp_path: Path, content: str, *, taken: bool
) -> None:
    files(tmp_path, "flight.mcap")
    data = content.encode("utf-8", errors="surrogatepass")
    (tmp_path / "result.json").write_bytes(data)
    written: Any = read_flight(tmp_path).result
    assert (written is not None) is taken
    if taken:
        assert written["outcome"] == "arrived"


def test_a_flight_without_a_result_is_evaluated_later(logs: dict[str, Log], tmp_path: Path) -> None:
    assert read_flight(files(tmp_path, "flight.mcap")).result is None
