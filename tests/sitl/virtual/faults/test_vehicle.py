"""What each fault changes of the simulated vehicle, and that its end changes it back."""

import math
from collections.abc import Callable
from typing import Literal

import pytest

from sitl.config import StartConfig, VehicleConfig
from sitl.plant.multirotor import INTACT
from sitl.vehicle.vehicle import SimulatedVehicle
from sitl.virtual.faults.schedule import FaultSchedule
from sitl.virtual.faults.schema import Fault, FaultKind
from sitl.virtual.faults.vehicle import VehicleFaults

Flavour = Literal["px4", "ardupilot"]
LINK = 1


class Bench:
    """A vehicle, faults of it, and the time."""

    def __init__(
        self,
        *faults: Fault,
        flavour: Flavour = "px4",
        position_ned_m: tuple[float, ...] = (0, 0, 0),
    ) -> None:
        north_m, east_m, down_m = map(float, position_ned_m)
        start = StartConfig(position_ned_m=(north_m, east_m, down_m))
        config = VehicleConfig(flavour=flavour, realism="ideal", start=start)
        self.vehicle = SimulatedVehicle(config)
        self.vehicle.autopilot.open_link(LINK)
        self.schedule = FaultSchedule(faults, seed=1)
        self._faults = VehicleFaults(self.schedule, self.vehicle, 1, flavour, LINK)

    def advance(self, until_s: float) -> None:
        now_s = self.vehicle.truth.time_s
        while now_s < until_s - 1e-9:
            now_s += 0.02
            self.schedule.advance(now_s, "cruise")
            self._faults.apply()
            self.vehicle.advance(now_s)


def passing(kind: FaultKind, amount: float | None = None) -> Fault:
    """Return a fault that is present from 1 s to 2 s."""
    return Fault(kind=kind, start_s=1.0, duration_s=1.0, amount=amount)


Reading = Callable[[SimulatedVehicle], object]


@pytest.mark.parametrize(
    ("kind", "flavour", "reading", "while_present"),
    [
        ("parameter_changed", "px4", lambda v: v.autopilot.parameters["MPC_TILTMAX_AIR"], 20.0),
        ("parameter_changed", "ardupilot", lambda v: v.autopilot.parameters["ANGLE_MAX"], 2000.0),
        (
            "parameter_changed",
            "px4",
            lambda v: v.autopilot.commander.settings.tilt_max_rad,
            pytest.approx(math.radians(20.0)),
        ),
        ("attitude_slow", "px4", lambda v: v.autopilot.commander.settings.roll_gain_per_s, 3.0),
        ("attitude_slow", "px4", lambda v: v.autopilot.commander.settings.pitch_gain_per_s, 3.0),
        (
            "attitude_slow",
            "ardupilot",
            lambda v: v.autopilot.commander.settings.roll_gain_per_s,
            3.0,
        ),
        ("gps_lost", "px4", lambda v: v.autopilot.commander.failures.gps_has_fix, False),
        ("mode_rejected", "px4", lambda v: v.autopilot.commander.failures.modes_refused, True),
        (
            "thrust_lost",
            "px4",
            lambda v: tuple(v.autopilot.commander.failures.rotor_shares),
            (0.9,) * 4,
        ),
        (
            "motor_failed",
            "px4",
            lambda v: tuple(v.autopilot.commander.failures.rotor_shares),
            (0.0, 1.0, 1.0, 1.0),
        ),
        (
            "height_reset",
            "px4",
            lambda v: round(v.autopilot.estimator.error.down_m, 6),
            -4.0,
        ),
    ],
)
def test_a_fault_changes_the_vehicle_and_its_end_restores_it(
    kind: FaultKind, flavour: Flavour, reading: Reading, while_present: object
) -> None:
    bench = Bench(passing(kind), flavour=flavour)
    bench.advance(0.9)
    before = reading(bench.vehicle)
    assert before != while_present
    bench.advance(1.5)
    assert reading(bench.vehicle) == while_present
    bench.advance(2.5)
    assert reading(bench.vehicle) == before


def test_no_fault_touches_nothing() -> None:
    bench = Bench(passing("thrust_lost"))
    bench.advance(0.5)
    failures = bench.vehicle.autopilot.commander.failures
    assert failures.rotor_shares == INTACT
    assert not failures.modes_refused


def test_a_fault_begins_once_while_it_lasts() -> None:
    bench = Bench(passing("height_reset", 2.0))
    bench.advance(1.9)
    assert bench.vehicle.autopilot.estimator.resets == 1
    bench.advance(3.0)
    assert bench.vehicle.autopilot.estimator.resets == 2


def test_a_height_estimate_that_jumps_twice_returns_twice() -> None:
    faults = (passing("height_reset", 2.0), Fault(kind="height_reset", start_s=3.0, amount=5.0))
    bench = Bench(*faults)
    errors_m = []
    for until_s in (1.5, 2.5, 3.5):
        bench.advance(until_s)
        errors_m.append(bench.vehicle.autopilot.estimator.error.down_m)
    assert errors_m == pytest.approx([-2.0, 0.0, -5.0])


def test_a_height_estimate_jumps_and_the_vehicle_follows_it_the_other_way() -> None:
    bench = Bench(
        Fault(kind="height_reset", start_s=1.0, amount=2.0), position_ned_m=(0.0, 0.0, -6.0)
    )
    heights_m = []
    for until_s in (0.96, 1.1, 12.0):
        bench.advance(until_s)
        vehicle = bench.vehicle
        heights_m.append((-vehicle.truth.position_ned_m[2], -vehicle.estimate.position_ned_m[2]))
    assert heights_m[0] == pytest.approx((6.0, 6.0), abs=0.1)
    assert heights_m[1] == pytest.approx((6.0, 8.0), abs=0.3)
    assert heights_m[2] == pytest.approx((4.0, 6.0), abs=0.2)  # it descends to where 6 m seems


def test_a_gust_pushes_to_the_east_and_passes() -> None:
    still, blown = (
        Bench(position_ned_m=(0, 0, -6)),
        Bench(Fault(kind="gust", start_s=1.0, amount=9.0), position_ned_m=(0, 0, -6)),
    )
    for bench in (still, blown):
        bench.advance(3.0)
    east_m = [bench.vehicle.truth.position_ned_m[1] for bench in (still, blown)]
    assert east_m[1] - east_m[0] > 0.03
    blown.advance(12.0)
    assert abs(blown.vehicle.truth.velocity_ned_mps[1]) < 0.05


def test_a_failed_motor_brings_a_quadrotor_down() -> None:
    bench = Bench(Fault(kind="motor_failed", start_s=1.0), position_ned_m=(0, 0, -6))
    bench.advance(0.96)
    assert -bench.vehicle.truth.position_ned_m[2] > 5.5
    bench.advance(6.0)
    assert -bench.vehicle.truth.position_ned_m[2] < 0.5
