"""When the autopilot decides that the vehicle stands, and when that it flies."""

import math

import pytest

from sitl.autopilot.land_detector import LandDetector, climbs
from sitl.plant.setpoint import Setpoint
from sitl.plant.truth import Vector, VehicleTruth
from tests.sitl.autopilot.truths import truth_at

SINKING = Setpoint(velocity_north_mps=0.0, velocity_east_mps=0.0, velocity_down_mps=0.7)
LIGHT, HEAVY = 0.3, 1.0  # thrust over weight: the ground carries the rest, or nothing


def landed_after_s(
    detector: LandDetector,
    setpoint: Setpoint | None = SINKING,
    thrust_share: float = LIGHT,
    velocity_ned_mps: Vector = (0.0, 0.0, 0.0),
    *,
    position_valid: bool = True,
) -> float:
    """Return how long it takes to detect the landing; ``inf`` if 3 s are not enough."""
    for tick in range(301):
        truth = truth_at(tick * 0.01, velocity_ned_mps=velocity_ned_mps)
        detector.update(truth, setpoint, thrust_share, position_valid=position_valid)
        if detector.on_ground:
            return tick * 0.01
    return math.inf


def flying() -> LandDetector:
    return LandDetector(on_ground=False, down_m=-4.0)


def test_a_vehicle_at_rest_with_little_thrust_has_landed_after_half_a_second() -> None:
    detector = flying()
    assert landed_after_s(detector) == pytest.approx(0.5)
    assert detector.since_s == pytest.approx(0.5)


def test_without_a_setpoint_the_signs_are_the_same() -> None:
    assert landed_after_s(flying(), setpoint=None) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("setpoint", "thrust_share", "velocity_ned_mps"),
    [
        (SINKING, HEAVY, (0.0, 0.0, 0.0)),
        (SINKING, LIGHT, (0.0, 0.0, 0.2)),
        (SINKING, LIGHT, (0.0, 0.0, -0.2)),
        (SINKING, LIGHT, (0.4, 0.0, 0.0)),
        (SINKING, LIGHT, (0.0, -0.4, 0.0)),
        (Setpoint(velocity_down_mps=0.0), LIGHT, (0.0, 0.0, 0.0)),
        (Setpoint(down_m=-1.0), LIGHT, (0.0, 0.0, 0.0)),
    ],
)
def test_any_sign_of_flight_keeps_it_flying(
    setpoint: Setpoint, thrust_share: float, velocity_ned_mps: Vector
) -> None:
    assert landed_after_s(flying(), setpoint, thrust_share, velocity_ned_mps) == math.inf


def test_a_setpoint_below_the_ground_counts_as_sinking() -> None:
    assert landed_after_s(flying(), Setpoint(down_m=0.5)) == pytest.approx(0.5)


def test_without_a_position_the_horizontal_velocity_is_ignored() -> None:
    drifting_mps = (1.0, 1.0, 0.0)
    assert landed_after_s(flying(), velocity_ned_mps=drifting_mps) == math.inf
    landed_s = landed_after_s(flying(), velocity_ned_mps=drifting_mps, position_valid=False)
    assert landed_s == pytest.approx(0.5)


def test_a_bounce_starts_the_half_second_again() -> None:
    detector = flying()
    states: list[VehicleTruth] = [truth_at(tick * 0.01) for tick in range(40)]
    states.append(truth_at(0.40, velocity_ned_mps=(0.0, 0.0, -0.5)))
    states += [truth_at(0.41 + tick * 0.01) for tick in range(50)]
    for truth in states:
        detector.update(truth, SINKING, LIGHT)
    assert not detector.on_ground
    detector.update(truth_at(0.92), SINKING, LIGHT)
    assert detector.on_ground


def test_it_takes_off_when_it_is_15_cm_above_where_it_stood() -> None:
    detector = LandDetector(on_ground=True, down_m=-0.3)
    detector.update(truth_at(1.0, (0.0, 0.0, -0.44)), None, HEAVY)
    assert detector.on_ground
    detector.update(truth_at(2.0, (0.0, 0.0, -0.46)), None, HEAVY)
    assert not detector.on_ground
    assert detector.since_s == 2.0


def test_the_next_take_off_counts_from_where_it_has_landed() -> None:
    detector = flying()
    for tick in range(60):
        detector.update(truth_at(tick * 0.01, (0.0, 0.0, -2.0)), None, LIGHT)
    assert detector.on_ground
    detector.update(truth_at(1.0, (0.0, 0.0, -2.1)), None, HEAVY)
    assert detector.on_ground
    detector.update(truth_at(1.1, (0.0, 0.0, -2.2)), None, HEAVY)
    assert not detector.on_ground


@pytest.mark.parametrize(
    ("setpoint", "lifts"),
    [
        (Setpoint(down_m=-0.2), True),
        (Setpoint(down_m=-0.05), False),
        (Setpoint(down_m=1.0, velocity_down_mps=-1.0), False),
        (Setpoint(velocity_down_mps=-0.1), True),
        (Setpoint(velocity_down_mps=0.1), False),
        (Setpoint(velocity_down_mps=0.1, acceleration_down_mps2=-5.0), False),
        (Setpoint(acceleration_down_mps2=-0.2), True),
        (Setpoint(acceleration_down_mps2=0.0), False),
    ],
)
def test_which_setpoints_take_a_standing_vehicle_off_the_ground(
    setpoint: Setpoint, lifts: bool
) -> None:
    assert climbs(setpoint, truth_at()) is lifts
