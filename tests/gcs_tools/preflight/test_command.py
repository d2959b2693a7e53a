"""Pre-flight: a contract, a field and a mission on paper, and who is refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.processes import free_ports
from gcs_tools.preflight.field_check import OFFENDERS_MAX, check_field
from gcs_tools.preflight.field_merging import intersecting_pairs
from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.live.check import LiveRequest, check_live
from gcs_tools.preflight.rule import Rule
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.geometry.box import Box
from tests.gcs_tools.running import CONFIG, Clearway
from tests.gcs_tools.test_bad_input import assert_refused
from tests.gcs_tools.vehicle.fake_autopilot import FakeAutopilot, autopilots

PAPER = assess(load_contract(CONFIG / "paper_contract.yaml"))
SIZE_M = (1.0, 1.0)


def obstacle(name: str, center_ned_m: tuple[float, float], **more: Any) -> Obstacle:
    return Obstacle.model_validate(
        {"id": name, "center_ned_m": center_ned_m, "size_m": SIZE_M, **more}
    )


def rules(obstacles: Sequence[Obstacle], mission: Mission | None = None) -> dict[str, Rule]:
    found = check_field(PAPER, ObstacleField.of(obstacles), mission)
    return {rule.name: rule for rule in found}


def mission(*ends_ned_m: tuple[float, float], half_width_m: float = 3.0) -> Mission:
    legs = [{"end_ned_m": end, "target_half_width_m": half_width_m} for end in ends_ned_m]
    return Mission.model_validate({"altitude_m": 4.0, "legs": legs})


@pytest.mark.parametrize("name", ["paper", "default"])
def test_shipped_examples_may_fly(clearway: Clearway, config: Path, name: str) -> None:
    ran = clearway(
        "preflight",
        *("--contract", config / f"{name}_contract.yaml"),
        *("--field", config / f"{name}_field.yaml"),
        *("--mission", config / f"{name}_mission.yaml"),
    )
    assert ran.code == 0
    assert ran.out.startswith("PROGRESS GUARANTEED")


def test_a_broken_clause_is_refused(clearway: Clearway, config: Path) -> None:
    arguments = (
        "preflight", "--contract", config / "paper_contract.yaml",
        "--set", "vehicle.thrust_to_weight=1.001",
    )  # fmt: skip
    ran = clearway(*arguments, "--format", "json")
    document = json.loads(ran.out)
    assert ran.code == 1
    assert document["compliant"] is False
    assert document["contract"]["compliant"] is False
    assert any(refusal.startswith("thrust: ") for refusal in document["refusals"])
    table = clearway(*arguments)
    assert table.code == 1
    assert table.out.startswith("DO NOT FLY")


def test_intersecting_regions_are_refused(clearway: Clearway, config: Path) -> None:
    ran = clearway(
        "preflight",
        *("--contract", config / "paper_contract.yaml"),
        *("--field", config / "intersecting_rois_field.yaml"),
        *("--mission", config / "paper_mission.yaml"),
        *("--format", "json"),
    )
    document = json.loads(ran.out)
    assert ran.code == 1
    assert document["contract"]["compliant"] is True
    broken = {rule["name"]: rule for rule in document["field"] if not rule["holds"]}
    assert set(broken) == {"separation", "roi_disjoint"}
    assert broken["roi_disjoint"]["offenders"] == ["2 and 3 (leg 1)"]


def test_sizes_are_those_in_the_leg_frame() -> None:
    turned = obstacle("1", (20.0, 0.0), yaw_deg=45.0)
    along_north = rules([turned], mission((40.0, 0.0)))["obstacle_size_max"]
    assert along_north.required == pytest.approx(math.sqrt(2.0))
    assert not along_north.holds
    assert along_north.offenders == ("1 (leg 1): 1.41 m",)
    along_the_obstacle = rules([turned], mission((40.0, 40.0)))["obstacle_size_max"]
    assert along_the_obstacle.required == pytest.approx(1.0)
    assert along_the_obstacle.holds


def test_an_obstacle_thinner_than_assumed_is_named() -> None:
    thin = rules([obstacle("pole", (20.0, 0.0), size_m=(0.2, 1.0))])["obstacle_size_min"]
    assert not thin.holds
    assert thin.offenders == ("pole (heading north): 0.20 m",)


def test_separation_is_between_centres() -> None:
    near = rules([obstacle("a", (0.0, 0.0)), obstacle("b", (7.0, 10.0))])["separation"]
    assert near.declared == pytest.approx(math.hypot(7.0, 10.0))
    assert not near.holds
    assert near.offenders == ("a and b: 12.21 m",)
    too_large = obstacle("b", (0.0, 0.0), size_m=(1.3, 1.3))  # else the two are avoided as one
    same_place = rules([obstacle("a", (0.0, 0.0)), too_large])["separation"]
    assert (same_place.declared, same_place.holds) == (0.0, False)
    alone = rules([obstacle("a", (0.0, 0.0))])["separation"]
    assert alone.holds


def test_a_pair_of_separations_asks_for_one_of_the_two() -> None:
    contract = load_contract(
        CONFIG / "paper_contract.yaml", ("environment.obstacle_separation_min_m=[12.0, 8.0]",)
    )

    def separation(center_ned_m: tuple[float, float]) -> Rule:
        field = ObstacleField.of([obstacle("a", (20.0, 0.0)), obstacle("b", center_ned_m)])
        found = check_field(assess(contract), field, mission((60.0, 0.0)))
        return next(rule for rule in found if rule.name == "separation")

    assert separation((32.0, 0.0)).holds
    assert separation((20.0, -8.0)).holds
    near = separation((31.9, 7.9))
    assert not near.holds
    assert near.declared == pytest.approx(max(11.9 / 12.0, 7.9 / 8.0))
    assert near.offenders == ("a and b: 11.90 m along, 7.90 m across",)


def test_start_and_end_lie_outside_every_region() -> None:
    region = PAPER.region_around(Box(19.5, 20.5, -0.5, 0.5), 0.0)
    in_the_way = [obstacle("1", (20.0, 0.0))]
    for end_m, clear in [
        (region.approach_x_m - 0.6, True),
        (region.approach_x_m - 0.4, False),
        (region.departure_x_m - 0.1, False),
        (region.departure_x_m + 0.1, True),
    ]:
        flown = mission((end_m, 0.0), half_width_m=0.5)
        assert rules(in_the_way, flown)["end_clear"].holds is clear
    at_the_start = rules([obstacle("1", (3.0, 0.0))], mission((46.0, 0.0)))["start_clear"]
    assert at_the_start.offenders == ("1 (leg 1)",)


def test_a_later_leg_starts_anywhere_beside_the_end_of_the_one_before() -> None:
    beside = [obstacle("1", (42.0, 8.0))]
    narrow = rules(beside, mission((40.0, 0.0), (40.0, -40.0), half_width_m=0.5))
    wide = rules(beside, mission((40.0, 0.0), (40.0, -40.0), half_width_m=9.0))
    assert narrow["start_clear"].holds
    assert not wide["start_clear"].holds


def test_offenders_are_bounded() -> None:
    # As large as an obstacle may be, so that none are avoided as one.
    crowd = [obstacle(str(n), (0.01 * n, 0.0), size_m=(1.2, 1.2)) for n in range(60)]
    disjoint = rules(crowd)["roi_disjoint"]
    assert disjoint.required == 60 * 59 / 2
    assert len(disjoint.offenders) == OFFENDERS_MAX


coordinates = st.floats(-50.0, 50.0)
sizes = st.floats(0.0, 20.0)


@given(st.lists(st.tuples(coordinates, coordinates, sizes, sizes), max_size=25))
def test_the_index_finds_what_comparing_all_pairs_finds(
    corners: list[tuple[float, float, float, float]],
) -> None:
    boxes = [Box(x, x + along, y, y + across) for x, y, along, across in corners]
    everyone = {
        (i, j)
        for j, second in enumerate(boxes)
        for i, first in enumerate(boxes[:j])
        if first.intersects(second)
    }
    edges = [(b.x_min_m, b.x_max_m, b.y_min_m, b.y_max_m) for b in boxes]
    found = list(intersecting_pairs(np.array(edges).reshape(-1, 4)))
    assert len(found) == len(set(found))
    assert set(found) == everyone


def test_a_large_forest_is_checked() -> None:
    """Ten thousand stems; comparing all pairs in Python would take minutes."""
    grid = np.arange(100) * 15.0
    field = ObstacleField.of(
        [obstacle(f"{x:.0f}/{y:.0f}", (x + 20.0, y)) for x in grid for y in grid]
    )
    found = {rule.name: rule for rule in check_field(PAPER, field, None)}
    assert all(rule.holds for rule in found.values())
    assert found["separation"].declared == pytest.approx(15.0)


def test_stems_from_a_survey(
    clearway: Clearway, config: Path, written: Callable[[str, Any], Path]
) -> None:
    stems = written("stems.csv", "x_m,y_m,dbh_cm\n20.0,0.0,110.0\n40.0,1.0,105.0\n")
    contract = config / "paper_contract.yaml"
    ran = clearway("preflight", "--contract", contract, "--field", stems)
    assert ran.code == 0


def test_no_vehicle_is_said_so() -> None:
    url = f"udpin://127.0.0.1:{free_ports(1)[0]}"
    request = LiveRequest(vehicle_url=url, connect_timeout_s=0.2)
    (finding,) = check_live(request, PAPER, None, paper_compliant=True)
    assert finding.verdict is Verdict.UNKNOWN
    assert "no autopilot heard in 0.2 s" in finding.text


@pytest.mark.parametrize(
    ("options", "accepted"),
    [
        ((), False),
        (("--accept-no-progress",), False),  # it complies: there is nothing to accept
        (("--accept-no-progress", "--set", "environment.obstacle_separation_min_m=1"), True),
        (("--set", "environment.obstacle_separation_min_m=1"), False),
    ],
)
def test_an_acceptance_goes_with_the_live_check_where_it_is_needed(
    clearway: Clearway,
    config: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    *,
    accepted: bool,
) -> None:
    asked: list[LiveRequest] = []

    def check(request: LiveRequest, *_: object, **__: object) -> tuple[Finding, ...]:
        asked.append(request)
        return ()

    monkeypatch.setattr("gcs_tools.preflight.live.check.check_live", check)
    contract, url = config / "default_contract.yaml", "udpin://127.0.0.1:14550"
    clearway("preflight", "--contract", contract, "--vehicle", url, *options)
    assert [request.accept_no_progress for request in asked] == [accepted]


def test_no_vehicle_cannot_be_checked_but_the_paper_is(
    clearway: Clearway, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hasty = partial(LiveRequest, connect_timeout_s=0.2)
    monkeypatch.setattr("gcs_tools.preflight.live.check.LiveRequest", hasty)
    url = f"udpin://127.0.0.1:{free_ports(1)[0]}"
    arguments = ("preflight", "--contract", config / "paper_contract.yaml", "--vehicle", url)
    fine = clearway(*arguments)
    assert fine.code == 2
    assert fine.out.startswith("COULD NOT BE CHECKED")
    broken = clearway(*arguments, "--set", "sensor.detection_range_m=4.0")
    assert broken.code == 1


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("smoke://signals", "Unknown protocol"),
        ("", "Unknown protocol"),
        ("14550", "Unknown protocol"),
        ("udpin://", "CONNECTION_URL_INVALID"),
        ("udpin://127.0.0.1", "CONNECTION_URL_INVALID"),
        ("udpin://127.0.0.1:99999", "CONNECTION_URL_INVALID"),
        ("udpin://127.0.0.1:-1", "CONNECTION_URL_INVALID"),
        ("tcpout://127.0.0.1:port", "CONNECTION_URL_INVALID"),
        ("udpin://256.0.0.1:14550", "Invalid local IP"),
        ("serial:///dev/nowhere:57600", "No such file"),
    ],
)
def test_a_wrong_url_is_one_line(clearway: Clearway, config: Path, url: str, reason: str) -> None:
    ran = clearway("preflight", "--contract", config / "paper_contract.yaml", "--vehicle", url)
    assert_refused(ran, f"{url!r} cannot be opened: ", reason, "expected udpin://HOST:PORT")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--system-id", "0"), "--system-id 0: expected 1 to 255"),
        (("--system-id", "256"), "--system-id 256: expected 1 to 255"),
        (("--system-id", "-1"), "'-1' is not a whole number"),
        (("--system-id", "one"), "'one' is not a whole number"),
        (("--system-id", "1.5"), "'1.5' is not a whole number"),
    ],
)
def test_a_wrong_system_id_is_one_line(
    clearway: Clearway, config: Path, arguments: tuple[str, ...], words: str
) -> None:
    url = f"udpin://127.0.0.1:{free_ports(1)[0]}"
    contract = config / "paper_contract.yaml"
    ran = clearway("preflight", "--contract", contract, "--vehicle", url, *arguments)
    assert_refused(ran, words)


def test_a_system_id_needs_a_connection(clearway: Clearway, config: Path) -> None:
    ran = clearway("preflight", "--contract", config / "paper_contract.yaml", "--system-id", "1")
    assert_refused(ran, "--system-id", "needs --vehicle")


def test_two_vehicles_on_the_port_are_refused_by_name(clearway: Clearway, config: Path) -> None:
    port = free_ports(1)[0]
    with autopilots(FakeAutopilot(port, 1), FakeAutopilot(port, 12)):
        ran = clearway(
            "preflight", "--contract", config / "paper_contract.yaml",
            "--vehicle", f"udpin://127.0.0.1:{port}",
        )  # fmt: skip
    assert_refused(ran, "autopilots of system ids 1, 12: choose one by --system-id")


@pytest.mark.parametrize("text", ["0", "-1", "nan", "long"])
def test_endurance_is_a_number(clearway: Clearway, config: Path, text: str) -> None:
    contract = config / "paper_contract.yaml"
    assert clearway("preflight", "--contract", contract, "--endurance", text).code == 2
