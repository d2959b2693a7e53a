"""``sitl.tracking.toward_obstacle``: the plant uses the contract's tracking error to its limit."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from gcs_tools.scenario import load_scenario
from onboard.files.obstacle_field import Obstacle, ObstacleField
from onboard.guidance.phases import Phase
from sitl.autopilot.modes import Mode
from sitl.config import SitlConfig, TrackingConfig
from sitl.environment.world import World
from sitl.plant.pinned_error import PinnedError
from sitl.virtual.faults.schema import Fault
from sitl.virtual.simulation import SimulatedFlight, Simulation

CONFIG = Path(__file__).parents[3] / "config"
# Of the contract's 0.2 m; the age of the telemetry counts as tracking error too.
ERROR_M = 0.17


def simulated(*faults: dict[str, object], toward_obstacle: bool) -> Simulation:
    """The paper's example, with faults."""
    read = load_scenario(CONFIG / "paper.yaml")
    tracking = TrackingConfig(toward_obstacle=toward_obstacle, error_m=ERROR_M)
    plant = read.plant.model_copy(update={"tracking": tracking})
    object.__setattr__(read, "plant", plant)
    return Simulation(
        SimulatedFlight(
            contract=read.contract,
            mission=read.mission,
            sitl=read.sitl_config(),
            obstacles=read.obstacles,
            faults=tuple(TypeAdapter(Fault).validate_python(fault) for fault in faults),
        )
    )


def flown(
    *, toward_obstacle: bool
) -> tuple[Simulation, list[tuple[float, float, float]], set[Phase]]:
    """Fly the paper's example.

    Returns:
        The flight, and while it flies, tick by tick: the clearance, the true tracking error, and
        how much of that is directed to the nearest face; the phases that it came through.
    """
    simulation = simulated(toward_obstacle=toward_obstacle)
    errors_m, phases = [], set()
    world = simulation.scene.world
    while not simulation.over and simulation.now_s < 100.0:
        simulation.advance()
        phases.add(simulation.autonomy.navigator.phase)
        if simulation.autonomy.navigator.phase in (Phase.CRUISE, Phase.AVOID):
            wanted = simulation.scene.vehicle.autopilot.commander.setpoint
            at_m = simulation.scene.vehicle.truth.position_ned_m
            if wanted is not None:
                # The setpoint is that of the decision, 20 ms before.
                ahead_m = (
                    wanted.north_m + 0.02 * wanted.velocity_north_mps,
                    wanted.east_m + 0.02 * wanted.velocity_east_mps,
                )
                error_m = (at_m[0] - ahead_m[0], at_m[1] - ahead_m[1])
                toward = world.toward_nearest(at_m)
                directed_m = error_m[0] * toward[0] + error_m[1] * toward[1]
                errors_m.append((world.clearance_m, math.hypot(*error_m), directed_m))
    return simulation, errors_m, phases


def test_clearance_shrinks_by_the_error_and_a_flight_inside_its_contract_hits_nothing() -> None:
    free, own_m, _ = flown(toward_obstacle=False)
    pinned, errors_m, phases = flown(toward_obstacle=True)
    error_m = ERROR_M
    assert max(each[1] for each in own_m) < 0.5 * error_m
    assert max(each[1] for each in errors_m) == pytest.approx(error_m, abs=0.01)
    clearance_m, _, directed_m = min(errors_m)
    assert directed_m == pytest.approx(error_m, abs=0.02)  # where it matters most
    assert clearance_m == pytest.approx(pinned.scene.world.clearance_min_m, abs=0.02)
    assert Phase.HOLD not in phases
    lost_m = free.scene.world.clearance_min_m - pinned.scene.world.clearance_min_m
    # An avoidance begins where the vehicle is, so that its plan takes up some of the error.
    assert 0.4 * error_m < lost_m < error_m + 0.05
    assert pinned.scene.world.collisions == 0


def test_in_standby_the_error_does_not_add_up() -> None:
    """A service in standby commands the position that the vehicle reports, error included."""
    fault = {"kind": "operator_takes_over", "phase": "cruise", "start_s": 5.0, "duration_s": 4.3}
    simulation = simulated(fault, toward_obstacle=True)
    stood_m: list[tuple[float, float, float]] = []
    while simulation.now_s < 60.0:
        simulation.advance()
        truth = simulation.scene.vehicle.truth
        in_standby = simulation.autonomy.navigator.phase is Phase.STANDBY
        if stood_m and not in_standby:
            break
        # Handed back, which the service hears with the next heartbeat.
        offboard = simulation.scene.vehicle.autopilot.commander.mode is Mode.OFFBOARD
        if in_standby and offboard and truth.position_ned_m[0] > 1.0:
            stood_m.append(truth.position_ned_m)
    assert len(stood_m) > 10
    assert max(math.dist(place_m, stood_m[0]) for place_m in stood_m) < 0.5 * ERROR_M


def test_the_error_points_to_the_nearest_face_and_turns_no_faster_than_it_may() -> None:
    box = Obstacle(id="a", center_ned_m=(10.0, 0.0), size_m=(2.0, 2.0), yaw_deg=0.0)
    world = World(ObstacleField.of([box]), 0.3)
    assert world.toward_nearest((0.0, 0.0, -4.0)) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert world.toward_nearest((10.0, -5.0, -4.0)) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert World(ObstacleField.of([]), 0.3).toward_nearest((0.0, 0.0, -4.0)) == (0.0, 0.0)
    error = PinnedError(0.2)
    error.advance((1.0, 0.0), 0.05)
    assert (error.north_m, error.east_m) == pytest.approx((0.1, 0.0))
    error.advance((1.0, 0.0), 0.1)
    assert (error.north_m, error.east_m) == pytest.approx((0.2, 0.0))
    for _ in range(20):
        error.advance((0.0, -1.0), 0.1)
    assert (error.north_m, error.east_m) == pytest.approx((0.0, -0.2))


def test_the_simulator_has_no_contract_so_the_size_has_to_be_given() -> None:
    with pytest.raises(ValidationError, match=r"needs tracking\.error_m"):
        SitlConfig(tracking=TrackingConfig(toward_obstacle=True))
    SitlConfig(tracking=TrackingConfig(toward_obstacle=True, error_m=0.2))


def test_a_scenario_pins_the_error_at_its_contracts() -> None:
    read = load_scenario(CONFIG / "paper.yaml")
    assert read.sitl_config().tracking.error_m == read.contract.vehicle.tracking_error_m


def test_what_is_seen_late_of_the_error_stays_within_its_size() -> None:
    # An older position is judged as if it were a newer one: flying east at 3 m/s, the vehicle seems
    # 3 cm farther west, and the estimate adds 2 cm.
    error = PinnedError(0.3, seen_late_s=0.01)
    for toward in ((0.0, -1.0), (0.6, -0.8), (1.0, 0.0), (0.0, 1.0)):
        for _ in range(100):
            error.advance(toward, 0.02, (0.0, 3.0), (0.0, -0.02))
        seen_m = math.hypot(error.north_m, error.east_m - 0.05)
        assert max(seen_m, math.hypot(error.north_m, error.east_m)) <= 0.3 + 1e-9
    assert error.east_m == pytest.approx(0.3)  # ahead, nothing of it is lost


def test_a_reset_error_may_be_what_the_estimate_causes() -> None:
    error = PinnedError(0.3)
    error.forget(0.02, -0.01)
    assert (error.north_m, error.east_m) == (0.02, -0.01)
