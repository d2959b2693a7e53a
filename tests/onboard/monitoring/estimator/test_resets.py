"""Jumps of the estimate on three axes, what they add up to, and where late frames belong."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.monitoring.assumptions import Assumption
from onboard.monitoring.estimator.resets import (
    CONTINUITY_S,
    POSITION_JUMP_M,
    SENSOR_FRAME_TOLERANCE_S,
    EstimatorReset,
    PoseMonitor,
    ResetLedger,
)
from onboard.vehicle_state import AUTOPILOT_SILENCE_S, Pose

Vector = tuple[float, float, float]
PERIOD_S = 0.02
STILL = (0.0, 0.0, 0.0)


def pose(
    time_s: float,
    position_ned_m: Vector,
    velocity_ned_mps: Vector = STILL,
    measured_s: float | None = None,
) -> Pose:
    return Pose(time_s, position_ned_m, velocity_ned_mps, 0.0, 0.0, 0.0, measured_s)


def test_telemetry_grows_stale() -> None:
    monitor = PoseMonitor(telemetry_timeout_s=0.5)
    assert monitor.check_age(pose(1.0, STILL), 1.5, heard_s=1.0) is None
    stale = monitor.check_age(pose(1.0, STILL), 1.51, heard_s=1.0)
    assert stale is not None
    assert stale.assumption is Assumption.TELEMETRY_AGE
    assert monitor.check_age(None, 0.0, heard_s=0.0) is not None


def test_a_silent_autopilot_is_old_telemetry_although_its_positions_arrive() -> None:
    monitor = PoseMonitor(telemetry_timeout_s=0.5)
    assert monitor.check_age(pose(9.0, STILL), 9.0, heard_s=9.0 - AUTOPILOT_SILENCE_S) is None
    silent = monitor.check_age(pose(9.0, STILL), 9.0, heard_s=8.9 - AUTOPILOT_SILENCE_S)
    assert silent is not None
    assert str(silent) == "telemetry_age: 3.10, limit 3.00 s; no heartbeat of the autopilot"


velocities = st.tuples(*[st.floats(-8.0, 8.0)] * 3)
jumps = st.tuples(*[st.floats(-6.0, 6.0)] * 3)


@given(velocity=velocities, jump=jumps)
def test_a_jump_on_any_axis_is_noticed_and_measured_and_flight_is_none(
    velocity: Vector, jump: Vector
) -> None:
    monitor = PoseMonitor(0.5)
    north, east, down = velocity

    def flown(time_s: float, offset: Vector) -> Pose:
        position = (
            north * time_s + offset[0],
            east * time_s + offset[1],
            down * time_s + offset[2],
        )
        return pose(time_s, position, velocity)

    for step in range(5):
        assert monitor.check_jump(flown(step * PERIOD_S, STILL)) is None
    reset = monitor.check_jump(flown(5 * PERIOD_S, jump))
    size_m = math.hypot(*jump)
    if size_m > POSITION_JUMP_M + 0.01:
        assert reset is not None
        assert reset.measured
        assert reset.shift_ned_m == pytest.approx(jump, abs=1e-9)
    elif size_m < POSITION_JUMP_M:
        assert reset is None
    assert monitor.check_jump(flown(6 * PERIOD_S, jump)) is None


@pytest.mark.parametrize(
    ("jump", "axis"),
    [
        ((0.0, 0.0, 3.5), "vertical"),
        ((0.0, 0.0, -5.5), "vertical"),
        ((1.0, 1.0, 1.2), "horizontal"),
        ((0.0, -0.6, 0.0), "horizontal"),
    ],
)
def test_violation_names_the_part_that_jumped(jump: Vector, axis: str) -> None:
    violation = EstimatorReset(0.0, 0.02, jump, measured=True).violation()
    assert violation.assumption is Assumption.ESTIMATOR_RESET
    assert violation.subject == axis
    assert violation.measured == pytest.approx(math.hypot(*jump))


@given(
    acceleration=st.tuples(*[st.floats(-10.0, 10.0)] * 3).filter(lambda a: math.hypot(*a) <= 10.0),
    step_s=st.floats(0.005, CONTINUITY_S),
)
def test_acceleration_that_begins_between_two_poses_is_no_jump(
    acceleration: Vector, step_s: float
) -> None:
    """Whatever the vehicle does in between: hardest if it accelerates for half of the step."""
    monitor = PoseMonitor(0.5)
    monitor.check_jump(pose(0.0, STILL))
    half_s = step_s / 2.0
    for late in (True, False):
        moved = [a * half_s**2 / 2.0 + (0.0 if late else a * half_s * half_s) for a in acceleration]
        velocity = tuple(a * half_s for a in acceleration)
        monitor = PoseMonitor(0.5)
        monitor.check_jump(pose(0.0, STILL))
        north, east, down = moved
        assert monitor.check_jump(pose(step_s, (north, east, down), velocity)) is None  # type: ignore[arg-type]


@pytest.mark.parametrize("delay_s", [0.1, 0.3, 0.45])
def test_a_delayed_pose_is_no_jump_where_the_autopilot_dates_it(delay_s: float) -> None:
    """Measured 20 ms apart, delivered late: at 2.8 m/s arrival times would say 0.8 to 1.3 m."""
    monitor = PoseMonitor(0.5)
    fast = (2.8, 0.0, 0.0)
    assert monitor.check_jump(pose(1.0, STILL, fast, measured_s=50.0)) is None
    assert monitor.check_jump(pose(1.0 + delay_s, (0.056, 0.0, 0.0), fast, 50.02)) is None
    # And one that a link let overtake.
    assert monitor.check_jump(pose(1.01 + delay_s, (0.028, 0.0, 0.0), fast, 50.01)) is None


@pytest.mark.parametrize("measured_s", [50.0, 1.0, 9e6, None])
def test_without_a_sane_clock_of_the_autopilot_arrival_counts(measured_s: float | None) -> None:
    monitor = PoseMonitor(0.5)
    fast = (2.8, 0.0, 0.0)
    monitor.check_jump(pose(1.0, STILL, fast, 50.0))
    assert monitor.check_jump(pose(1.02, (0.056, 0.0, 0.0), fast, measured_s)) is None
    assert monitor.check_jump(pose(1.04, (0.112, 0.0, 3.5), fast, measured_s)) is not None


def test_after_a_silence_a_jump_is_noticed_but_not_measured() -> None:
    monitor = PoseMonitor(0.5)
    monitor.check_jump(pose(1.0, STILL))
    reset = monitor.check_jump(pose(3.0, (0.0, 0.0, 2.0)))
    assert reset is not None
    assert not reset.measured
    assert ResetLedger().count(reset, 100.0) is not None


def reset_at(time_s: float, shift: Vector, *, measured: bool = True) -> EstimatorReset:
    return EstimatorReset(time_s - PERIOD_S, time_s, shift, measured)


@pytest.mark.parametrize(
    ("bound_m", "sizes_m", "ends_at"),
    [
        (0.0, [0.5], 0),
        (1.0, [0.5, 0.4, 0.2], 2),
        (1.0, [1.1], 0),
        (2.0, [0.6, 0.6, 0.6], None),
    ],
)
def test_sum_since_the_departure_counts_against_the_bound(
    bound_m: float, sizes_m: list[float], ends_at: int | None
) -> None:
    ledger = ResetLedger()
    for _ in range(2):  # a departure begins anew
        ledger.begin_flight()
        ended = [
            ledger.count(reset_at(1.0, (0.0, 0.0, size_m)), bound_m) is not None
            for size_m in sizes_m
        ]
        first = ended.index(True) if any(ended) else None
        assert first == ends_at


def test_jumps_back_and_forth_do_not_cancel() -> None:
    ledger = ResetLedger()
    assert ledger.count(reset_at(1.0, (0.6, 0.0, 0.0)), 1.0) is None
    assert ledger.count(reset_at(1.1, (-0.6, 0.0, 0.0)), 1.0) is not None


def test_unanswered_resets_are_taken_once() -> None:
    ledger = ResetLedger()
    ledger.add(reset_at(1.0, (1.0, 0.0, 0.0)))
    assert len(ledger.take_pending()) == 1
    assert ledger.take_pending() == []


LATER_S = SENSOR_FRAME_TOLERANCE_S + PERIOD_S + 0.001


@pytest.mark.parametrize(
    ("stamp_s", "placements_m"),
    [
        (9.0, [(3.0, 0.5)]),
        (10.0, [(3.0, 0.5), (2.0, 0.0)]),
        (10.0 + LATER_S, [(2.0, 0.0)]),
        (11.0, [(2.0, 0.0), (0.0, 0.0)]),
        (11.0 + LATER_S, [(0.0, 0.0)]),
    ],
)
def test_boxes_in_the_local_frame_move_by_the_resets_after_their_stamp(
    stamp_s: float, placements_m: list[tuple[float, float]]
) -> None:
    ledger = ResetLedger()
    ledger.add(reset_at(10.0, (1.0, 0.5, 0.2)))
    ledger.add(reset_at(11.0, (2.0, 0.0, 0.0)))
    assert ledger.placements_m(stamp_s) == placements_m


def test_without_resets_boxes_stay() -> None:
    assert ResetLedger().placements_m(5.0) == [(0, 0)]
    ledger = ResetLedger()
    ledger.add(reset_at(10.0, (5.0, 0.0, 0.0), measured=False))
    assert ledger.placements_m(5.0) == [(0, 0)]
