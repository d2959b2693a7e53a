import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from onboard.geometry.frames import wrap_angle
from onboard.mavlink.heading_drift import Attitude, HeadingDrift
from onboard.monitoring.assumptions import Assumption, Violation
from onboard.monitoring.estimator.heading import (
    COMPASS_CONFIRMATION_S,
    POINTING_CONFIRMATION_S,
    SIGHTING_CONFIRMATION_S,
    SIGHTING_GAP_S,
    HeadingMonitor,
)
from onboard.perception.bearings import BearingResidual
from onboard.vehicle_state import Pose
from tests.onboard.contract.example_terms import TERMS

RATE_HZ = 20.0


def pose(time_s: float, yaw_deg: float) -> Pose:
    return Pose(time_s, (0.0, 0.0, -4.0), (2.8, 0.0, 0.0), 0.0, 0.0, math.radians(yaw_deg))


def noticed_s(violations: list[object]) -> float | None:
    """Return when the first violation of those of successive steps was found."""
    return next((n / RATE_HZ for n, found in enumerate(violations) if found is not None), None)


@pytest.mark.parametrize("command_deg", [0.0, 90.0, 179.0, -179.0])
@pytest.mark.parametrize(
    ("error_deg", "noticed"), [(4.0, False), (-4.0, False), (6.0, True), (-18.0, True)]
)
def test_a_nose_off_its_command_is_noticed(
    command_deg: float, error_deg: float, *, noticed: bool
) -> None:
    monitor, command_rad = HeadingMonitor(), math.radians(command_deg)
    found = [
        monitor.check_pointing(pose(n / RATE_HZ, command_deg + error_deg), command_rad)
        for n in range(60)
    ]
    expected_s = pytest.approx(POINTING_CONFIRMATION_S) if noticed else None
    assert noticed_s([*found]) == expected_s
    assert all(each.assumption is Assumption.HEADING_ERROR for each in found if each is not None)


def test_a_nose_that_was_off_before_it_turned_begins_anew() -> None:
    monitor = HeadingMonitor()
    for n in range(15):
        assert monitor.check_pointing(pose(n / RATE_HZ, 8.0), 0.0) is None
    for n in range(15, 60):
        assert monitor.check_pointing(pose(n / RATE_HZ, 60.0), None) is None
    for n in range(60, 75):
        assert monitor.check_pointing(pose(n / RATE_HZ, 8.0), 0.0) is None


def test_a_nose_that_swings_back_is_none() -> None:
    monitor = HeadingMonitor()
    for n in range(200):
        swing_deg = 8.0 if n % 15 else 0.0
        assert monitor.check_pointing(pose(n / RATE_HZ, swing_deg), 0.0) is None


@pytest.mark.parametrize(
    ("ratio", "noticed"),
    [(None, False), (math.nan, False), (0.0, False), (0.99, False), (1.01, True), (9.0, True)],
)
def test_a_rejected_magnetometer_is_noticed(ratio: float | None, *, noticed: bool) -> None:
    monitor = HeadingMonitor()
    found = [monitor.check_compass(ratio, n / RATE_HZ) for n in range(100)]
    assert noticed_s([*found]) == (pytest.approx(COMPASS_CONFIRMATION_S) if noticed else None)


def test_a_magnetometer_that_is_heard_again_begins_anew() -> None:
    monitor = HeadingMonitor()
    for quiet in (0.2, None):
        ratios = ([1.5] * 30 + [quiet]) * 5
        assert not any(monitor.check_compass(r, n / RATE_HZ) for n, r in enumerate(ratios))


def sight(
    turned_deg: float,
    *,
    heading_error_deg: float = 0.0,
    noise_deg: tuple[float, ...] = (0.0,),
    error_m: float = 0.05,
    period_s: float = 1.0 / RATE_HZ,
) -> float | None:
    """See tracks 8 m away turned by an angle; return when that is noticed."""
    monitor = HeadingMonitor()
    terms = replace(TERMS, heading_error_rad=math.radians(heading_error_deg))
    for number in range(60):
        residuals = [
            BearingResidual(math.radians(turned_deg + noise), 2.0 * error_m / 8.0)
            for noise in noise_deg
        ]
        found = monitor.on_sightings(residuals, number * period_s, terms)
        if found is not None:
            assert found.assumption is Assumption.HEADING_ERROR
            return number * period_s
    return None


@pytest.mark.parametrize(
    ("turned_deg", "heading_error_deg", "noticed"),
    [
        (3.5, 0.0, False),  # the wander of a good estimator
        (-3.5, 0.0, False),
        (18.0, 0.0, True),  # what led to a contact
        (-18.0, 0.0, True),
        (18.0, 3.5, True),
        (10.0, 3.5, False),  # the track was placed with one error, is seen with the other
        (18.0, 8.0, False),
    ],
)
def test_tracks_that_come_round_together_are_noticed(
    turned_deg: float, heading_error_deg: float, *, noticed: bool
) -> None:
    expected_s = pytest.approx(SIGHTING_CONFIRMATION_S) if noticed else None
    assert sight(turned_deg, heading_error_deg=heading_error_deg) == expected_s


def test_tracks_that_disagree_show_no_heading() -> None:
    assert sight(0.0, noise_deg=(18.0, -18.0)) is None
    assert sight(18.0, noise_deg=(3.0, -3.0, 0.0)) is not None


def test_positions_that_are_uncertain_explain_a_turn() -> None:
    assert sight(18.0, error_m=1.5) is None


def test_sightings_far_apart_confirm_nothing() -> None:
    assert sight(18.0, period_s=SIGHTING_GAP_S + 0.1) is None


def test_frames_without_a_known_track_say_nothing() -> None:
    assert HeadingMonitor().on_sightings([], 0.0, TERMS) is None


def drifting(
    heading_deg: Callable[[float], float],
    turned_deg: Callable[[float], float],
    *,
    declared_deg: float = 4.0,
) -> tuple[float, Violation] | None:
    """Fly 40 s with an estimated heading while the body turns; return the first violation."""
    monitor, drift = HeadingMonitor(), HeadingDrift()
    terms = replace(TERMS, heading_error_rad=math.radians(declared_deg))
    for n in range(2000):
        time_s = n / 50.0
        roll_rad = math.radians(15.0) * math.sin(time_s)
        rate_radps = math.radians(turned_deg(time_s + 0.005) - turned_deg(time_s - 0.005)) / 0.01
        # A turn about the vertical, as the gyros of a body that is rolled have it.
        pitch_rate, yaw_rate = rate_radps * math.sin(roll_rad), rate_radps * math.cos(roll_rad)
        yaw_rad = wrap_angle(math.radians(heading_deg(time_s)))
        drift.add(Attitude(time_s, roll_rad, 0.0, yaw_rad, 0.0, pitch_rate, yaw_rate))
        found = monitor.check_drift(drift, time_s, terms)
        if found is not None:
            return time_s, found
    return None


def swing(amplitude_deg: float, period_s: float) -> Callable[[float], float]:
    return lambda time_s: amplitude_deg * math.sin(2.0 * math.pi * time_s / period_s)


@pytest.mark.parametrize(
    ("heading_deg", "turned_deg"),
    [
        (swing(0.0, 1.0), swing(0.0, 1.0)),
        (swing(3.5, 15.0), swing(0.0, 1.0)),  # wanders, and the nose stays
        (swing(0.0, 1.0), swing(3.5, 15.0)),  # the controller turns the nose by the wander
        (lambda t: 40.0 * t, lambda t: 40.0 * t),  # turns, round and round
        (lambda t: 175.0 + 20.0 * math.sin(t), lambda t: 20.0 * math.sin(t)),  # across south
        (swing(0.0, 1.0), lambda t: 0.05 * t),  # bias of the gyros
    ],
)
def test_a_heading_that_the_gyros_confirm_is_believed(
    heading_deg: Callable[[float], float], turned_deg: Callable[[float], float]
) -> None:
    assert drifting(heading_deg, turned_deg) is None


def test_where_no_heading_error_is_declared_the_gyros_are_not_asked() -> None:
    assert drifting(swing(18.0, 15.0), swing(0.0, 1.0), declared_deg=0.0) is None


@pytest.mark.parametrize("period_s", [15.0, 20.0, 30.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("turns", [False, True])
def test_a_heading_that_swings_against_the_gyros_is_noticed(
    period_s: float, sign: float, *, turns: bool
) -> None:
    swinging, still = swing(sign * 18.0, period_s), swing(0.0, 1.0)
    noticed = drifting(still, swinging) if turns else drifting(swinging, still)
    assert noticed is not None
    time_s, violation = noticed
    assert time_s < period_s / 4.0
    assert violation.assumption is Assumption.HEADING_ERROR
    assert violation.subject == "gyros"


def test_what_the_heading_did_across_a_silence_does_not_count() -> None:
    drift = HeadingDrift()
    for time_s, yaw_deg in ((0.0, 0.0), (0.02, 0.0), (1.0, 30.0), (1.02, 30.0), (0.5, 90.0)):
        drift.add(Attitude(time_s, 0.0, 0.0, math.radians(yaw_deg), 0.0, 0.0, 0.0))
    assert drift.drift_rad == pytest.approx(0.0)
    assert drift.begun == 3


def test_an_attitude_that_comes_twice_or_late_is_left_out() -> None:
    drift = HeadingDrift()
    for time_s in (0.0, 0.02, 0.02, 0.06, 0.04, 0.08):
        drift.add(Attitude(time_s, 0.0, 0.0, time_s, 0.0, 0.0, 0.0))
    assert drift.drift_rad == pytest.approx(0.08)
    assert drift.begun == 1
