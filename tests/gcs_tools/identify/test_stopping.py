"""How a vehicle stops, by motions whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_tools.identify.stopping import IDENTIFYING, SILENT, rest_time_s, run_on
from gcs_tools.logs.flight_log import Log
from onboard.recording.messages import StateRecord

TICK_S = 0.02


def brakes(speed_mps: float, brake_mps2: float, begin_s: float, time_s: float) -> float:
    """Position of a vehicle that flies at a speed, and brakes from a time on."""
    after_s = max(time_s - begin_s, 0.0)
    stopped_s = min(after_s, speed_mps / brake_mps2)
    return speed_mps * min(time_s, begin_s) + speed_mps * stopped_s - brake_mps2 * stopped_s**2 / 2


def silent_flight(
    speed_mps: float, brake_mps2: float, behind_m: float = 0.0, watched_s: float = 6.0
) -> Log:
    """Fly north, then hear no setpoint from 3 s on; the vehicle brakes 0.5 s later."""
    states = []
    for number in range(round((3.0 + watched_s) / TICK_S)):
        time_s = number * TICK_S
        silent = time_s >= 3.0
        north_m = brakes(speed_mps, brake_mps2, 3.5, time_s) - behind_m
        told = None if silent else (speed_mps * time_s, 0.0, -5.0)
        states.append(
            StateRecord(
                time_s=time_s,
                phase=IDENTIFYING,
                state=SILENT if silent else "passing",
                position_ned_m=(north_m, 0.0, -5.0),
                velocity_ned_mps=(speed_mps, 0.0, 0.0),
                reference_position_ned_m=told,
                reference_velocity_ned_mps=None if silent else (speed_mps, 0.0, 0.0),
                telemetry_age_s=0.0,
            )
        )
    return Log(states=states)


@settings(max_examples=20)
@given(st.floats(1.0, 8.0), st.floats(2.0, 6.0), st.floats(0.0, 0.6))
def test_the_run_is_measured_from_the_setpoint_or_from_a_vehicle_behind_it(
    speed_mps: float, brake_mps2: float, behind_m: float
) -> None:
    found = run_on(silent_flight(speed_mps, brake_mps2, behind_m, watched_s=10.0))
    assert found is not None
    assert found.speed_mps == speed_mps
    way_m = 0.5 * speed_mps + speed_mps**2 / (2.0 * brake_mps2)
    # The last setpoint is a tick older than the silence; one that is ahead of the vehicle counts
    # from the vehicle.
    assert found.distance_m == pytest.approx(way_m + speed_mps * TICK_S, abs=1e-3)
    # Within half a metre of where it stops it rests, a second before at the earliest.
    stop_s = 0.5 + speed_mps / brake_mps2
    assert stop_s - 1.1 <= found.rest_s <= stop_s + 0.1


def test_a_vehicle_ahead_of_its_setpoint_ran_from_the_setpoint() -> None:
    on_it, ahead = (run_on(silent_flight(4.0, 4.0, behind_m)) for behind_m in (0.0, -0.5))
    assert on_it is not None
    assert ahead is not None
    assert ahead.distance_m == pytest.approx(on_it.distance_m + 0.5)


def test_a_run_that_was_not_watched_to_its_end_is_unknown() -> None:
    assert run_on(silent_flight(6.0, 2.0, watched_s=2.5)) is None
    assert run_on(silent_flight(6.0, 2.0, watched_s=0.0)) is None


def stops(brake_mps2: float, dwell_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A reference that stops at 3 s, and a vehicle that brakes from then on at 3 m/s."""
    time_s = np.arange(0.0, 3.0 + dwell_s, TICK_S)
    north_m = np.array([brakes(3.0, brake_mps2, 3.0, t) for t in time_s.tolist()])
    nothing = np.zeros_like(time_s)
    pose = np.column_stack((time_s, north_m, *(nothing,) * 5))
    speed_mps = np.where(time_s < 3.0, 3.0, 0.0)
    told = np.minimum(3.0 * time_s, 9.0)
    return pose, np.column_stack((time_s, told, nothing, nothing, speed_mps, *(nothing,) * 6))


@pytest.mark.parametrize("brake_mps2", [1.0, 2.0, 4.0])
def test_rest_is_when_the_vehicle_moves_by_no_more_than_a_hover_does(brake_mps2: float) -> None:
    found = rest_time_s(*stops(brake_mps2, dwell_s=8.0))
    # From v² = 2 b · 0.5 m on it moves by no more than half a metre before it stops.
    assert found == pytest.approx((3.0 - math.sqrt(brake_mps2)) / brake_mps2, abs=0.05)


def test_a_stop_that_is_too_short_shows_no_rest() -> None:
    assert rest_time_s(*stops(2.0, dwell_s=1.0)) is None
