"""Progress bars: what a person at a terminal reads, and that nobody else gets to see them."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs_tools.console.progress import FlightProgress
from onboard.files.mission_file import Leg, Mission
from onboard.guidance.phases import Phase
from onboard.recording.flight_log import FlightLog
from onboard.recording.messages import StateRecord
from tests.gcs_tools.fly.test_fly import short_scenario
from tests.gcs_tools.running import CONFIG
from tests.gcs_tools.terminal import Terminal, terminal

CONTRACT = str(CONFIG / "paper_contract.yaml")
SOLVE = ("contract", "solve", "--contract", CONTRACT, "--for", "vehicle.cruise_speed_mps")
SURFACE = (
    *("contract", "surface", "--contract", CONTRACT, "--format", "csv", "-o", "/dev/null"),
    *("--x", "vehicle.cruise_speed_mps=0.5:8:800", "--y", "vehicle.radius_m=0.1:1.0:800"),
)


def run(*arguments: str) -> tuple[subprocess.CompletedProcess[str], Terminal]:
    """Run a command whose messages go to a terminal, its output to a pipe."""
    with terminal() as screen:
        ran = subprocess.run(
            [sys.executable, "-m", "gcs_tools", *arguments],
            stdout=subprocess.PIPE, stderr=screen.written_to, text=True, timeout=60.0, check=False,
        )  # fmt: skip
    return ran, screen


@pytest.mark.parametrize(
    ("arguments", "words"), [(SOLVE, "trying values"), (SURFACE, "evaluating")], ids=str
)
def test_what_takes_long_shows_how_far_it_is(arguments: tuple[str, ...], words: str) -> None:
    ran, screen = run(*arguments)
    assert ran.returncode == 0
    assert "%" not in ran.stdout
    assert any(words in line for line in screen.lines)
    assert screen.shares == sorted(screen.shares)
    assert screen.estimates


def test_a_virtual_flight_shows_how_far_it_is(
    written: Callable[[str, Any], Path], tmp_path: Path
) -> None:
    scenario = str(short_scenario(written))
    ran, screen = run("fly", scenario, "--virtual", "--out", str(tmp_path))
    assert ran.returncode == 0
    assert screen.shares[0] == 0
    assert max(screen.shares) > 90
    assert screen.shares == sorted(screen.shares)
    assert screen.estimates
    # Which phases last until the display is redrawn is a matter of luck.
    assert any(re.match(f"({'|'.join(Phase)}) ", line) for line in screen.lines)


def test_a_report_shows_how_much_of_the_log_is_read(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    with FlightLog(path, {}) as log:
        for number in range(80_000):
            time_s = 1_790_000_000.0 + 0.02 * number
            log.write([StateRecord(time_s=time_s, phase="cruise")])
    ran, screen = run("report", str(path))
    assert ran.stdout == f"{tmp_path / 'report.html'}\n"
    assert screen.shares[0] == 0
    assert len(set(screen.shares)) > 2
    assert screen.shares == sorted(screen.shares)


def test_it_is_quiet_where_nobody_watches() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "gcs_tools", *SOLVE],
        capture_output=True, text=True, timeout=60.0, check=False, env={"FORCE_COLOR": "1"},
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")


# ---------------------------------------------------------------------------- the way of a flight

# Out to the north, then to the east.
CORNER = Mission(
    altitude_m=4.0,
    legs=(
        Leg(end_ned_m=(20.0, 0.0), target_half_width_m=3.0),
        Leg(end_ned_m=(20.0, 10.0), target_half_width_m=3.0),
    ),
)


def test_the_way_of_a_flight_is_up_along_and_down() -> None:
    way = FlightProgress(CORNER)
    assert way.total_m == pytest.approx(4.0 + 30.0 + 4.0)
    flown = {
        (0.0, 0.0, 0.0): 0.0,
        (0.0, 0.0, -2.0): 2.0,
        (0.0, 0.0, -4.0): 4.0,
        (10.0, 3.0, -4.0): 14.0,  # beside its leg, round an obstacle
        (9.0, 3.0, -4.5): 14.0,  # never backwards
        (19.8, 0.0, -4.0): 24.0,
        (20.0, 6.0, -3.8): 30.0,
        (20.0, 10.0, -4.0): 34.0,
        (20.0, 10.0, -1.0): 37.0,
        (20.0, 10.0, 0.0): 38.0,
    }
    for position_ned_m, expected_m in flown.items():
        assert way.travelled_m(position_ned_m) == pytest.approx(expected_m)


def test_a_flight_that_lands_early_is_as_good_as_over() -> None:
    way = FlightProgress(CORNER)
    way.travelled_m((0.0, 0.0, -4.0))
    assert way.travelled_m((5.0, 0.0, -1.0)) == pytest.approx(way.total_m - 1.0)


def test_a_position_that_nobody_knows_changes_nothing() -> None:
    way = FlightProgress(CORNER)
    way.travelled_m((0.0, 0.0, -4.0))
    assert way.travelled_m((math.nan, 0.0, -4.0)) == pytest.approx(4.0)
