"""What `clearway identify` proposes to declare, and how it goes through directories."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.errors import CommandError
from gcs_tools.identify import command
from gcs_tools.identify.command import contract_values, identify
from gcs_tools.identify.logs import NotALogError
from gcs_tools.identify.recording import Measured

MEASURED = Measured(
    source="a.ulg", tracking_error_m=0.2, tracking_error_z_m=0.1, velocity_error_mps=(0.3, None),
    reaction_time_s=None, attitude_lag_s=0.17, heading_error_deg=1.0, roll_max_deg=5.0,
    pitch_max_deg=6.0, tilt_max_deg=7.0, tilt_asked_deg=None, worst="3.0 s after taking control, x",
    notes=("a note",),
)  # fmt: skip


def files(monkeypatch: pytest.MonkeyPatch, found: dict[str, Measured | CommandError]) -> None:
    """Let files have these flights, by their names; others are not logs."""

    def read(path: Path, _: int | None) -> Any:
        what = found.get(path.name)
        if what is None:
            raise NotALogError(f"{path}: not a log")
        if isinstance(what, CommandError):
            raise what
        return replace(what, source=path.name)

    monkeypatch.setattr(command, "read_recording", read)
    monkeypatch.setattr(command, "measure", lambda recording: recording)


def written(capsys: pytest.CaptureFixture[str], *paths: Path, form: Any = "json") -> Any:
    identify(list(paths), margin=0.25, form=form, output=None)
    out = capsys.readouterr().out
    return json.loads(out) if form == "json" else out


# ---------------------------------------------------------------------------- values


@given(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=5), st.floats(0.01, 1.0))
def test_the_worst_flight_is_declared_with_its_margin_and_rounded_up(
    errors_m: list[float], margin: float
) -> None:
    flights = [replace(MEASURED, tracking_error_m=error_m) for error_m in errors_m]
    declared_m = contract_values(flights, margin)["vehicle.tracking_error_m"]
    assert declared_m is not None
    needed_m = max(errors_m) * (1.0 + margin)
    assert needed_m - 1e-9 <= declared_m <= needed_m + 0.01
    assert math.isclose(declared_m * 100.0, round(declared_m * 100.0), abs_tol=1e-6)


def test_a_value_that_no_flight_shows_is_left_open() -> None:
    shown = replace(MEASURED, reaction_time_s=0.12)
    assert contract_values([MEASURED], 0.25)["vehicle.reaction_time_s"] is None
    assert contract_values([MEASURED, shown], 0.25)["vehicle.reaction_time_s"] == 0.15
    assert contract_values([MEASURED], 0.25)["vehicle.velocity_error_mps.1"] is None


def test_a_value_that_is_exact_is_not_rounded_up_further() -> None:
    exact = replace(MEASURED, tracking_error_m=0.2)
    assert contract_values([exact], 0.25)["vehicle.tracking_error_m"] == 0.25


# ---------------------------------------------------------------------------- files


def test_the_worst_flight_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    worse = replace(MEASURED, tracking_error_m=0.9)
    files(monkeypatch, {"a": MEASURED, "b": worse})
    found = written(capsys, tmp_path / "a", tmp_path / "b")
    assert found["worst"] == "b"
    assert [flight["source"] for flight in found["flights"]] == ["a", "b"]
    assert found["margin"] == 0.25


def test_a_directory_is_searched_below_and_skips_what_is_not_a_log(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "deeper").mkdir()
    for name in ("notes.txt", "a", "broken", "deeper/b"):
        (tmp_path / name).touch()
    files(monkeypatch, {"a": MEASURED, "b": MEASURED, "broken": CommandError("broken: damaged")})
    found = written(capsys, tmp_path)
    assert [flight["source"] for flight in found["flights"]] == ["a", "b"]
    assert found["skipped"] == ["broken: damaged"]


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (("notes.txt",), r"no flight log in this directory can be used$"),
        (("broken", "notes.txt"), r"can be used, first broken: damaged$"),
        ((), r"no flight log in this directory can be used$"),
    ],
)
def test_a_directory_without_a_flight_is_an_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, names: tuple[str, ...], reason: str
) -> None:
    for name in names:
        (tmp_path / name).touch()
    files(monkeypatch, {"broken": CommandError("broken: damaged")})
    with pytest.raises(CommandError, match=reason):
        identify([tmp_path], margin=0.25, form="json", output=None)


def test_a_file_that_is_given_must_be_a_log(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    files(monkeypatch, {})
    with pytest.raises(NotALogError):
        identify([tmp_path / "x"], margin=0.25, form="json", output=None)


def test_people_read_what_to_declare_and_what_is_not_known(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    files(monkeypatch, {"a": MEASURED})
    text = written(capsys, tmp_path / "a", form="table")
    assert "worst: a, 3.0 s after taking control, x" in text
    assert "a: a note" in text
    assert "to declare, 25 % above the measured values:" in text
    assert "  vehicle.tracking_error_m: 0.25\n" in text
    assert "  vehicle.reaction_time_s: not in these logs\n" in text
    assert "7.0, -" in text
