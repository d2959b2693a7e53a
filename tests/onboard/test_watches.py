import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.contract import TICK_S
from onboard.mavlink import Pose
from onboard.monitor import Assumption, Violation
from onboard.watches import (
    CONFIRMATIONS,
    TICK_OVERRUN_S,
    TILT_PATIENCE_S,
    DetectionWatch,
    RivalWatch,
    TickWatch,
    TiltWatch,
    TrackingWatch,
)
from tests.onboard.example_terms import TERMS


def names(violations: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in violations]


def test_sensor_that_was_never_heard_is_blind() -> None:
    watch = DetectionWatch()
    violation = watch.check(0.0, TERMS)
    assert violation is not None
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.event(0.0).data["measured"] is None


def test_silence_is_noticed_as_soon_as_it_exceeds_the_frame_age() -> None:
    watch = DetectionWatch()
    assert watch.on_frame("front", 10.0, 10.05, TERMS) == []
    assert watch.check(10.29, TERMS) is None
    assert watch.check(10.31, TERMS) is not None


def test_old_frame_does_not_rejuvenate() -> None:
    watch = DetectionWatch()
    watch.on_frame("front", 10.0, 10.05, TERMS)
    watch.on_frame("front", 9.0, 10.25, TERMS)
    assert watch.age_s(10.3) == pytest.approx(0.3)


def test_silence_of_one_of_two_sensors_is_silence() -> None:
    watch = DetectionWatch()
    watch.on_frame("front", 10.0, 10.0, TERMS)
    for step in range(20):
        watch.on_frame("left", 10.0 + step * 0.05, 10.0 + step * 0.05, TERMS)
    assert watch.check(10.95, TERMS) is not None


@pytest.mark.parametrize(
    ("interval_s", "latency_s", "in_time"), [(0.05, 0.05, True), (0.1, 0.06, False)]
)
def test_reaction_takes_an_interval_and_a_latency(
    interval_s: float, latency_s: float, *, in_time: bool
) -> None:
    watch = DetectionWatch()
    seen = [
        watch.on_frame("front", step * interval_s, step * interval_s + latency_s, TERMS)
        for step in range(4)
    ]
    assert seen[0] == []
    for later in seen[1:]:
        assert names(later) == ([] if in_time else [Assumption.REACTION_TIME])


def test_frame_from_the_future_is_a_clock_fault_and_no_sight() -> None:
    watch = DetectionWatch()
    assert names(watch.on_frame("front", 11.0, 10.0, TERMS)) == [Assumption.SENSOR_CLOCK]
    assert watch.check(10.0, TERMS) is not None


def track(
    watch: TrackingWatch,
    error_m: tuple[float, float] = (0.0, 0.0),
    velocity_mps: tuple[float, float] = (2.8, 0.0),
    *,
    cruising: bool = True,
) -> list[Assumption]:
    return names(watch.check(error_m, velocity_mps, (2.8, 0.0), TERMS, cruising=cruising))


def test_tracking_error_counts_once_confirmed() -> None:
    watch = TrackingWatch()
    seen = [track(watch, error_m=(0.2, 0.2)) for _ in range(CONFIRMATIONS)]
    assert seen == [[]] * (CONFIRMATIONS - 1) + [[Assumption.TRACKING_ERROR]]
    assert watch.position_error_m == pytest.approx(math.hypot(0.2, 0.2))


def test_single_glitch_is_forgiven() -> None:
    watch = TrackingWatch()
    for _ in range(5):
        assert track(watch, error_m=(0.3, 0.0)) == []
        assert track(watch) == []


@pytest.mark.parametrize("velocity_mps", [(3.01, 0.0), (2.8, 0.11), (2.8, -0.11)])
def test_velocity_error_counts_in_cruise_only(velocity_mps: tuple[float, float]) -> None:
    watch = TrackingWatch()
    for _ in range(CONFIRMATIONS):
        assert track(watch, velocity_mps=velocity_mps, cruising=False) == []
    seen = [track(watch, velocity_mps=velocity_mps) for _ in range(CONFIRMATIONS)]
    assert seen[-1] == [Assumption.VELOCITY_ERROR]


def test_slower_than_cruise_is_no_violation() -> None:
    watch = TrackingWatch()
    for _ in range(CONFIRMATIONS):
        assert track(watch, velocity_mps=(1.0, 0.0)) == []


def tilted(time_s: float, roll_rad: float, pitch_rad: float) -> Pose:
    return Pose(time_s, (0.0, 0.0, -4.0), (2.8, 0.0, 0.0), roll_rad, pitch_rad, 0.0)


def watch_tilt(
    roll_rad: float,
    asked_right_mps2: float,
    trim_roll_rad: float = 0.0,
    roll_max_deg: float | None = None,
) -> Violation | None:
    """Learn the trim in cruise, then ask for acceleration for half a second."""
    watch, terms = TiltWatch(), TERMS
    if roll_max_deg is not None:
        limit_rad = math.radians(roll_max_deg)
        terms = replace(terms, roll_max_rad=limit_rad, pitch_max_rad=limit_rad)
    for step in range(250):
        assert watch.check(tilted(step * TICK_S, trim_roll_rad, 0.0), (0.0, 0.0), TERMS) is None
    start_s, found = 250 * TICK_S, None
    for step in range(round((TILT_PATIENCE_S + TERMS.attitude_lag_s) / TICK_S) + 2):
        pose = tilted(start_s + step * TICK_S, roll_rad, 0.0)
        found = found or watch.check(pose, (0.0, asked_right_mps2), terms)
    return found


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_tilt_that_delivers_is_accepted(side: float) -> None:
    assert watch_tilt(side * math.radians(12.0), side * 2.5) is None


@pytest.mark.parametrize("roll_rad", [0.0, math.radians(4.0), -math.radians(15.0)])
def test_tilt_that_does_not_deliver_is_a_violation(roll_rad: float) -> None:
    found = watch_tilt(roll_rad, 2.5)
    assert found is not None
    assert found.assumption is Assumption.TILT_RESPONSE


def test_tilt_that_mends_what_a_gust_has_done_is_accepted() -> None:
    assert watch_tilt(0.0, 0.7) is None
    assert watch_tilt(0.0, 0.9) is not None  # all that a limit of 5° has to give


def test_little_is_asked_of_an_agile_vehicle_in_vain() -> None:
    """Found by a campaign (nominal --seed 1 --only 5520): turbulence turned the tilt round."""
    against_rad, asked_mps2 = -math.radians(3.0), 0.7
    assert watch_tilt(against_rad, asked_mps2, roll_max_deg=5.0) is not None
    assert watch_tilt(against_rad, asked_mps2, roll_max_deg=20.0) is None


def test_tilt_against_the_wind_is_taken_off() -> None:
    wind_rad = math.radians(8.0)
    assert watch_tilt(wind_rad + math.radians(12.0), 2.5, trim_roll_rad=wind_rad) is None
    assert watch_tilt(wind_rad, 2.5, trim_roll_rad=wind_rad) is not None


def watch_targets(targets_m: list[float]) -> Violation | None:
    """Hear ten targets a second while we ask for the origin; return the first violation."""
    watch, still = RivalWatch(), (0.0, 0.0, 0.0)
    found = (
        watch.check(number * 0.1, ((north_m, 0.0, -4.0), still), [((0.0, 0.0, -4.0), still)])
        for number, north_m in enumerate(targets_m)
    )
    return next((violation for violation in found if violation is not None), None)


def test_autopilot_that_goes_where_we_say_has_no_second_commander() -> None:
    assert watch_targets([0.1] * 100) is None


def test_pilot_who_has_just_taken_over_is_no_second_commander() -> None:
    assert watch_targets([0.0] * 10 + [5.0] * 11) is None


def test_target_at_our_place_but_without_a_velocity_is_anothers() -> None:
    watch, here, nowhere = RivalWatch(), (0.0, 0.0, -4.0), (math.nan, math.nan, math.nan)
    found = [
        watch.check(number * 0.1, (here, nowhere), [(here, (0.0, 0.0, 0.0))])
        for number in range(20)
    ]
    assert any(found)


@pytest.mark.parametrize("targets_m", [[5.0] * 20, [0.0, 5.0] * 10, [0.0, 0.0, 0.0, 5.0] * 5])
def test_target_that_keeps_being_anothers_is_a_second_commander(targets_m: list[float]) -> None:
    found = watch_targets(targets_m)
    assert found is not None
    assert found.assumption is Assumption.SECOND_COMMANDER


def test_ticks_in_time_are_accepted() -> None:
    watch = TickWatch()
    assert not [step for step in range(100) if watch.check(step * TICK_S) is not None]


@pytest.mark.parametrize("step_s", [TICK_OVERRUN_S + 1e-6, 0.0, -1.0])
def test_late_tick_and_time_that_stands_still_are_violations(step_s: float) -> None:
    watch = TickWatch()
    watch.check(10.0)
    found = watch.check(10.0 + step_s)
    assert found is not None
    assert found.assumption is Assumption.TICK_OVERRUN


@given(st.lists(st.floats(0.0, 10.0), min_size=1))
def test_age_is_that_of_the_newest_frame(stamps_s: list[float]) -> None:
    watch = DetectionWatch()
    for stamp_s in stamps_s:
        watch.on_frame("front", stamp_s, 10.0, TERMS)
    assert watch.age_s(10.0) == pytest.approx(10.0 - max(stamps_s))
