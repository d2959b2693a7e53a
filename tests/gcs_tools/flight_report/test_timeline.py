"""What the report reads from states, obstacles and plans over time."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_tools.flight_report.timeline import (
    SEEN_SPACES_MAX,
    departure_s,
    flight_states,
    height_m,
    known_columns,
    monitors_during,
    obstacle_spans,
    path_columns,
    phase_spans,
    plan_paths,
    seen_spaces,
    since,
    truth_columns,
    truths_during,
)
from onboard.files.truth_record import TruthRecord
from onboard.recording.messages import (
    Monitors,
    Obstacles,
    PlanRecord,
    Reading,
    SeenSpace,
    StateRecord,
)
from tests.gcs_tools.logs.raw_log import made

BEGAN_S = 1_000.0


def state(offset_s: float, phase: str = "cruise", **more: Any) -> StateRecord:
    return made(StateRecord, {"time_s": BEGAN_S + offset_s, "phase": phase, **more})


def test_times_are_since_departure_to_the_millisecond() -> None:
    assert since(state(1.23456), BEGAN_S) == 1.235
    assert since(state(-1.0), BEGAN_S) == -1.0


# ---------------------------------------------------------------------------- which states


def test_waiting_on_the_ground_is_left_out() -> None:
    states = [state(n / 10, armed=100 <= n < 300) for n in range(600)]
    shown = flight_states(states)
    assert (shown[0].time_s, shown[-1].time_s) == pytest.approx(
        (BEGAN_S + 10.0 - 1.0, BEGAN_S + 29.9 + 1.0)
    )


def test_airborne_counts_like_armed() -> None:
    states = [state(float(n), airborne=n == 5) for n in range(10)]
    assert [each.time_s - BEGAN_S for each in flight_states(states)] == [4.0, 5.0, 6.0]


def test_a_vehicle_that_never_left_is_shown_whole() -> None:
    states = [state(float(n), armed=False) for n in range(5)]
    assert flight_states(states) == states


def test_times_that_run_backwards_are_shown_whole() -> None:
    states = [state(50.0, armed=True), state(0.0), state(10.0, armed=True)]
    assert flight_states(states) == states


def test_records_outside_the_shown_time_are_left_out() -> None:
    states = [state(1.0), state(3.0)]
    records = [Monitors(time_s=BEGAN_S + n) for n in range(5)]
    assert monitors_during(records, states) == records[1:4]
    truths = [
        TruthRecord(time_unix_s=BEGAN_S + n, position_ned_m=(0.0, 0.0, 0.0)) for n in range(5)
    ]
    assert truths_during(truths, states) == truths[1:4]


def test_departure_is_when_standby_ends() -> None:
    assert departure_s([state(0.0, "standby"), state(2.0), state(3.0)]) == BEGAN_S + 2.0
    assert departure_s([state(0.0, "standby"), state(2.0, "standby")]) == BEGAN_S


def test_height_is_the_greatest_and_positive_upwards() -> None:
    states = [state(0.0, position_ned_m=[0.0, 0.0, down_m]) for down_m in (-1.0, -4.5, -2.0)]
    assert height_m([*states, state(1.0, position_ned_m=None)]) == 4.5
    assert height_m([state(0.0)]) == 0.0


# ---------------------------------------------------------------------------- columns


def test_columns_are_of_one_length_with_nulls_for_what_is_missing() -> None:
    full = state(
        0.5,
        position_ned_m=[1.0, 2.0, -3.0],
        velocity_ned_mps=[0.1, 0.2, -0.3],
        reference_position_ned_m=[1.1, 2.1, -3.1],
        reference_velocity_ned_mps=[0.4, 0.5, 0.6],
        roll_rad=0.1,
        pitch_rad=-0.1,
        yaw_rad=1.0,
        tracking_error_m=0.05,
        velocity_error_mps=[-0.2, 0.1],
        cruising=True,
        detection_age_s=0.07,
    )
    columns = path_columns([full, state(1.0)], BEGAN_S)
    assert {len(column) for column in columns.values()} == {2}
    assert columns["time_s"] == [0.5, 1.0]
    assert columns["height_m"] == [3.0, None]
    assert columns["up_mps"] == [0.3, None]
    assert columns["reference_up_mps"] == [-0.6, None]
    assert columns["roll_deg"] == [5.73, None]
    assert columns["velocity_error_along_mps"] == [0.2, None]


def test_velocity_errors_count_while_cruising_only() -> None:
    avoiding = state(0.0, "avoid", velocity_error_mps=[0.3, 0.3], cruising=False)
    assert path_columns([avoiding], BEGAN_S)["velocity_error_along_mps"] == [None]


@pytest.mark.parametrize(
    ("phase", "shown"), [("cruise", 0.1), ("avoid", 0.1), ("hold", None), ("standby", None)]
)
def test_tracking_errors_count_in_flight_only(phase: str, shown: float | None) -> None:
    columns = path_columns([state(0.0, phase, tracking_error_m=0.1)], BEGAN_S)
    assert columns["tracking_error_m"] == [shown]


def test_detections_show_their_greatest_age() -> None:
    saw = [state(n / 50, detection_age_s=(n % 5) / 50) for n in range(60)]
    ages_s = path_columns(saw, BEGAN_S)["detection_age_s"]
    assert set(ages_s[20:]) == {0.08}


def test_the_daemon_s_clearance_may_be_missing() -> None:
    monitors = [
        Monitors(time_s=BEGAN_S, clearance=Reading(measured=1.5)),
        Monitors(time_s=BEGAN_S + 1.0, clearance=Reading(measured=None)),
        Monitors(time_s=BEGAN_S + 2.0),
    ]
    assert known_columns(monitors, BEGAN_S)["clearance_m"] == [1.5, None, None]


def test_rotors_of_ground_truth() -> None:
    here = (0.0, 0.0, 0.0)
    truths = [
        TruthRecord(
            time_unix_s=BEGAN_S, position_ned_m=here, clearance_m=2.0, rpm=(1.0, 2.0, 3.0, 4.0)
        ),
        TruthRecord(time_unix_s=BEGAN_S + 1.0, position_ned_m=here, rpm=(1.0,)),
    ]
    columns = truth_columns(truths, BEGAN_S)
    assert columns["rpm"] == [[1.0, 1.0], [2.0, None], [3.0, None], [4.0, None]]
    assert columns["clearance_m"] == [2.0, None]
    assert truth_columns([], BEGAN_S)["rpm"] == []


# ---------------------------------------------------------------------------- spans


def test_each_phase_ends_where_the_next_begins() -> None:
    phases = ("standby", "cruise", "cruise", "avoid", "cruise")
    spans = phase_spans([state(float(n), phase) for n, phase in enumerate(phases)], BEGAN_S)
    assert [(s["phase"], s["start_s"], s["end_s"]) for s in spans] == [
        ("standby", 0.0, 1.0), ("cruise", 1.0, 3.0), ("avoid", 3.0, 4.0), ("cruise", 4.0, 4.0),
    ]  # fmt: skip


def obstacles(offset_s: float, **known: float) -> Obstacles:
    """A message with obstacles by name and north position of one corner."""
    boxes = [{"id": name, "measured_ned_m": [[north_m, 0.0]]} for name, north_m in known.items()]
    return made(Obstacles, {"time_s": BEGAN_S + offset_s, "obstacles": boxes})


def test_an_obstacle_is_shown_from_its_first_sight_to_its_last() -> None:
    first = [obstacles(0.0), obstacles(1.0, a=5.0)]
    spans = obstacle_spans([*first, obstacles(2.0, a=5.0, b=9.0), obstacles(3.0, b=9.0)], BEGAN_S)
    assert [(s["id"], s["since_s"], s["until_s"]) for s in spans] == [
        ("a", 1.0, 3.0), ("b", 2.0, None),
    ]  # fmt: skip
    assert spans[0]["measured_ned_m"] == [[5.0, 0.0]]
    assert spans[0]["region_ned_m"] == []


def test_an_obstacle_that_moves_is_shown_anew() -> None:
    spans = obstacle_spans([obstacles(1.0, a=5.0), obstacles(2.0, a=5.1)], BEGAN_S)
    assert [(s["since_s"], s["until_s"]) for s in spans] == [(1.0, 2.0), (2.0, None)]


def test_a_movement_below_a_millimetre_is_none() -> None:
    spans = obstacle_spans([obstacles(1.0, a=5.0), obstacles(2.0, a=5.0001)], BEGAN_S)
    assert len(spans) == 1


def test_seen_spaces_are_bounded_and_the_last_one_is_kept() -> None:
    count = 4 * SEEN_SPACES_MAX + 3
    records = [
        SeenSpace(time_s=BEGAN_S + n, row=[n], guide_ned_m=[(1.00049, 2.0)]) for n in range(count)
    ]
    kept = seen_spaces(records, BEGAN_S)
    assert len(kept) <= SEEN_SPACES_MAX + 1
    assert (kept[0]["time_s"], kept[-1]["time_s"]) == (0.0, count - 1.0)
    assert kept[-1]["row"] == [count - 1]
    assert kept[0]["guide_ned_m"] == [[1.0, 2.0]]
    assert [each["time_s"] for each in seen_spaces(records[:2], BEGAN_S)] == [0.0, 1.0]
    assert seen_spaces([], BEGAN_S) == []


def test_plans_keep_their_path_and_their_end() -> None:
    plans = [
        PlanRecord(
            time_s=BEGAN_S + 1.0,
            end_s=BEGAN_S + 4.0,
            plan_time_ms=7.5,
            path_ned_m=[(1.00049, 2.0, -4.0)],
        ),
        PlanRecord(time_s=BEGAN_S + 2.0),
    ]
    first, second = plan_paths(plans, BEGAN_S)
    assert first == {
        "time_s": 1.0, "end_s": 4.0, "plan_time_ms": 7.5, "path_ned_m": [[1.0, 2.0, -4.0]]
    }  # fmt: skip
    assert (second["end_s"], second["path_ned_m"]) == (2.0, [])
