"""`clearway fly` around the flight: may it begin, where its files go, what is printed."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from gcs_tools.console.errors import CommandError
from gcs_tools.fly import command
from gcs_tools.fly.command import (
    _may_fly,
    _prepared,
    _print_summary,
    _progress,
    _summary,
    best_effort,
    fly,
)
from gcs_tools.logs.result import Result
from gcs_tools.preflight.command import check
from gcs_tools.scenario import Scenario, load_scenario
from tests.gcs_tools.campaign.oracles.evidence import result
from tests.gcs_tools.running import CONFIG

PAPER = load_scenario(CONFIG / "paper.yaml")
INTERSECTING = load_scenario(CONFIG / "intersecting_rois.yaml")
TIMES = {"p50": None, "p99": None, "max": None}


def console() -> tuple[io.StringIO, Console]:
    text = io.StringIO()
    return text, Console(file=text, width=120)


def test_a_compliant_flight_may_begin() -> None:
    text, out = console()
    checked = check(PAPER.contract, PAPER.obstacles, PAPER.mission)
    assert _may_fly(checked, fly_outside_contract=False, console=out)
    assert text.getvalue() == "pre-flight check: progress guaranteed\n"


WEAK = replace(
    PAPER,
    contract=PAPER.contract.model_copy(
        update={
            "vehicle": PAPER.contract.vehicle.model_copy(update={"thrust_to_weight": 1.001}),
        }
    ),
)


@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize(
    ("scenario", "tier"), [(INTERSECTING, "safe, arrival not guaranteed"), (WEAK, "do not fly")]
)
def test_a_refused_flight_begins_only_outside_its_contract(
    scenario: Scenario, tier: str, *, outside: bool
) -> None:
    text, out = console()
    checked = check(scenario.contract, scenario.obstacles, scenario.mission)
    assert _may_fly(checked, fly_outside_contract=outside, console=out) is outside
    verdict = f"{tier}, {'flying outside the contract' if outside else 'refused'}"
    first, *reasons = text.getvalue().splitlines()
    assert first == f"pre-flight check: {verdict}"
    advised = scenario is INTERSECTING and not outside
    assert ("--accept-no-progress" in text.getvalue()) is advised
    reasons = reasons[:-1] if advised else reasons
    assert reasons
    assert all(reason.startswith("  • ") for reason in reasons)


def test_an_accepted_flight_without_guarantee_begins() -> None:
    text, out = console()
    contract = best_effort(INTERSECTING.contract)
    checked = check(contract, INTERSECTING.obstacles, INTERSECTING.mission)
    assert _may_fly(checked, fly_outside_contract=False, console=out)
    first = text.getvalue().splitlines()[0]
    assert first == "pre-flight check: safe, arrival not guaranteed, accepted"


def test_the_accepted_contract_is_the_one_that_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = []

    def stop_here(_: object, scenario: Scenario, *__: object) -> None:
        given.append(scenario.contract)
        raise CommandError("far enough")

    monkeypatch.setattr(command, "_fly_virtual", stop_here)
    with pytest.raises(CommandError, match="far enough"):
        fly(
            CONFIG / "intersecting_rois.yaml", virtual=True, seed=1, out=tmp_path / "out",
            fly_outside_contract=False, accept_no_progress=True, clearance_wish_m=1.5,
        )  # fmt: skip
    accepted = best_effort(INTERSECTING.contract)
    vehicle = accepted.vehicle.model_copy(update={"clearance_wish_m": 1.5})
    assert given == [accepted.model_copy(update={"vehicle": vehicle})]


def test_a_shipped_scenario_says_itself_that_it_is_outside() -> None:
    assert INTERSECTING.fly_outside_contract
    assert not PAPER.fly_outside_contract


def test_a_refused_flight_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    careful = replace(INTERSECTING, fly_outside_contract=False)
    monkeypatch.setattr(command, "load_scenario", lambda _: careful)
    out = tmp_path / "out"
    assert not fly(Path("x"), virtual=True, seed=1, out=out, fly_outside_contract=False)
    assert not out.exists()


def test_faults_need_virtual_time(tmp_path: Path) -> None:
    path = CONFIG / "scenarios" / "detection_age.yaml"
    with pytest.raises(CommandError, match="faults need virtual time: use --virtual"):
        fly(path, virtual=False, seed=1, out=tmp_path / "out", fly_outside_contract=False)


def test_only_the_files_of_an_earlier_flight_are_removed(tmp_path: Path) -> None:
    written = ("flight.mcap", "result.json", "report.html")
    exported = ("flight.tlog", "flight.foxglove.mcap")
    for name in (*written, *exported, "notes.txt"):
        (tmp_path / name).touch()
    assert _prepared(tmp_path) == tmp_path
    assert [each.name for each in tmp_path.iterdir()] == ["notes.txt"]


def test_a_directory_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CommandError, match="cannot be written"):
        _prepared(tmp_path / "file" / "flight")


def test_progress_takes_a_text_or_a_position() -> None:
    with _progress(PAPER, "flying") as report:
        report("arming")
        report("cruise", (1.0, 0.0, -4.0))


# ---------------------------------------------------------------------------- the summary


def printed(ended: Result) -> str:
    text, out = console()
    _print_summary(PAPER, ended, Path("flights/paper-1"), out)
    return text.getvalue()


def test_the_outcome_comes_first_and_the_files_last() -> None:
    lines = printed(result(reason="mission flown", plan_time_ms=TIMES)).splitlines()
    assert lines[0] == "ARRIVED  mission flown"
    assert lines[-1] == "log, report and picture: flights/paper-1"
    assert "expectation of paper: NOT met" in lines  # three obstacles are expected


def test_an_expectation_that_is_met_is_said() -> None:
    assert "expectation of paper: met" in printed(result(obstacles_avoided=3, plan_time_ms=TIMES))


def test_violations_are_listed_as_they_are() -> None:
    text = printed(result(violations=("detection_age [s]: 0.5",), plan_time_ms=TIMES))
    assert "violated: detection_age [s]: 0.5" in text


def test_measured_errors_are_beside_what_is_allowed() -> None:
    facts = dict(
        _summary(
            PAPER,
            result(
                tracking_error_max_m=0.0291,
                velocity_error_max_mps=(0.0362, 0.0111),
                plan_time_ms={"p50": 7.4, "p99": 19.1, "max": 20.0},
                plans={"qp": 3, "vertex": 0, "brake": 1},
            ),
        )
    )
    vehicle = PAPER.contract.vehicle
    assert facts["tracking error"] == f"0.029 of {vehicle.tracking_error_m} m"
    assert facts["velocity error"].startswith(f"0.036 of {vehicle.velocity_error_mps[0]}, 0.011 of")
    assert facts["plans"] == "3 qp, 1 brake"
    assert facts["plan time"] == "p50 7.4, p99 19.1, max 20.0 ms"
    assert facts["final position"] == "4.2, 0.0, -4.0 m north, east, down"


def test_a_wish_is_shown_beside_the_least_clearance() -> None:
    vehicle = PAPER.contract.vehicle.model_copy(update={"clearance_wish_m": 1.5})
    wishing = replace(PAPER, contract=PAPER.contract.model_copy(update={"vehicle": vehicle}))
    facts = dict(_summary(wishing, result(clearance_min_m=1.234, plan_time_ms=TIMES)))
    assert facts["least clearance"] == "1.23 m (wish 1.5 m)"


def test_what_was_not_measured_is_left_out_or_said() -> None:
    nothing = result(clearance_min_m=None, final_position_ned_m=None, plan_time_ms=TIMES)
    facts = dict(_summary(PAPER, nothing))
    assert facts["least clearance"] == "no obstacle"
    assert "plan time" not in facts
    assert "final position" not in facts
