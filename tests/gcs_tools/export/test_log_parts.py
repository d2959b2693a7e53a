"""Which files belong to the log of a flight."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.console.errors import CommandError
from gcs_tools.export.command import default_output
from gcs_tools.export.log_parts import log_metadata, log_parts
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import StateRecord


def log(path: Path, log_id: str = "") -> Path:
    with FlightLog(path, {"log_id": log_id} if log_id else {}) as written:
        written.write([StateRecord(time_s=1.79e9)])
    return path


def names(parts: list[Path]) -> list[str]:
    return [part.name for part in parts]


def test_parts_are_sorted_by_number_from_whichever_part_is_named(tmp_path: Path) -> None:
    for number in (10, 9, 2):
        log(tmp_path / f"flight.{number}.mcap", "a")
    first = log(tmp_path / "flight.mcap", "a")
    expected = ["flight.mcap", "flight.2.mcap", "flight.9.mcap", "flight.10.mcap"]
    for named in (tmp_path, first, tmp_path / "flight.9.mcap"):
        assert names(log_parts(named)) == expected


def test_the_first_part_may_be_gone(tmp_path: Path) -> None:
    for number in (3, 4):
        log(tmp_path / f"flight.{number}.mcap", "a")
    assert names(log_parts(tmp_path)) == ["flight.3.mcap", "flight.4.mcap"]


def test_parts_of_an_earlier_flight_are_left_out(tmp_path: Path) -> None:
    log(tmp_path / "flight.mcap", "new")
    log(tmp_path / "flight.2.mcap", "old")
    log(tmp_path / "flight.3.mcap", "new")
    assert names(log_parts(tmp_path)) == ["flight.mcap", "flight.3.mcap"]
    assert names(log_parts(tmp_path / "flight.2.mcap")) == ["flight.2.mcap"]


def test_neither_ground_truth_nor_an_export_is_a_log(tmp_path: Path) -> None:
    for name in ("truth.mcap", "flight.mcap", "flight.foxglove.mcap", "other-1.mcap"):
        log(tmp_path / name)
    assert names(log_parts(tmp_path)) == ["flight.mcap"]


def test_one_log_of_any_name_is_found(tmp_path: Path) -> None:
    log(tmp_path / "flight-20260101-120000.mcap", "a")
    log(tmp_path / "flight-20260101-120000.2.mcap", "a")
    assert len(log_parts(tmp_path)) == 2


def test_several_logs_have_to_be_told_apart(tmp_path: Path) -> None:
    log(tmp_path / "flight-1.mcap")
    log(tmp_path / "flight-2.mcap")
    with pytest.raises(CommandError, match=r"name one of them: flight-1\.mcap, flight-2\.mcap"):
        log_parts(tmp_path)
    assert names(log_parts(tmp_path / "flight-2.mcap")) == ["flight-2.mcap"]


def test_a_log_of_another_suffix_is_taken_as_it_is(tmp_path: Path) -> None:
    assert names(log_parts(log(tmp_path / "flight.log"))) == ["flight.log"]


def test_nothing_is_named(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="no flight log in this directory"):
        log_parts(tmp_path)
    with pytest.raises(CommandError, match=r"nowhere\.mcap: cannot be read"):
        log_parts(tmp_path / "nowhere.mcap")


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"nonsense"])
def test_a_damaged_log_has_no_metadata(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "flight.mcap").write_bytes(content)
    assert log_metadata(tmp_path / "flight.mcap") == {}


@pytest.mark.parametrize(
    ("part", "tlog", "foxglove"),
    [
        ("flight.mcap", "flight.tlog", "flight.foxglove.mcap"),
        ("flight.3.mcap", "flight.tlog", "flight.foxglove.mcap"),
        ("a.b.mcap", "a.b.tlog", "a.b.foxglove.mcap"),
        ("odd", "odd.tlog", "odd.foxglove.mcap"),
    ],
)
def test_an_export_lies_beside_its_log(part: str, tlog: str, foxglove: str) -> None:
    assert default_output(Path("d") / part, "tlog") == Path("d") / tlog
    assert default_output(Path("d") / part, "foxglove") == Path("d") / foxglove
