"""Where a report opens, what it marks, and the true obstacles that it draws."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_tools.flight_report.moments import marks, opening_s
from gcs_tools.flight_report.true_field import true_outlines_ned_m
from gcs_tools.logs.flight_log import Log, read_log
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import EventRecord, StateRecord
from sitl.environment.truth_log import TruthLog

BEGAN_S = 1_790_000_000.0
PHASES = ["standby"] * 10 + ["cruise"] * 60 + ["hold"] * 20 + ["standby"] * 10
STATES = [
    StateRecord(time_s=BEGAN_S + n * 0.1, phase=phase, position_ned_m=(0.1 * n, 1.0, -4.0))
    for n, phase in enumerate(PHASES)
]
VIOLATION = EventRecord(
    time_s=BEGAN_S + 7.0, name="violation", severity="error", text="tracking_error: 0.4"
)
HOLD = EventRecord(
    time_s=BEGAN_S + 7.0, name="phase", text="holding: tracking_error: 0.4", data={"to": "hold"}
)
CRUISE = EventRecord(time_s=BEGAN_S + 1.0, name="phase", text="cruise", data={"to": "cruise"})
EARLY = EventRecord(time_s=BEGAN_S - 60.0, name="violation", text="while the report does not show")


def truths(*contacts_s: float, touches_s: tuple[float, ...] = ()) -> list[TruthRecord]:
    times_s = [n * 0.1 for n in range(100)]
    return [
        TruthRecord(
            time_unix_s=BEGAN_S + time_s,
            position_ned_m=(0.0, 0.0, 0.0),
            collisions=sum(at_s <= time_s for at_s in contacts_s),
            contacts_at_rest=sum(at_s <= time_s for at_s in touches_s),
        )
        for time_s in times_s
    ]


def test_a_hold_is_marked_where_and_why_it_was() -> None:
    found = marks([EARLY, CRUISE, VIOLATION, HOLD], [], STATES, BEGAN_S + 1.0)
    assert [(each["time_s"], each["kind"]) for each in found] == [(6.0, "violation"), (6.0, "hold")]
    assert found[-1]["text"] == "holding: tracking_error: 0.4"
    assert found[-1]["place_ned_m"] == pytest.approx([7.0, 1.0])
    assert opening_s(found, STATES, BEGAN_S + 1.0) == 6.0


def test_a_contact_is_where_to_look_first() -> None:
    found = marks([VIOLATION, HOLD], truths(8.0, 8.5), STATES, BEGAN_S)
    assert [each["kind"] for each in found] == ["violation", "hold", "contact", "contact"]
    assert opening_s(found, STATES, BEGAN_S) == 8.0


def test_a_touch_at_rest_is_shown_and_is_no_contact() -> None:
    found = marks([HOLD], truths(touches_s=(3.0,)), STATES, BEGAN_S)
    assert [(each["time_s"], each["kind"]) for each in found] == [(3.0, "touch"), (7.0, "hold")]
    assert "no collision" in found[0]["text"]
    assert found[0]["place_ned_m"] == pytest.approx([3.0, 1.0])
    # Where the vehicle held is to be looked at, and where it only was touched, the end.
    assert opening_s(found, STATES, BEGAN_S) == 7.0
    assert opening_s(found[:1], STATES, BEGAN_S) == 8.9


def test_without_a_failure_it_opens_at_the_end_of_the_mission() -> None:
    assert opening_s([], STATES, BEGAN_S) == pytest.approx(8.9)
    waiting = STATES[:10]
    assert opening_s([], waiting, BEGAN_S) == pytest.approx(0.9)


def test_a_flight_without_positions_is_marked_without_a_place() -> None:
    nowhere = [StateRecord(time_s=state.time_s, phase=state.phase) for state in STATES]
    (found,) = marks([HOLD], [], nowhere, BEGAN_S)
    assert found["place_ned_m"] is None


def test_true_obstacles_near_the_flight_come_from_the_log_of_the_truth(tmp_path: Path) -> None:
    field = ObstacleField.of(
        [
            Obstacle(id="turned", center_ned_m=(5.0, 2.0), size_m=(2.0, 4.0), yaw_deg=90.0),
            Obstacle(id="far", center_ned_m=(500.0, 2.0), size_m=(2.0, 4.0)),
        ]
    )
    with TruthLog(tmp_path / "truth.mcap", BEGAN_S, field):
        pass
    (outline,) = true_outlines_ned_m(read_log(tmp_path / "truth.mcap"), STATES)
    # A quarter turn: two metres across, four along.
    expected = {(3.0, 1.0), (3.0, 3.0), (7.0, 1.0), (7.0, 3.0)}
    assert {(round(n, 2), round(e, 2)) for n, e in outline} == expected
    ways_m = [math.dist(a, b) for a, b in zip(outline, [*outline[1:], outline[0]], strict=True)]
    assert ways_m == pytest.approx([2.0, 4.0, 2.0, 4.0])


@pytest.mark.parametrize(
    "metadata",
    [
        {},
        {"field": {}},
        {"field": {"center_ned_m": "[[1", "half_size_m": "[]", "yaw_rad": "[]"}},
        {"field": {"center_ned_m": "[[1, 2]]", "half_size_m": "[]", "yaw_rad": "[0]"}},
        {"field": {"center_ned_m": "[[1, 2]]", "half_size_m": "[[NaN, 1]]", "yaw_rad": "[0]"}},
        {"field": {"center_ned_m": '[["x", 2]]', "half_size_m": "[[1, 1]]", "yaw_rad": "[0]"}},
    ],
)
def test_a_log_without_a_field_has_no_outlines(metadata: dict[str, dict[str, str]]) -> None:
    assert true_outlines_ned_m(Log(metadata=metadata), STATES) == []
