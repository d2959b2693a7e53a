"""Time series of a flight, brought to the times of its poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_tools.console.errors import CommandError
from gcs_tools.identify.streams import (
    POSES_MIN,
    Streams,
    Timeline,
    in_order,
    reference_in_order,
)
from onboard.geometry.frames import FloatArray

TIMES_S = np.arange(0.0, 20.0, 0.1)
NAMES = ("poses", "setpoints", "attitudes", "modes")


def table(times_s: FloatArray, *columns: Any) -> FloatArray:
    return np.column_stack([times_s, *(np.broadcast_to(c, len(times_s)) for c in columns)])


def streams(**changes: Any) -> Streams:
    """North at 2 m/s, a fifth of a metre east of the reference and half a metre above it."""
    north_m = 2.0 * TIMES_S
    flown = Streams(
        source="log",
        pose=table(TIMES_S, north_m, 0.2, -5.5, 2.0, 0.0, 0.0),
        reference=table(TIMES_S, north_m, 0.0, -5.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1),
        attitude=table(TIMES_S, 0.0, 0.0, 0.0),
        control=np.array([[0.0, 1.0]]),
        names=NAMES,
    )
    return replace(flown, **changes)


def test_errors_are_those_to_the_reference() -> None:
    recording = streams().recording()
    assert len(recording.time_s) == len(TIMES_S)
    assert recording.position_error_m == pytest.approx(0.2)
    assert recording.height_error_m == pytest.approx(0.5)
    assert recording.velocity_error_mps == pytest.approx(0.0)
    assert recording.heading_error_rad == pytest.approx(0.1)


def test_a_heading_beyond_half_a_turn_is_near() -> None:
    nearly = np.pi - 0.05
    recording = streams(
        attitude=table(TIMES_S, 0.0, 0.0, nearly),
        reference=table(TIMES_S, 2.0 * TIMES_S, 0, -5, 2, 0, 0, 0, 0, 0, -nearly),
    ).recording()
    assert recording.heading_error_rad == pytest.approx(0.1)


def test_a_heading_at_rest_is_not_compared() -> None:
    pose = table(TIMES_S, 2.0 * TIMES_S, 0.2, -5.5, 0.1, 0.0, 0.0)
    assert len(streams(pose=pose).recording().heading_error_rad) == 0


@pytest.mark.parametrize("missing", ["pose", "reference", "attitude", "control"])
def test_what_is_missing_is_named_as_the_log_names_it(missing: str) -> None:
    empty = np.empty((0, getattr(streams(), missing).shape[1]))
    name = NAMES[("pose", "reference", "attitude", "control").index(missing)]
    with pytest.raises(CommandError, match=f"log: no flight to measure: no {name}$"):
        streams(**{missing: empty}).recording()


def test_slow_setpoints_are_refused_with_their_rate() -> None:
    slow = streams().reference[::5]
    with pytest.raises(CommandError, match=r"setpoints at 2.0 Hz, expected at least 4 Hz"):
        streams(reference=slow).recording()


def test_too_few_poses_on_setpoints_are_refused_with_their_number() -> None:
    late = np.array([[0.0, 0.0], [16.0, 1.0]])
    with pytest.raises(CommandError, match=rf"at \d+ poses of poses, at least {POSES_MIN}"):
        streams(control=late).recording()


def test_only_poses_under_control_count() -> None:
    control = np.array([[0.0, 0.0], [5.0, 1.0], [15.0, 0.0]])
    times_s = streams(control=control).recording().time_s
    assert (times_s[0], times_s[-1]) == pytest.approx((5.0, 14.9))


def test_poses_in_a_pause_of_the_stream_do_not_count() -> None:
    reference = streams().reference
    paused = reference[(reference[:, 0] < 8.0) | (reference[:, 0] > 12.0)]
    times_s = streams(reference=paused).recording().time_s
    assert not np.any((times_s > 8.31) & (times_s < 11.69))
    assert len(times_s) > 150


def test_a_target_of_before_the_control_is_not_followed() -> None:
    control = np.array([[0.0, 0.0], [10.05, 1.0]])
    times_s = streams(control=control).recording().time_s
    assert times_s[0] == pytest.approx(10.1)


def test_what_the_vehicle_does_is_its_commanded_acceleration() -> None:
    recording = streams().recording()
    assert recording.doing(3.0) == "commanded [0.00, 0.00] m/s² north, east"
    unknown = streams().reference.copy()
    unknown[:, 7:] = np.nan
    assert streams(reference=unknown).recording().doing(3.0) == "commanded acceleration unknown"
    told = streams(doing=lambda time_s: f"at {time_s}").recording()
    assert told.doing(3.0) == "at 3.0"


# ---------------------------------------------------------------------------- tables


def test_rows_are_put_in_order_and_incomplete_ones_dropped() -> None:
    rows: list[tuple[float, ...]] = [(3.0, 1.0), (1.0, 2.0), (2.0, float("nan"))]
    assert in_order(rows, 1).tolist() == [[1.0, 2.0], [3.0, 1.0]]
    assert in_order([], 4).shape == (0, 5)


def test_a_reference_needs_its_position_alone() -> None:
    unknown = (float("nan"),) * 7
    rows: list[tuple[float, ...]] = [
        (0.0, 1.0, 2.0, 3.0, *unknown),
        (1.0, float("nan"), 2.0, 3.0, *unknown),
    ]
    assert reference_in_order(rows)[:, 0].tolist() == [0.0]


@given(st.lists(st.floats(-1e4, 1e4), min_size=2, max_size=30))
def test_times_never_run_back_by_more_than_a_reordering(times_s: list[float]) -> None:
    timeline = Timeline()
    steps_s = np.diff([timeline.at(time_s) for time_s in times_s])
    assert steps_s.min() >= -0.0200001
    assert steps_s.max() <= 10.0 + 1e-6


# Steps below the second from which on a time counts as jumped, by more than sums round off.
@given(st.lists(st.floats(0.0, 0.999), min_size=1, max_size=30), st.floats(-1e3, 1e3))
def test_times_that_run_forward_are_left_alone(steps_s: list[float], start_s: float) -> None:
    times_s = (start_s + np.cumsum(steps_s)).tolist()
    timeline = Timeline()
    assert [timeline.at(time_s) for time_s in times_s] == times_s
