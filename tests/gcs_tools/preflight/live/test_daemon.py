"""What a daemon says of each sensor of its file."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.daemon import (
    Status,
    mission_findings,
    ring_findings,
    sensor_findings,
)
from gcs_tools.preflight.live.detections import check_detections
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from tests.gcs_tools.running import CONFIG

TERMS = assess(load_contract(CONFIG / "default_contract.yaml")).terms


@pytest.mark.parametrize(
    ("said", "verdict", "words"),
    [
        ({"age_s": 0.05, "stamp_ahead_s": -0.02}, Verdict.HOLDS, "0.050 s old"),
        ({"age_s": 60.0}, Verdict.BROKEN, "60.000 s old"),
        ({"age_s": None}, Verdict.BROKEN, "clearway sensor check"),
        ({"age_s": None, "refused": {"truncated": 3}}, Verdict.BROKEN, "dropped: truncated"),
        ({"age_s": 0.0, "stamp_ahead_s": 2.5}, Verdict.BROKEN, "2.50 s ahead"),
        ({"age_s": 0.05, "refused": {"two publishers": 9}}, Verdict.HOLDS, "two publishers"),
        (None, Verdict.BROKEN, "started with another file"),
        ({"age_s": "old", "refused": 3}, Verdict.BROKEN, "nothing that can be used"),
    ],
)
def test_each_sensor_is_judged_by_name(said: Any, verdict: Verdict, words: str) -> None:
    statuses = [Status(0.0, {"sensors": {"lidar": {"age_s": 9.0}}})]
    statuses.append(Status(1.0, {"sensors": {} if said is None else {"lidar": said}}))
    (found,) = sensor_findings(statuses, ("lidar",), TERMS)
    assert (found.subject, found.name, found.verdict) == ("sensor", "lidar", verdict)
    assert words in found.text


@pytest.mark.parametrize(
    ("ages_s", "verdict", "words"),
    [
        ((0.02, 0.21, 0.06), Verdict.HOLDS, "up to 0.210 s old in 3 statuses, frame_age_max_s 0.3"),
        ((0.02, 0.41, 0.06), Verdict.BROKEN, "up to 0.410 s old"),
        ((None, 0.06), Verdict.BROKEN, "did not hear it all the time"),
        ((), Verdict.UNKNOWN, "no status"),
    ],
)
def test_the_sensor_that_sees_all_round_is_measured(
    ages_s: tuple[float | None, ...], verdict: Verdict, words: str
) -> None:
    terms = assess(load_contract(CONFIG / "movers_contract.yaml")).terms
    statuses = [Status(0.0, {"sensors": {"ring": {"age_s": age_s}}}) for age_s in ages_s]
    (found,) = ring_findings(statuses, ("ring",), terms)
    assert (found.name, found.verdict) == ("ring all_round", verdict)
    assert words in found.text
    assert ring_findings(statuses, ("ring",), TERMS) == []  # without movers
    # Then no detections as JSON have to see all round.
    live = check_detections([], [], terms, 3.0, None, needed=False, rings=("ring",))
    assert live == []


@pytest.mark.parametrize(
    ("said", "verdict", "words"),
    [
        ({"mission": "2 legs, 24 m"}, Verdict.HOLDS, "read from the vehicle: 2 legs, 24 m"),
        ({"mission": "2 legs", "mission_doubt": "is being read"}, Verdict.BROKEN, "is being read"),
    ],
)
def test_the_mission_on_board_is_said(said: Any, verdict: Verdict, words: str) -> None:
    (found,) = mission_findings([Status(0.0, {"mission_doubt": "before"}), Status(1.0, said)])
    assert (found.subject, found.name, found.verdict) == ("daemon", "mission", verdict)
    assert found.text == words


def test_of_a_mission_file_nothing_is_said() -> None:
    assert mission_findings([]) == []
    assert mission_findings([Status(0.0, {"mission": "", "mission_doubt": None})]) == []


def test_without_a_status_nothing_is_known() -> None:
    found = sensor_findings([], ("lidar", "sectors"), TERMS)
    assert {each.verdict for each in found} == {Verdict.UNKNOWN}
    (odd,) = sensor_findings([Status(0.0, {"sensors": [1]})], ("lidar",), TERMS)
    assert odd.verdict is Verdict.BROKEN


def test_detections_as_json_are_needed_only_without_other_sensors() -> None:
    assert [each.name for each in check_detections([], [], TERMS, 3.0, None)] == ["frames"]
    assert check_detections([], [], TERMS, 3.0, None, needed=False) == []
