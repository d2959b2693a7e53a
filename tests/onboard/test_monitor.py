import math

import pytest

from onboard.contract import Terms
from onboard.mavlink import Pose
from onboard.monitor import (
    CONFIRMATIONS,
    Assumption,
    DetectionWatch,
    TrackingWatch,
    Violation,
    check_frame,
    check_obstacle,
)
from onboard.obstacles import Detection, DetectionFrame, Obstacle
from onboard.region import Box, Encounter, RegionOfInfluence

TERMS = Terms[float](
    roll_max_rad=0.26,
    pitch_max_rad=0.26,
    thrust_to_weight=2.0,
    cruise_speed_mps=2.8,
    radius_m=0.3,
    tracking_error_m=0.25,
    velocity_error_x_mps=0.2,
    velocity_error_y_mps=0.1,
    reaction_time_s=0.15,
    attitude_lag_s=0.15,
    setpoint_loss_timeout_s=0.5,
    detection_range_m=12.0,
    field_of_view_rad=math.radians(120.0),
    frame_age_max_s=0.3,
    position_error_m=0.05,
    obstacle_size_max_m=4.0,
    obstacle_size_min_m=0.0,
    obstacle_separation_min_m=16.0,
)


def frame(
    range_m: float = 12.0, field_of_view_deg: float = 120.0, uncertainty_m: float = 0.05
) -> DetectionFrame:
    seen = Detection(
        id="1", center_m=(5.0, 0.0), size_m=(1.0, 1.0), yaw_deg=0.0, uncertainty_m=uncertainty_m
    )
    return DetectionFrame(
        version=1,
        source="front",
        sequence=0,
        stamp_unix_s=0.0,
        frame="local_ned",
        range_m=range_m,
        field_of_view_deg=field_of_view_deg,
        obstacles=(seen,),
    )


def names(violations: list[Violation]) -> list[Assumption]:
    return [violation.assumption for violation in violations]


def test_frame_as_assumed_is_accepted() -> None:
    assert check_frame(frame(), TERMS) == []


@pytest.mark.parametrize(
    ("seen", "broken"),
    [
        (frame(range_m=11.9), Assumption.DETECTION_RANGE),
        (frame(field_of_view_deg=119.0), Assumption.FIELD_OF_VIEW),
        (frame(uncertainty_m=0.06), Assumption.DETECTION_UNCERTAINTY),
    ],
)
def test_frame_that_sees_less_than_assumed_is_a_violation(
    seen: DetectionFrame, broken: Assumption
) -> None:
    assert names(check_frame(seen, TERMS)) == [broken]


def obstacle(size_m: float) -> Obstacle:
    box = Box(10.0, 10.0 + size_m, -0.5, 0.5)
    encounter = Encounter(2.6, 2.6, 2.6, 2.6, 3.0, 0.1, *box.size_m, 0.15, 0.15, 0.0, 0.0)
    return Obstacle("front/1", box, 0.05, RegionOfInfluence.around(box, encounter))


@pytest.mark.parametrize(("size_m", "allowed"), [(4.09, True), (4.11, False)])
def test_size_limit_allows_for_the_error_of_both_faces(size_m: float, allowed: bool) -> None:
    assert (names(check_obstacle(obstacle(size_m), None, TERMS)) == []) is allowed


def test_intersecting_regions_name_both_obstacles() -> None:
    (violation,) = check_obstacle(obstacle(1.0), obstacle(1.0), TERMS)
    assert violation.assumption is Assumption.ROI_INTERSECTION
    assert violation.subject == "front/1 and front/1"


def test_sensor_that_was_never_heard_is_blind() -> None:
    watch = DetectionWatch(TERMS)
    violation = watch.check(0.0)
    assert violation is not None
    assert violation.assumption is Assumption.DETECTION_AGE
    assert violation.event(0.0).data["measured"] is None


def test_silence_is_noticed_as_soon_as_it_exceeds_the_frame_age() -> None:
    watch = DetectionWatch(TERMS)
    assert watch.on_frame("front", stamp_s=10.0, now_s=10.05) is None
    assert watch.check(10.29) is None
    assert watch.check(10.31) is not None


def test_old_frame_does_not_rejuvenate() -> None:
    watch = DetectionWatch(TERMS)
    watch.on_frame("front", stamp_s=10.0, now_s=10.05)
    watch.on_frame("front", stamp_s=9.0, now_s=10.25)
    assert watch.age_s(10.3) == pytest.approx(0.3)


def test_frame_from_the_future_is_a_clock_fault_and_no_sight() -> None:
    watch = DetectionWatch(TERMS)
    violation = watch.on_frame("front", stamp_s=11.0, now_s=10.0)
    assert violation is not None
    assert violation.assumption is Assumption.SENSOR_CLOCK
    assert watch.check(10.0) is not None


def pose(time_s: float, x_m: float, vx_mps: float = 2.8) -> Pose:
    return Pose(time_s, (x_m, 0.0, -4.0), (vx_mps, 0.0, 0.0), 0.0, 0.0, 0.0)


def test_telemetry_grows_stale() -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    assert watch.check_age(pose(1.0, 0.0), 1.5) is None
    stale = watch.check_age(pose(1.0, 0.0), 1.51)
    assert stale is not None
    assert stale.assumption is Assumption.TELEMETRY_AGE
    assert watch.check_age(None, 0.0) is not None


def test_flight_is_no_jump_but_a_reset_is() -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    for step in range(50):
        assert watch.check_jump(pose(step * 0.02, step * 0.056)) is None
    reset = watch.check_jump(pose(1.0, 50 * 0.056 + 0.6))
    assert reset is not None
    assert reset.assumption is Assumption.ESTIMATOR_RESET
    assert watch.check_jump(pose(1.02, 51 * 0.056 + 0.6)) is None


def track(
    watch: TrackingWatch,
    error_m: tuple[float, float] = (0.0, 0.0),
    velocity_mps: tuple[float, float] = (2.8, 0.0),
    *,
    cruising: bool = True,
) -> list[Assumption]:
    return names(watch.check_tracking(error_m, velocity_mps, (2.8, 0.0), cruising=cruising))


def test_tracking_error_counts_once_confirmed() -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    seen = [track(watch, error_m=(0.2, 0.2)) for _ in range(CONFIRMATIONS)]
    assert seen == [[]] * (CONFIRMATIONS - 1) + [[Assumption.TRACKING_ERROR]]
    assert watch.position_error_m == pytest.approx(math.hypot(0.2, 0.2))


def test_single_glitch_is_forgiven() -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    for _ in range(5):
        assert track(watch, error_m=(0.3, 0.0)) == []
        assert track(watch) == []


@pytest.mark.parametrize("velocity_mps", [(3.01, 0.0), (2.8, 0.11), (2.8, -0.11)])
def test_velocity_error_counts_in_cruise_only(velocity_mps: tuple[float, float]) -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    for _ in range(CONFIRMATIONS):
        assert track(watch, velocity_mps=velocity_mps, cruising=False) == []
    seen = [track(watch, velocity_mps=velocity_mps) for _ in range(CONFIRMATIONS)]
    assert seen[-1] == [Assumption.VELOCITY_ERROR]


def test_slower_than_cruise_is_no_violation() -> None:
    watch = TrackingWatch(TERMS, stale_after_s=0.5)
    for _ in range(CONFIRMATIONS):
        assert track(watch, velocity_mps=(1.0, 0.0)) == []
